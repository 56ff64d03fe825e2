"""The figures of a comparison: one log, what MuJoCo and the grey box make of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from plotly.graph_objects import Figure, Scatter
from plotly.subplots import make_subplots

from butterfly.comparison.three_way import ThreeWay
from butterfly.model.parameters import JointKind
from butterfly.report.figures import PALETTE, add, seen_samples

SIMULATORS = ("MuJoCo", "grey box")

_LOOKS = {  # colours and dashes
    "log": (PALETTE[0], "solid"),
    "MuJoCo": (PALETTE[1], "dash"),
    "grey box": (PALETTE[5], "dot"),
}

_STEP = 0.02  # s between drawn points
_MOST = 4000  # points of a curve
_PERIODS = 4  # of the drawn motion in the phase plane
_DOTS = 800  # of a residual torque


def _angles(each: ThreeWay) -> dict[str, NDArray[np.float64]]:
    return {"log": each.log.angle, "MuJoCo": each.mujoco, "grey box": each.greybox}


def time_comparison(each: ThreeWay) -> Figure:
    """Draw the three angles, and the errors of both simulators, against time."""
    columns, log = _angles(each), each.log
    every = max(1, round(_STEP / log.mean_step))
    rows = seen_samples(list(columns.values()), _MOST, every=every)
    way = log.added_mass.joint.way
    figure = make_subplots(
        rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.05, row_heights=[0.62, 0.38]
    )
    x = log.time[rows]
    for name, angle in columns.items():
        colour, dash = _LOOKS[name]
        style = {
            "mode": "lines",
            "name": name,
            "line": {"color": colour, "width": 1.4, "dash": dash},
        }
        add(figure, 1, x, angle[rows].astype(np.float32), **style)
        if name != "log":
            error = (angle - log.angle)[rows].astype(np.float32)
            add(figure, 2, x, error, showlegend=False, **style)
    figure.update_yaxes(title=f"angle in {way}", row=1)
    figure.update_yaxes(title=f"error in {way}", row=2)
    figure.update_xaxes(title="time in s", row=2)
    figure.update_layout(height=460)
    return figure


def phase_comparison(each: ThreeWay) -> Figure:
    """Draw velocity against angle over the last periods of a log."""
    time, way = each.log.time, each.log.added_mass.joint.way
    omega = each.log.excitation.omega if each.log.excitation else 3.0
    late = time > time[-1] - _PERIODS * 2 * np.pi / omega
    figure = Figure()
    grid = np.linspace(time[late][0], time[-1], 600)
    for name, angle in _angles(each).items():
        colour, dash = _LOOKS[name]
        smooth = np.convolve(np.interp(grid, time, angle), np.ones(5) / 5, mode="valid")
        velocity = np.gradient(smooth, grid[1] - grid[0])
        line = {"color": colour, "width": 1.2, "dash": dash}
        x, y = smooth.astype(np.float32), velocity.astype(np.float32)
        figure.add_trace(Scatter(x=x, y=y, mode="lines", line=line, name=name))
    figure.update_xaxes(title=f"angle in {way}")
    figure.update_yaxes(title=f"velocity in {way}/s")
    figure.update_layout(height=420)
    return figure


def residual_comparison(each: ThreeWay) -> Figure:
    """Draw the torque that the model leaves over against angle and velocity."""
    residual, joint = each.residual, each.log.added_mass.joint
    figure = make_subplots(rows=1, cols=2, shared_yaxes=True, horizontal_spacing=0.04)
    panels = {
        f"angle in {joint.way}": residual.angle,
        f"velocity in {joint.way}/s": residual.velocity,
    }
    every = max(1, residual.torque.size // _DOTS)
    for column, (title, values) in enumerate(panels.items(), start=1):
        marker = {"color": PALETTE[column - 1], "size": 3}
        x, y = (part[::every].astype(np.float32) for part in (values, residual.torque))
        trace = Scatter(x=x, y=y, mode="markers", marker=marker, showlegend=False)
        figure.add_trace(trace, row=1, col=column)
        figure.update_xaxes(title=title, row=1, col=column)
    unit = "force left over in N" if joint is JointKind.SLIDE else "torque left over in N m"
    figure.update_yaxes(title=unit, row=1, col=1)
    figure.update_layout(height=360)
    return figure
