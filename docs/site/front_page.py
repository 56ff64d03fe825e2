"""The two pictures at the head of README.md: the hand, and a log beside the model found from it."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure
from PIL import Image

import butterfly as bf
from butterfly.experiment.source import read_experiment
from butterfly.plant.watch.picture import render

ADDED = bf.AddedMass(mass=0.12, arm=0.104)
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


def draw_front_page(data: Path, folder: Path) -> None:
    """Write hand.png and quickstart.png to a folder.

    Parameters
    ----------
    data
        What `butterfly run quickstart` has written.
    folder
        Where to.
    """
    robot = read_experiment("quickstart").plant.robot
    render(robot, ADDED, 0.6, folder / "hand.png", 800)
    _draw_fit(data, "120g_6rads", folder / "quickstart.png")


def _draw_fit(data: Path, name: str, path: Path) -> None:
    """Draw a log of a data set beside the free run of the model identified from all of them."""
    result = bf.identify(bf.read(data))
    log = next(each for each in result.data.logs if name in each.name)
    model = result.model.simulate(log).angle
    shown = log.time <= log.time[0] + SHOWN
    time = log.time[shown]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(12, 8), dpi=100, facecolor=PAPER, layout="constrained")
        above, below = figure.subplots(2, sharex=True, height_ratios=(3, 1))
        above.plot(time, log.angle[shown], color=MEASURED, lw=7, label="log: 120 g, 6 rad/s")
        above.plot(time, model[shown], color=MODEL, lw=2, label="identified model, same input")
        below.plot(time, 1e3 * (log.angle - model)[shown], color=INK, lw=0.6)
        for axes, label in ((above, "angle in rad"), (below, "difference\nin mrad")):
            axes.set_facecolor(PAPER)
            axes.set_ylabel(label)
        above.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2, frameon=False)
        below.set_xlabel("time in s")
        below.set_xlim(0, SHOWN)
        figure.align_ylabels()
        figure.get_layout_engine().set(w_pad=0.15, h_pad=0.12)
        figure.savefig(path)
    Image.open(path).convert("RGB").quantize(64).save(path, optimize=True)
