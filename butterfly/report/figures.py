"""The figures of an identification report, as plotly figures."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from plotly.graph_objects import Figure, Scatter
from plotly.subplots import make_subplots

from butterfly.model.harmonic import quasi_linear_response
from butterfly.model.linear import frequency_response

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from butterfly.identify.identification import Identification
    from butterfly.identify.predict import FreeRun
    from butterfly.signals.frequency_response import ResponsePoint

PALETTE = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#F0E442")
"""Okabe and Ito's colours, told apart by colour-blind readers."""

_SYMBOLS = ("circle", "square", "diamond", "triangle-up", "triangle-down", "star", "pentagon")
_SEEN = 20_000  # quanta of the largest number: a pixel is ten or more
_DISPLAY_STEP = 0.02  # s between the points of a drawn time series


def frequency_response_figure(identification: Identification) -> Figure:
    """Gain and phase measured and modelled, and what is left, against frequency.

    The model is shown where it was fitted, at each log's own swing (open markers), and in the
    limit of small swings without Coulomb friction (lines).
    """
    figure = make_subplots(
        rows=4,
        cols=1,
        shared_xaxes=True,
        vertical_spacing=0.03,
        row_heights=[0.36, 0.26, 0.19, 0.19],
    )
    data, parameters = identification.data, identification.estimate.parameters
    omegas = [point.omega for point in data.sines] or [1.0, 10.0]
    curve = np.geomspace(0.8 * min(omegas), 1.15 * max(omegas), 400)
    for index, mass in enumerate(data.masses):
        points = [p for p in data.sines if p.added_mass == mass]
        loaded = parameters.with_added_mass(mass)
        style = {"color": PALETTE[index % len(PALETTE)]}
        symbol = _SYMBOLS[index % len(_SYMBOLS)]
        name = f"{1e3 * mass.mass:g} g"
        small = frequency_response(loaded, curve)
        omega = np.array([p.omega for p in points])
        gain = np.array([p.gain for p in points])
        model = quasi_linear_response(loaded, omega, [p.amplitude for p in points])
        common = {"legendgroup": name, "hovertemplate": "%{x:.3g} rad/s: %{y:.4g}"}
        line = {"mode": "lines", "line": {**style, "width": 1}, "showlegend": False}
        open_marker = {"symbol": f"{symbol}-open", "size": 11, **style}
        _add(figure, 1, curve, np.abs(small), name=f"{name}, small swings", **line, **common)
        _add(figure, 2, curve, _degrees(small), name=f"{name}, small swings", **line, **common)
        for row, values in ((1, np.abs(model)), (2, _degrees(model))):
            _add(
                figure,
                row,
                omega,
                values,
                name=f"{name}, model",
                mode="markers",
                marker=open_marker,
                showlegend=row == 1,
                **common,
            )
        measured = {"mode": "markers", "marker": {"symbol": symbol, "size": 6, **style}}
        gain_error, phase_error = _errors(points)
        ratio = gain / model
        panels = (
            (np.abs(gain), gain_error),
            (_degrees(gain), phase_error),
            (100 * (np.abs(ratio) - 1), 100 * gain_error / np.abs(gain)),
            (_degrees(ratio), phase_error),
        )
        for row, (values, errors) in enumerate(panels, start=1):
            bars = {"array": 2 * errors, "thickness": 1, "width": 2}
            _add(
                figure,
                row,
                omega,
                values,
                name=f"{name}, measured",
                error_y=bars,
                showlegend=row == 1,
                **measured,
                **common,
            )
    figure.update_xaxes(type="log", dtick="D1")
    figure.update_xaxes(title="ω in rad/s", row=4)
    way = data.joint.way
    unit = f"{way}/V" if data.input_kind == "voltage" else f"{way} per unit"
    titles = (f"|θ/u| in {unit}", "phase in °", "gain error in %", "phase error in °")
    for row, title in enumerate(titles, start=1):
        figure.update_yaxes(title=title, row=row)
    figure.update_yaxes(type="log", row=1)
    figure.update_layout(height=820)
    return figure


