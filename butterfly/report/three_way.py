"""The report of MuJoCo against grey box against log."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
from plotly.graph_objects import Figure, Scatter
from plotly.subplots import make_subplots

from butterfly.report.figures import PALETTE
from butterfly.report.misfit import (
    correlation_figure,
    left_over_numbers,
    misfit_numbers,
    misfit_sentences,
    misfit_table,
)
from butterfly.report.page import Page, Section, Table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from butterfly.compare.three_way import ThreeWay
    from butterfly.identify.judgement.misfit import Misfit
    from butterfly.report.verdict import SaidVerdict

_SIMULATORS = {"MuJoCo": (PALETTE[1], "square"), "grey box": (PALETTE[5], "diamond")}
_STEP = 0.02  # s between drawn points
_DRAWN = 3  # logs drawn in time, phase plane and residual torque
_PERIODS = 4  # of the slowest drawn motion in the phase plane


def three_way_page(
    name: str, description: str, compared: Sequence[ThreeWay], misfit: Misfit, verdict: SaidVerdict
) -> Page:
    """Put together the report of a comparison.

    Parameters
    ----------
    name, description
        Of the data set.
    compared
        Its logs, each simulated twice. The best, the middle and the worst by FIT are drawn.
    misfit
        Of the whole data set, with the same parameters.
    verdict
        On these parameters.
    """
    judged = {log.name: log for log in misfit.logs}
    order = np.argsort([each.fits["grey box"] for each in compared])
    picked = sorted({int(order[k]) for k in (0, len(order) // 2, len(order) - 1)})[:_DRAWN]
    drawn = [compared[k] for k in picked]
    sines = [each for each in compared if each.gains]
    sections = [
        Section(title="Every log", tables=(_table(compared),)),
        Section(
            title="What the model leaves over",
            text="Errors of the grey box, and their correlations in the drawn logs of this page: "
            "where encoder and noise explain them, both curves stay inside the bands.",
            tables=(misfit_table(judged[each.log.name] for each in compared),),
            figures={
                f"left-over-{k}": correlation_figure(judged[each.log.name])
                for k, each in enumerate(drawn)
            },
        ),
        Section(
            title="Time",
            text="The logs that the grey box follows worst, middling and best, from the first "
            "sample on with the recorded input alone.",
            figures={f"time-{k}": _time_figure(each) for k, each in enumerate(drawn)},
        ),
        Section(
            title="Phase plane",
            text="The end of the same logs.",
            figures={f"phase-{k}": _phase_figure(each) for k, each in enumerate(drawn)},
        ),
        Section(
            title="Residual torque",
            text="What all terms of the model leave over of the torque, averaged over short "
            "bumps, against angle and velocity.",
            figures={f"residual-{k}": _residual_figure(each) for k, each in enumerate(drawn)},
        ),
    ]
    if sines:
        sections.insert(
            2,
            Section(
                title="Amplitude and phase error per frequency",
                text="Steady response of each simulator against the log's.",
                figures={"frequency": _frequency_figure(sines)},
            ),
        )
    return Page(
        name=name,
        description=description,
        kind="comparison",
        summary=[*_summary(compared), *misfit_sentences(misfit)],
        sections=sections,
        numbers=verdict.numbers() | _numbers(compared) | {"misfit": misfit_numbers(misfit)},
        verdict=verdict,
    )


def _summary(compared: Sequence[ThreeWay]) -> list[str]:
    fits = {key: np.array([each.fits[key] for each in compared]) for key in _SIMULATORS}
    apart = max(each.difference for each in compared)
    way = compared[0].log.added_mass.joint.way
    return [
        f"{len(compared)} logs, each simulated in MuJoCo and by the grey-box equation with the "
        "same parameters and the recorded input.",
        *(
            f"{key} follows the logs with a median FIT of {np.median(fit):.2f} % "
            f"(worst {fit.min():.2f} %)."
            for key, fit in fits.items()
        ),
        f"The two simulators are nowhere more than {apart:.2g} {way} apart.",
    ]


def _numbers(compared: Sequence[ThreeWay]) -> dict[str, Any]:
    return {
        "logs": [
            {
                "log": each.log.label,
                "fit": each.fits,
                "largest_difference_rad": each.difference,
                "gain_ratio": {k: [abs(g), float(np.angle(g))] for k, g in each.gains.items()},
                "residual_torque": left_over_numbers(each.residual.left_over),
            }
            for each in compared
        ]
    }


def _table(compared: Sequence[ThreeWay]) -> Table:
    rows, way = [], compared[0].log.added_mass.joint.way
    for each in compared:
        errors = [
            f"{100 * (abs(gain) - 1):+.2f} %, {np.degrees(np.angle(gain)):+.2f}°"
            for gain in each.gains.values()
        ] or ["–", "–"]
        fits = [f"{fit:.2f}" for fit in each.fits.values()]
        apart = f"{each.difference:.2g}"
        looks = each.residual.left_over.words("the motor's torque")
        rows.append((each.log.label, *fits, *errors, apart, looks))
    headers = (
        "log",
        *(f"{name}: FIT in %" for name in _SIMULATORS),
        *(f"{name}: amplitude, phase error" for name in _SIMULATORS),
        *(f"simulators apart in {way}", "residual torque looks like"),
    )
    return Table(headers=headers, rows=rows)


def _thinned(each: ThreeWay) -> tuple[slice, dict[str, NDArray[np.float64]]]:
    every = max(1, round(_STEP / each.log.mean_step))
    columns = {"log": each.log.angle, "MuJoCo": each.mujoco, "grey box": each.greybox}
    return slice(None, None, every), columns


def _time_figure(each: ThreeWay) -> Figure:
    rows, columns = _thinned(each)
    way = each.log.added_mass.joint.way
    figure = make_subplots(
        rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.05, row_heights=[0.65, 0.35]
    )
    x = each.log.time[rows].astype(np.float32)
    for name, angle in columns.items():
        colour, dash = _look(name)
        line = {"color": colour, "width": 1.4, "dash": dash}
        y = angle[rows].astype(np.float32)
        figure.add_trace(Scatter(x=x, y=y, mode="lines", line=line, name=name), row=1, col=1)
        if name != "log":
            y = (angle - each.log.angle)[rows].astype(np.float32)
            trace = Scatter(x=x, y=y, mode="lines", line=line, name=name, showlegend=False)
            figure.add_trace(trace, row=2, col=1)
    figure.update_yaxes(title=f"angle in {way}<br>{escape(each.log.label)}", row=1)
    figure.update_yaxes(title=f"error in {way}", row=2)
    figure.update_xaxes(title="time in s", row=2)
    figure.update_layout(height=460)
    return figure


def _phase_figure(each: ThreeWay) -> Figure:
    _, columns = _thinned(each)
    time, way = each.log.time, each.log.added_mass.joint.way
    omega = each.log.excitation.omega if each.log.excitation else 3.0
    late = time > time[-1] - _PERIODS * 2 * np.pi / omega
    figure = Figure()
    grid = np.linspace(time[late][0], time[-1], 600)
    for name, angle in columns.items():
        colour, dash = _look(name)
        even = np.interp(grid, time, angle)
        smooth = np.convolve(even, np.ones(5) / 5, mode="valid")
        velocity = np.gradient(smooth, grid[1] - grid[0])
        line = {"color": colour, "width": 1.2, "dash": dash}
        x, y = smooth.astype(np.float32), velocity.astype(np.float32)
        figure.add_trace(Scatter(x=x, y=y, mode="lines", line=line, name=name))
    figure.update_xaxes(title=f"angle in {way}, {escape(each.log.label)}")
    figure.update_yaxes(title=f"velocity in {way}/s")
    figure.update_layout(height=420)
    return figure


def _residual_figure(each: ThreeWay) -> Figure:
    residual = each.residual
    figure = make_subplots(rows=1, cols=2, shared_yaxes=True, horizontal_spacing=0.04)
    way = each.log.added_mass.joint.way
    panels = {f"angle in {way}": residual.angle, f"velocity in {way}/s": residual.velocity}
    every = max(1, residual.torque.size // 800)
    for column, (title, values) in enumerate(panels.items(), start=1):
        marker = {"color": PALETTE[column - 1], "size": 3}
        x, y = (part[::every].astype(np.float32) for part in (values, residual.torque))
        trace = Scatter(x=x, y=y, mode="markers", marker=marker, showlegend=False)
        figure.add_trace(trace, row=1, col=column)
        figure.update_xaxes(title=f"{title}, {escape(each.log.label)}", row=1, col=column)
    figure.update_yaxes(title="τ_ε in N m", row=1, col=1)
    figure.update_layout(height=360)
    return figure


def _frequency_figure(sines: Sequence[ThreeWay]) -> Figure:
    figure = make_subplots(rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.06)
    omegas = [each.log.excitation.omega for each in sines if each.log.excitation]
    texts = [escape(each.log.label) for each in sines]
    for name, (colour, symbol) in _SIMULATORS.items():
        gains = np.array([each.gains[name] for each in sines])
        marker = {"color": colour, "symbol": symbol, "size": 7}
        for row, values in ((1, 100 * (np.abs(gains) - 1)), (2, np.degrees(np.angle(gains)))):
            trace = Scatter(
                x=omegas,
                y=values,
                text=texts,
                mode="markers",
                marker=marker,
                name=name,
                showlegend=row == 1,
            )
            figure.add_trace(trace, row=row, col=1)
    figure.update_yaxes(title="amplitude error in %", row=1)
    figure.update_yaxes(title="phase error in °", row=2)
    figure.update_xaxes(title="ω in rad/s", row=2)
    figure.update_layout(height=480)
    return figure


def _look(name: str) -> tuple[str, str]:
    if name == "log":
        return PALETTE[0], "solid"
    return _SIMULATORS[name][0], "dot" if name == "grey box" else "dash"
