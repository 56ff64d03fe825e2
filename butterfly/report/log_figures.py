"""Figures of one log, as recorded, simulated and predicted, and of the residuals of all."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from plotly.graph_objects import Figure
from plotly.subplots import make_subplots
from scipy import fft
from scipy.special import digamma

from butterfly.files import finite
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.free_run import FreeRun
from butterfly.identification.predict import OF_NEW_LOG, OF_PARAMETERS, Prediction
from butterfly.identification.residuals import ErrorBand, LogResiduals, Residuals
from butterfly.identification.sensor_errors import Curve
from butterfly.identification.test_functions import ResidualTorque
from butterfly.logs.log import Log
from butterfly.model.parameters import JointKind
from butterfly.report.figures import GREY, PALETTE, Series, add, look, panel, panels, seen_samples
from butterfly.report.finding_texts import finding_text
from butterfly.report.inspection import RESIDUAL_CAPTION, residual_row
from butterfly.report.page import Page, PageTable, Section
from butterfly.signals.frequency_response import periodogram, resample
from butterfly.verdict import CONFIDENCE

_STEP = 0.02  # s between drawn points
_MOST, _LEAST = 150_000, 600  # points of all the logs of a page, and of each
_OF_SPECTRUM = 250  # points, evenly over the logarithm of the frequency
_MOST_SAMPLES = 2**20  # that a spectrum is taken of
_MOST_RECORDED = 20_000  # samples drawn of each column of a log
_DRAWN = 12  # logs at most, of which a page of predictions shows the course
_BANDS = {OF_NEW_LOG: (PALETTE[4], 0.35), OF_PARAMETERS: (PALETTE[1], 0.8)}  # colour, opacity
_SHADE = "rgba(128,128,128,0.25)"  # of the band
_SIMULATED = {"color": PALETTE[1], "width": 7}  # so wide that it is seen below what was measured
_MEASURED = {"color": PALETTE[0], "width": 2}
_PERIODS = 5  # of a sine, at the end of a log, that are seen first


def recorded_figure(log: Log) -> Figure:
    """Draw a log against time, a panel for each column and one for the sampling intervals."""
    way = log.added_mass.joint.way
    titles = {"input": f"input in {log.input_kind.unit}", "angle": f"angle in {way}"}
    titles |= {"velocity": f"velocity in {way}/s", "supply": "supply in V", "enabled": "enabled"}
    curves = {titles[k]: (log.time, values) for k, values in log.columns().items() if k in titles}
    curves["interval in ms"] = ((log.time[1:] + log.time[:-1]) / 2, 1e3 * np.diff(log.time))
    count = len(curves)
    figure = panels("time in s", [*curves], 220 * count + 80, spacing=0.03)
    for row, (x, y) in enumerate(curves.values(), start=1):
        colour, _ = look(row - 1)
        style = {"mode": "lines", "line": {"color": colour, "width": 1}}
        if row == count:
            style = {"mode": "markers", "marker": {"color": colour, "size": 2}}
        some = seen_samples([y], _MOST_RECORDED)
        add(figure, row, x[some], y[some].astype(np.float32), showlegend=False, **style)
    return figure


def time_figure(run: FreeRun, band: ErrorBand | None, *, most: int = _MOST) -> Figure:
    """Draw measured and simulated motion, and their difference in its band, against time."""
    time, simulated, angle, lower, upper, difference, *goal = _time_curves(run, band, most)
    way = run.log.unit
    titles = (f"{run.log.measures} in {way}", f"measured −<br>simulated in {way}")
    figure = panels("time in s", titles, 500, shares=(0.62, 0.38))
    lines = {"mode": "lines", "hovertemplate": f"%{{x:.2f}} s: %{{y:.4f}} {way}"}
    add(figure, 1, time, simulated, name="simulated", line=_SIMULATED, **lines)
    add(figure, 1, time, angle, name="measured", line=_MEASURED, **lines)
    edge = {"mode": "lines", "line": {"color": GREY, "width": 0}, "hoverinfo": "skip"}
    add(figure, 2, time, lower, showlegend=False, **edge)
    name = f"{100 * CONFIDENCE:.0f} % band of parameters and sensor"
    add(figure, 2, time, upper, name=name, fill="tonexty", fillcolor=_SHADE, **edge)
    thin = {"color": PALETTE[5], "width": 1}
    add(figure, 2, time, difference, name="difference", showlegend=False, line=thin, **lines)
    if goal:
        dotted = {"color": GREY, "width": 1.2, "dash": "dot"}
        add(figure, 1, time, *goal, name="set-point", line=dotted, **lines)
    return figure


def time_series(runs: Sequence[FreeRun], bands: Sequence[ErrorBand | None]) -> Series:
    """Return `time_figure` of each run."""
    most = max(_MOST // len(runs), _LEAST)
    curves = [_time_curves(*pair, most) for pair in zip(runs, bands, strict=True)]
    longest = max(map(len, curves))  # those of servos have a set-point besides
    first = [len(columns) for columns in curves].index(longest)
    nothing = [np.full_like(columns[0], np.nan) for columns in curves]
    filled = [
        (*columns, *[gap] * (longest - len(columns)))
        for columns, gap in zip(curves, nothing, strict=True)
    ]
    figure = time_figure(runs[first], bands[first], most=_LEAST)
    return Series.of(
        figure, [[columns] for columns in filled], [first_stretch(run.log) for run in runs]
    )


def first_stretch(log: Log) -> tuple[float, float] | None:
    """Return the times in s that are seen first: the last periods of a sine, or all (None)."""
    first, last = float(log.time[0]), float(log.time[-1])
    if log.excitation is None:
        return None
    begin = last - _PERIODS * math.tau / log.excitation.omega
    return (begin, last) if begin > first else None


def _time_curves(
    run: FreeRun, band: ErrorBand | None, most: int
) -> tuple[NDArray[np.floating[Any]], ...]:
    """Return (n,) times in s, simulated, measured, limits, difference; a like set-point last."""
    log, difference = run.log, run.log.measured - run.simulated
    half_width = np.full_like(difference, np.nan)
    if band is not None:
        half_width = np.interp(log.time, band.time, band.half_width, left=np.nan, right=np.nan)
    every = max(1, round(_STEP / log.mean_step))
    some = seen_samples([log.measured, difference], most, every=every)
    columns = [run.simulated, log.measured, -half_width, half_width, difference]
    if log.setpoint is not None and log.servo and log.servo.of_speed == log.integrated:
        columns.append(log.setpoint)
    with np.errstate(over="ignore"):  # what ran away is not drawn
        return log.time[some], *(column[some].astype(np.float32) for column in columns)


def spectrum_figure(run: FreeRun, residuals: LogResiduals) -> Figure:
    """Draw amplitudes of a log's motion, and of its residual, over frequency."""
    omega, *curves = _spectra(run, residuals)
    way = run.log.unit
    looks = {
        f"measured {run.log.measures}": {"color": GREY, "width": 1},
        "measured − simulated": {"color": PALETTE[0], "width": 1.4},
        "sensor noise": {"color": PALETTE[5], "width": 1.2, "dash": "dash"},
    }
    hover = f"%{{x:.3g}} rad/s: %{{y:.3g}} {way}"
    figure = panel("frequency in rad/s", f"amplitude in {way}", 340)
    figure.update_xaxes(type="log").update_yaxes(type="log")
    for (name, line), values in zip(looks.items(), curves, strict=True):
        figure.add_scatter(
            x=omega, y=values, name=name, line=line, mode="lines", hovertemplate=hover
        )
    return figure


