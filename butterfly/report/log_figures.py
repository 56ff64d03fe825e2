"""Figures of one simulated log: against time, its spectrum, correlations of its residual.

A page has each of them for every log, as a `Series`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from plotly.graph_objects import Figure, Scatter
from plotly.subplots import make_subplots

from butterfly.identification.diagnostics.misfit import LogMisfit
from butterfly.identification.diagnostics.residuals import LEVELS, Curve, ErrorBand
from butterfly.identification.free_run import FreeRun
from butterfly.identification.inference.covariance import CONFIDENCE
from butterfly.report.figures import GREY, PALETTE, SHADE, Series, add, packable, seen_samples
from butterfly.signals.spectrum import periodogram, resample, uniform_grid

_STEP = 0.02  # s between drawn points
_MOST, _LEAST = 150_000, 600  # points of all the logs of a page, and of each
_OF_SPECTRUM = 250  # points, evenly over the logarithm of the frequency
_MOST_SAMPLES = 2**20  # that a spectrum is taken of
_SHADES = ("rgba(128,128,128,0.15)", "rgba(128,128,128,0.25)")  # of outer and inner band


def time_figure(run: FreeRun, band: ErrorBand | None, *, most: int = _MOST) -> Figure:
    """Draw measured and simulated angle, and their difference in its band, against time.

    ``most`` points are enough.
    """
    time, angle, simulated, lower, upper, difference = _time_curves(run, band, most)
    way = run.log.added_mass.joint.way
    figure = make_subplots(
        rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.05, row_heights=[0.62, 0.38]
    )
    lines = {"mode": "lines", "hovertemplate": f"%{{x:.2f}} s: %{{y:.4f}} {way}"}
    add(figure, 1, time, angle, name="measured", line={"color": PALETTE[0], "width": 1.5}, **lines)
    dashed = {"color": PALETTE[5], "width": 1.5, "dash": "dot"}
    add(figure, 1, time, simulated, name="simulated", line=dashed, **lines)
    edge = {"mode": "lines", "line": {"color": GREY, "width": 0}, "hoverinfo": "skip"}
    add(figure, 2, time, lower, showlegend=False, **edge)
    name = f"{100 * CONFIDENCE:.0f} % band of parameters and sensor"
    add(figure, 2, time, upper, name=name, fill="tonexty", fillcolor=SHADE, **edge)
    thin = {"color": PALETTE[0], "width": 1}
    add(figure, 2, time, difference, name="difference", showlegend=False, line=thin, **lines)
    figure.update_yaxes(title=f"angle in {way}", row=1)
    figure.update_yaxes(title=f"measured −<br>simulated in {way}", row=2)
    figure.update_xaxes(title="time in s", row=2)
    figure.update_layout(height=500)
    return figure


def time_series(runs: Sequence[FreeRun], bands: Sequence[ErrorBand | None]) -> Series:
    """Return `time_figure` of each run."""
    most = max(_MOST // len(runs), _LEAST)
    logs = zip(runs, bands, strict=True)
    return Series.of(
        time_figure(runs[0], bands[0], most=_LEAST),
        [[[packable(curve) for curve in _time_curves(*each, most)]] for each in logs],
    )


def _time_curves(
    run: FreeRun, band: ErrorBand | None, most: int
) -> tuple[NDArray[np.floating[Any]], ...]:
    """Return (n,) times in s, and measured, simulated, limits and difference of angles in rad."""
    log, difference = run.log, run.log.angle - run.simulated
    reach = np.full_like(difference, np.nan)
    if band is not None:
        reach = np.interp(log.time, band.time, band.reach, left=np.nan, right=np.nan)
    every = max(1, round(_STEP / log.mean_step))
    some = seen_samples([log.angle, difference], most, every=every)
    columns = (log.angle, run.simulated, -reach, reach, difference)
    with np.errstate(over="ignore"):  # what ran away is not drawn
        return log.time[some], *(column[some].astype(np.float32) for column in columns)


def spectrum_figure(run: FreeRun, misfit: LogMisfit) -> Figure:
    """Draw amplitudes of a log's angle, and of its residual, over frequency."""
    omega, *curves = _spectra(run, misfit)
    way = run.log.added_mass.joint.way
    looks = {
        "measured angle": {"color": GREY, "width": 1},
        "measured − simulated": {"color": PALETTE[0], "width": 1.4},
        "what the sensor explains": {"color": PALETTE[5], "width": 1.2, "dash": "dash"},
    }
    hover = f"%{{x:.3g}} rad/s: %{{y:.3g}} {way}"
    figure = Figure()
    for (name, line), values in zip(looks.items(), curves, strict=True):
        figure.add_trace(
            Scatter(x=omega, y=values, name=name, line=line, mode="lines", hovertemplate=hover)
        )
    figure.update_xaxes(title="ω in rad/s", type="log")
    figure.update_yaxes(title=f"amplitude in {way}", type="log")
    figure.update_layout(height=340)
    return figure