def time_figure(run: FreeRun) -> Figure:
    """Measured and simulated angle of one log, and their difference, against time."""
    time, angle, simulated, difference = _curves(run)
    way = run.log.added_mass.joint.way
    figure = make_subplots(
        rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.05, row_heights=[0.7, 0.3]
    )
    lines = {"mode": "lines", "hovertemplate": f"%{{x:.2f}} s: %{{y:.4f}} {way}"}
    _add(figure, 1, time, angle, name="measured", line={"color": PALETTE[0], "width": 1.5}, **lines)
    dashed = {"color": PALETTE[5], "width": 1.5, "dash": "dot"}
    _add(figure, 1, time, simulated, name="simulated", line=dashed, **lines)
    grey = {"color": "#888888", "width": 1}
    _add(figure, 2, time, difference, name="difference", line=grey, **lines)
    figure.update_yaxes(title=f"angle in {way}", row=1)
    figure.update_yaxes(title=f"difference in {way}", row=2)
    figure.update_xaxes(title="time in s", row=2)
    figure.update_layout(height=460)
    return figure


def time_figures(runs: Sequence[FreeRun]) -> dict[str, Any]:
    """Return what a page needs to draw `time_figure` of each run, as JSON has it.

    Returns
    -------
    ``data`` and ``layout`` of all the figures, their traces without points; and ``curves``, for
    each run the x of all its traces, then the y of each.
    """
    common = time_figure(runs[0]).to_dict()
    traces = [{k: v for k, v in each.items() if k not in {"x", "y"}} for each in common["data"]]
    layout = {key: value for key, value in common["layout"].items() if key != "template"}
    curves = [[packable(curve) for curve in _curves(run)] for run in runs]
    return {"data": traces, "layout": layout, "curves": curves}


def _curves(run: FreeRun) -> tuple[NDArray[np.float32], ...]:
    """Return (n,) times in s, and measured, simulated and difference of angles in rad."""
    log = run.log
    every = max(1, round(_DISPLAY_STEP / log.mean_step))
    time, angle, simulated = (
        np.asarray(column[::every], dtype=np.float32)
        for column in (log.time, log.angle, run.simulated)
    )
    return time, angle, simulated, angle - simulated


def packable(values: NDArray[np.floating[Any]]) -> dict[str, Any]:
    """Return (n,) numbers as steps from each to the next, which pack into a byte or so each.

    Returns
    -------
    ``quantum``, to whole multiples of which they are rounded: less than a screen shows; and
    ``steps``, in quanta, the first from 0, None for what is no number.
    """
    there = np.isfinite(values)
    finite = np.asarray(values[there], dtype=np.float64)
    quantum = float(f"{np.max(np.abs(finite), initial=0.0) / _SEEN:.3g}") or 1.0
    steps = np.full(values.size, None, dtype=object)
    steps[there] = np.diff(np.rint(finite / quantum), prepend=0.0).astype(np.int64)
    return {"quantum": quantum, "steps": steps.tolist()}


def log_figure(
    time: NDArray[np.float64],
    columns: dict[str, NDArray[np.float64]],
    intervals: tuple[NDArray[np.float64], NDArray[np.float64]],
) -> Figure:
    """Draw a log against time, a panel for each column and one for the sampling intervals.

    Parameters
    ----------
    time
        (n,) stamps in s.
    columns
        (n,) values by axis title.
    intervals
        (n - 1,) instants in s and (n - 1,) lengths in ms of the sampling intervals.
    """
    panels = {title: (time, values) for title, values in columns.items()}
    panels["interval in ms"] = intervals
    rows = len(panels)
    figure = make_subplots(rows=rows, cols=1, shared_xaxes=True, vertical_spacing=0.03)
    for row, (title, (x, y)) in enumerate(panels.items(), start=1):
        colour = PALETTE[(row - 1) % len(PALETTE)]
        style = {"mode": "lines", "line": {"color": colour, "width": 1}}
        if row == rows:
            style = {"mode": "markers", "marker": {"color": colour, "size": 2}}
        _add(figure, row, x.astype(np.float32), y.astype(np.float32), showlegend=False, **style)
        figure.update_yaxes(title=title, row=row)
    figure.update_xaxes(title="time in s", row=rows)
    figure.update_layout(height=220 * rows + 80)
    return figure


def _add(figure: Figure, row: int, x: object, y: object, **style: object) -> None:
    figure.add_trace(Scatter(x=x, y=y, **style), row=row, col=1)


def _degrees(response: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Phase within -270 .. 90 degrees, so that a lag beyond 180 does not jump to the top."""
    return np.asarray(np.degrees(np.angle(1j * response)) - 90)


def _errors(points: list[ResponsePoint]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return standard errors of gain, in its unit, and of phase in degrees."""
    gain = np.array([p.angle.amplitude_error / abs(p.input) for p in points])
    phase = np.array([np.degrees(p.angle.phase_error) for p in points])
    return gain, phase