def spectrum_series(runs: Sequence[FreeRun], residuals: Sequence[LogResiduals]) -> Series:
    """Return `spectrum_figure` of each run."""
    curves = [[_spectra(*pair)] for pair in zip(runs, residuals, strict=True)]
    return Series.of(spectrum_figure(runs[0], residuals[0]), curves)


def _spectra(run: FreeRun, residuals: LogResiduals) -> tuple[NDArray[np.float64], ...]:
    """Return (n,) frequencies in rad/s; amplitudes of motion, residual and sensor noise."""
    log = run.log
    every = max(1, log.time.size // _MOST_SAMPLES)
    time = log.time[::every]
    grid = np.linspace(time[0], time[-1], fft.next_fast_len(time.size, real=True))
    measured = log.measured
    columns = [
        resample(time, signal[::every], grid) for signal in (measured, measured - run.simulated)
    ]
    step = float(grid[1] - grid[0])
    with np.errstate(over="ignore", invalid="ignore"):  # of a run that ran away there is none
        spectra = [periodogram(values - values.mean(), step) for values in columns]
    omega = spectra[0][0]
    spots = np.geomspace(omega[0], omega[-1], _OF_SPECTRUM + 1)[:-1]
    edges = np.unique(np.searchsorted(omega, spots))
    peaks = [np.sqrt(4 * np.maximum.reduceat(power, edges) / grid.size) for _, power in spectra]
    counts = np.diff(edges, append=omega.size)  # of noise a peak is the largest of so many
    sensor = (
        2 * residuals.sensor.spread * np.sqrt((digamma(counts + 1) + np.euler_gamma) / grid.size)
    )
    return (omega[edges], *peaks, sensor)


def correlation_figure(log: LogResiduals) -> Figure:
    """Draw autocorrelation and cross-correlation of a log's residual, with their bands."""
    titles = ("autocorrelation", "cross-correlation<br>with the input")
    figure = panels("lag in s", titles, 480, spacing=0.06)
    for row, curve in enumerate((log.autocorrelation, log.cross_correlation), start=1):
        lag, lower, upper, values = _band_and_curve(curve)
        dashed = {"color": GREY, "width": 1, "dash": "dash"}
        edge = {"mode": "lines", "line": dashed, "hoverinfo": "skip"}
        add(figure, row, lag, lower, showlegend=False, **edge)
        shade = {"fill": "tonexty", "fillcolor": _SHADE, "showlegend": row == 1}
        name = f"{100 * CONFIDENCE:.0f} % band of sensor noise"
        add(figure, row, lag, upper, name=name, **shade, **edge)
        line = {"color": PALETTE[0], "width": 1.4}
        add(figure, row, lag, values, mode="lines", line=line, name="the log", showlegend=row == 1)
    return figure


def correlation_series(logs: Sequence[LogResiduals]) -> Series:
    """Return `correlation_figure` of each log."""
    curves = [[*map(_band_and_curve, (log.autocorrelation, log.cross_correlation))] for log in logs]
    return Series.of(correlation_figure(logs[0]), curves)


def _band_and_curve(curve: Curve | None) -> list[NDArray[np.float32]]:
    """Return (l,) lags in s, limits of the band, and the values; all empty of none."""
    if curve is None:
        return [np.empty(0, dtype=np.float32)] * 4
    limits = (curve.centre - curve.half_width, curve.centre + curve.half_width)
    return [column.astype(np.float32) for column in (curve.lag, *limits, curve.value)]


def with_bands(predictions: Sequence[Prediction], measured: bool, page: Page) -> Page:
    """Return the page of predictions with time plots of all logs, or of some evenly picked ones."""
    count = len(predictions)
    picked = np.unique(np.linspace(0, count - 1, min(count, _DRAWN)).round().astype(int))
    drawn = [predictions[number] for number in picked]
    some = f"{len(drawn)} of {count} logs. " if len(drawn) < count else ""
    courses = Section(
        title="In time",
        text=f"{some}95 % bands. Blue: a new log, with the model error. Orange: the model, "
        "with the uncertainty of its parameters. Below: difference to the free run.",
        series={
            "bands": Series.of_figures(
                [band_figure(prediction, measured=measured) for prediction in drawn],
                [first_stretch(prediction.run.log) for prediction in drawn],
            )
        },
    )
    return replace(
        page,
        sections=[courses, *page.sections],
        logs=[prediction.run.log.label for prediction in drawn],
        pictures={"bands": partial(band_figure, drawn[0], measured=measured)},
    )


def band_figure(prediction: Prediction, *, measured: bool) -> Figure:
    """Draw motion and bands against time, and below both less the free run; if so, ``measured``."""
    way = prediction.run.log.unit
    titles = (f"{prediction.run.log.measures} in {way}", f"motion − free run<br>in {way}")
    figure = panels("time in s", titles, 460, shares=(0.55, 0.45))
    centre = prediction.run.simulated[prediction.samples]
    lines = {"free run": (centre, PALETTE[5], 6.0)}
    if measured:
        lines["measured"] = prediction.measured, PALETTE[0], 1.5
    there_and_back = np.concatenate([prediction.time, prediction.time[::-1]])
    for row, about in ((1, np.zeros_like(centre)), (2, centre)):
        common = {"mode": "lines", "showlegend": row == 1}
        for name, (colour, opacity) in _BANDS.items():
            if name not in prediction.bands:
                continue
            band = prediction.bands[name]
            outline = np.concatenate([band.upper - about, (band.lower - about)[::-1]])
            shade = {"fill": "toself", "fillcolor": colour, "opacity": opacity}
            shade |= {"line": {"width": 0, "color": colour}, "hoverinfo": "skip", **common}
            y = outline.astype(np.float32)
            add(figure, row, there_and_back, y, name=f"95 %, {name}", **shade)
        for name, (angle, colour, width) in lines.items():
            style = {"line": {"width": width if row == 1 else 1.5, "color": colour}, **common}
            style["hovertemplate"] = f"%{{x:.2f}} s: %{{y:.4f}} {way}"
            y = (angle - about).astype(np.float32)
            add(figure, row, prediction.time, y, name=name, **style)
    return figure


_EXPLAINED = (
    "The log with the largest error. Residual torque, averaged over short intervals in which the "
    "joint moves: a missing term that depends on time, angle or velocity shows as a curve. "
    "Autocorrelation of the free run's error, and its cross-correlation with past input: if sensor "
    "noise explains it, both stay within the bands."
)
_MOST_LOGS = 6000  # instants of a panel


def residual_sentences(residuals: Residuals) -> list[str]:
    """Say how large the residuals of all logs are, and what explains them."""
    count, outside = len(residuals.counted), residuals.outside
    lead = f"In {outside} of {count} logs the error exceeds"
    if count == 1:
        lead = "The error exceeds" if outside else "The error does not exceed"
    elif not outside:
        lead = f"In none of the {count} logs does the error exceed"
    names = [log.name for log in residuals.logs if not log.counted]
    lost = [f"Not counted, as free runs near the upright go astray: {', '.join(names)}."] * bool(
        names
    )
    return [
        f"{lead} sensor noise (95 % bands). "
        f"Over all logs the error is {100 * residuals.relative:.2g} % of the motion, "
        f"{100 * residuals.remaining:.2g} % after small changes of the parameters; sensor noise is "
        f"{100 * residuals.explained:.2g} %.",
        *lost,
        *(finding_text(finding, {}) for finding in residuals.missing.findings),
    ]


def residual_table(logs: Sequence[LogResiduals], picks: Sequence[int]) -> PageTable:
    """Make a table with a row per log, each of which chooses a log by its number."""
    rows = finite([{"log": log.label} | residual_row(log) for log in logs])
    table = PageTable.of("", rows, caption=RESIDUAL_CAPTION)
    return table.on_page()._replace(name="residuals", picks=picks)


def with_residual_figures(
    data: DataSet, estimate: Estimate, number: int, residuals: LogResiduals, page: Page
) -> Page:
    """Return a page with the residual torque and the correlations of a log, by its number."""
    setting = data.simulations.setting(number, estimate)
    torque = ResidualTorque.of(data.logs[number], setting.parameters, setting.zero)
    figures = {
        "torque": torque_figure(torque, data.joint),
        "correlations": correlation_figure(residuals),
    }
    return replace(page, lead=Section(title="At a glance", text=_EXPLAINED, figures=figures))


def torque_figure(residual: ResidualTorque, joint: JointKind, most: int = _MOST_LOGS) -> Figure:
    """Draw the residual torque of a log against time, angle and velocity."""
    title = "residual force in N" if joint is JointKind.SLIDE else "residual torque in N m"
    way = joint.way
    columns = {
        "time in s": residual.time,
        f"angle in {way}": residual.angle,
        f"velocity in {way}/s": residual.velocity,
    }
    figure = make_subplots(rows=3, cols=1, vertical_spacing=0.11)
    some = seen_samples([residual.torque], most)
    torque = residual.torque[some].astype(np.float32)
    for row, (below, values) in enumerate(columns.items(), start=1):
        colour, _ = look(row - 1)
        style = {"line": {"color": colour, "width": 1}, "mode": "lines" if row == 1 else "markers"}
        style["marker"] = {"color": colour, "size": 3, "opacity": 0.8}
        add(figure, row, values[some], torque, showlegend=False, **style)
        figure.update_xaxes(title=below, row=row)
        figure.update_yaxes(title=title, row=row)
    figure.update_layout(height=880)
    return figure