def spectrum_series(runs: Sequence[FreeRun], misfits: Sequence[LogMisfit]) -> Series:
    """Return `spectrum_figure` of each run."""
    curves = [
        [[packable(curve, logarithmic=True) for curve in _spectra(*each)]]
        for each in zip(runs, misfits, strict=True)
    ]
    return Series.of(spectrum_figure(runs[0], misfits[0]), curves)


def _spectra(run: FreeRun, misfit: LogMisfit) -> tuple[NDArray[np.float64], ...]:
    """Return frequencies in rad/s, and amplitudes in rad of a sine that would look so.

    Of several frequencies that share a point, it is the largest amplitude.
    """
    log = run.log
    every = max(1, log.time.size // _MOST_SAMPLES)
    time = log.time[::every]
    grid = uniform_grid(time)
    columns = [
        resample(time, each[::every], grid) for each in (log.angle, log.angle - run.simulated)
    ]
    step = float(grid[1] - grid[0])
    with np.errstate(over="ignore", invalid="ignore"):  # of a run that ran away there is none
        spectra = [periodogram(values - values.mean(), step) for values in columns]
    omega = spectra[0][0]
    spots = np.geomspace(omega[0], omega[-1], _OF_SPECTRUM + 1)[:-1]
    edges = np.unique(np.searchsorted(omega, spots))
    peaks = [np.sqrt(4 * np.maximum.reduceat(power, edges) / grid.size) for _, power in spectra]
    sensor = np.full(edges.size, 2 * misfit.sensor.spread / np.sqrt(grid.size))
    return (omega[edges], *peaks, sensor)


def correlation_figure(log: LogMisfit) -> Figure:
    """Draw autocorrelation and cross-correlation of a log's residual, with their bands."""
    figure = make_subplots(rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.06)
    curves = {
        "autocorrelation": log.autocorrelation,
        "cross-correlation<br>with the input": log.cross_correlation,
    }
    for row, (title, curve) in enumerate(curves.items(), start=1):
        lag, *limits, values = _band_and_curve(curve)
        for number, limit in enumerate(limits):
            style: dict[str, Any] = {"showlegend": False}
            if number % 2:
                name = f"{100 * LEVELS[1 - number // 2]:.0f} % band of the sensors"
                style = {"fill": "tonexty", "fillcolor": _SHADES[number // 2], "name": name}
                style["showlegend"] = row == 1
            line = {"color": GREY, "width": 1, "dash": ("dot", "dash")[number // 2]}
            add(figure, row, lag, limit, mode="lines", line=line, hoverinfo="skip", **style)
        line = {"color": PALETTE[0], "width": 1.4}
        add(figure, row, lag, values, mode="lines", line=line, name="the log", showlegend=row == 1)
        figure.update_yaxes(title=title, row=row)
    figure.update_xaxes(title="lag in s", row=2)
    figure.update_layout(height=480)
    return figure


def correlation_series(logs: Sequence[LogMisfit]) -> Series:
    """Return `correlation_figure` of each log."""
    curves = [
        [
            [packable(line) for line in _band_and_curve(curve)]
            for curve in (log.autocorrelation, log.cross_correlation)
        ]
        for log in logs
    ]
    return Series.of(correlation_figure(logs[0]), curves)


def _band_and_curve(curve: Curve | None) -> list[NDArray[np.float32]]:
    """Return (l,) lags in s, limits of outer and inner band, and the values; all empty of none."""
    if curve is None:
        return [np.empty(0, dtype=np.float32)] * (2 + 2 * len(LEVELS))
    (inner, outer), centre = curve.reach, curve.centre
    limits = (centre - outer, centre + outer, centre - inner, centre + inner)
    return [each.astype(np.float32) for each in (curve.lag, *limits, curve.value)]
