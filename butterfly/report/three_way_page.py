"""Courses of logs in the report of MuJoCo against grey box against log."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from plotly.graph_objects import Figure

from butterfly.arrays import Samples
from butterfly.comparison.three_way import ThreeWay
from butterfly.identification.residuals import LogResiduals
from butterfly.report.figures import PALETTE, Series, add, middle, panel, panels, seen_samples
from butterfly.report.log_figures import (
    correlation_figure,
    correlation_series,
    first_stretch,
    torque_figure,
)
from butterfly.report.page import Page, Section

_LINES = {  # the later ones above, and thinner, so that all are seen
    "MuJoCo": {"color": PALETTE[1], "width": 8},
    "grey box": {"color": PALETTE[2], "width": 5},
    "measured": {"color": PALETTE[0], "width": 1.8},
}
_STEP = 0.02  # s between drawn points
_MOST = 4000  # points of a curve
_PERIODS = 4  # of the drawn motion in the phase plane
_DOTS = 800  # instants of a residual torque


def with_courses(
    compared: Sequence[ThreeWay], log_residuals: Sequence[LogResiduals], page: Page
) -> Page:
    """Return the page of a comparison with the course of each log, and its residuals."""
    chosen = middle([comparison.fits["grey box"] for comparison in compared])
    of_log: dict[str, Callable[[ThreeWay], Figure]] = {
        "time": _time_figure,
        "phase": _phase_figure,
        "residual": lambda one: torque_figure(one.residual, one.log.added_mass.joint, _DOTS),
    }
    series = {name: Series.of_figures([*map(draw, compared)]) for name, draw in of_log.items()}
    stretches = [first_stretch(comparison.log) for comparison in compared]
    series["time"] = replace(series["time"], stretches=stretches)
    fits, *others, residuals = (
        replace(part, tables=(part.tables[0]._replace(picks=range(len(log_residuals))),))
        for part in page.sections
    )
    sections = [
        Section(
            title="Measured against simulated",
            text="Free run: the simulators get the recorded input and the initial angle only. The "
            "phase plane shows the end of the log.",
            series={"time": series["time"], "phase": series["phase"]},
        ),
        fits,
        *others,
        replace(
            residuals,
            text="Correlations of the grey box's errors: sensor noise alone stays inside the "
            "bands. Below: the residual torque, averaged over short intervals.",
            series={"left-over": correlation_series(log_residuals), "residual": series["residual"]},
        ),
    ]
    return replace(
        page,
        sections=sections,
        logs=[
            f"{comparison.log.label} – FIT {comparison.fits['grey box']:.1f} %"
            for comparison in compared
        ],
        chosen=chosen,
        pictures={name: partial(draw, compared[chosen]) for name, draw in of_log.items()}
        | {"left-over": partial(correlation_figure, log_residuals[chosen])},
    )


def _angles(comparison: ThreeWay) -> dict[str, Samples]:
    return {
        "MuJoCo": comparison.mujoco,
        "grey box": comparison.greybox,
        "measured": comparison.log.angle,
    }


def _time_figure(comparison: ThreeWay) -> Figure:
    """Draw the three angles, and the errors of both simulators, against time."""
    columns, log = _angles(comparison), comparison.log
    every = max(1, round(_STEP / log.mean_step))
    rows = seen_samples(list(columns.values()), _MOST, every=every)
    way = log.added_mass.joint.way
    figure = panels("time in s", (f"angle in {way}", f"error in {way}"), 460, shares=(0.62, 0.38))
    x = log.time[rows]
    for name, angle in columns.items():
        style = {"mode": "lines", "name": name, "line": _LINES[name]}
        thin = _LINES[name] | {"width": 1.2}
        add(figure, 1, x, angle[rows].astype(np.float32), **style)
        if name != "measured":
            error = (angle - log.angle)[rows].astype(np.float32)
            add(figure, 2, x, error, showlegend=False, **style | {"line": thin})
    return figure


def _phase_figure(comparison: ThreeWay) -> Figure:
    """Draw velocity against angle over the last periods of a log."""
    time, way = comparison.log.time, comparison.log.added_mass.joint.way
    omega = comparison.log.excitation.omega if comparison.log.excitation else 3.0
    late = time > time[-1] - _PERIODS * 2 * np.pi / omega
    figure = panel(f"angle in {way}", f"velocity in {way}/s")
    grid = np.linspace(time[late][0], time[-1], 600)
    for name, angle in _angles(comparison).items():
        smooth = np.convolve(np.interp(grid, time, angle), np.ones(5) / 5, mode="valid")
        velocity = np.gradient(smooth, grid[1] - grid[0])
        x, y = smooth.astype(np.float32), velocity.astype(np.float32)
        figure.add_scatter(x=x, y=y, mode="lines", line=_LINES[name], name=name)
    return figure
