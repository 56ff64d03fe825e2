"""The two pictures at the head of README.md: the hand, and a log beside the model found from it."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

import butterfly as bf
from butterfly.arrays import Samples
from butterfly.experiment.source import read_experiment
from butterfly.plant.watch.picture import render

HAND, LOG = "hand", "quickstart"  # the pictures' names
ADDED, ANGLE = bf.AddedMass(mass=0.12, arm=0.104), 0.6  # rad
SHOWN_LOG, LEGEND = "120g_6rads", ("log: 120 g, 6 rad/s", "identified model, same input")
PAPER, INK, MEASURED, MODEL = "#f5f5f6", "#33383f", "#8fa3b8", "#c2710c"
SHOWN = 12.0  # s
STYLE = {
    "font.size": 15,
    "axes.edgecolor": "#b9bdc4",
    "axes.labelcolor": INK,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "axes.grid": True,
    "grid.color": "#e1e3e6",
    "axes.spines.top": False,
    "axes.spines.right": False,
}


def hand_shown(path: Path | None) -> list[str]:
    """Draw the hand, if a path is given; return what is to be seen of it, and of what robot."""
    robot = read_experiment("quickstart").plant.robot
    if path is not None:
        render(robot, ADDED, ANGLE, path, 800)
    p, moment = robot.lumped, f"{1e3 * ADDED.mass:g} g at {1e3 * ADDED.arm:g} mm"
    values = (f"{name} {getattr(p, name):g}" for name in ("p1", "p2", "p3", "p4", "coulomb"))
    return [f"{moment}, turned by {ANGLE:g} rad", *values]


def fit_shown(data: Path, path: Path | None) -> list[str]:
    """Draw a log and the free run of the model identified from all logs, if a path is given.

    Parameters
    ----------
    data
        What `butterfly run quickstart` has written.
    path
        Where to.

    Returns
    -------
    The legend, the largest angle and the root mean square of the difference.
    """
    result = bf.identify(bf.read(data))
    log = next(log for log in result.data.logs if SHOWN_LOG in log.name)
    shown = log.time <= log.time[0] + SHOWN
    time, angle = log.time[shown], log.angle[shown]
    missed = 1e3 * (angle - result.model.simulate(log).angle[shown])  # mrad
    if path is not None:
        _draw_fit(time, angle, missed, path)
    largest, usual = abs(angle).max(), np.sqrt(np.mean(missed**2))
    return [*LEGEND, f"at most {largest:.2f} rad", f"rms difference {usual:.2f} mrad"]


def _draw_fit(time: Samples, angle: Samples, missed: Samples, path: Path) -> None:
    """Draw an angle in rad, that of a model, and below them their difference in mrad."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(12, 8), dpi=100, facecolor=PAPER, layout="constrained")
        above, below = figure.subplots(2, sharex=True, height_ratios=(3, 1))
        above.plot(time, angle, color=MEASURED, lw=7, label=LEGEND[0])
        above.plot(time, angle - 1e-3 * missed, color=MODEL, lw=2, label=LEGEND[1])
        below.plot(time, missed, color=INK, lw=0.6)
        for axes, label in ((above, "angle in rad"), (below, "difference\nin mrad")):
            axes.set_facecolor(PAPER)
            axes.set_ylabel(label)
        above.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2, frameon=False)
        below.set_xlabel("time in s")
        below.set_xlim(0, SHOWN)
        figure.align_ylabels()
        figure.get_layout_engine().set(w_pad=0.15, h_pad=0.12)
        figure.savefig(path)
