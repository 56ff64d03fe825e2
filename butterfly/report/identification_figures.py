"""Figures of an identification: intervals, how they go together, FIT log by log, responses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from html import escape

import numpy as np
from numpy.typing import NDArray
from plotly.graph_objects import Figure
from scipy.interpolate import PchipInterpolator

from butterfly.arrays import Samples
from butterfly.errors import InputError, nearest
from butterfly.identification.data import DataSet
from butterfly.identification.free_run import FreeRun
from butterfly.identification.identified import Identified
from butterfly.model.linear import quasi_linear_response
from butterfly.model.parameters import AddedMass, LumpedParameters
from butterfly.report.corner import corner_figure, corner_of
from butterfly.report.figures import (
    GREY,
    PALETTE,
    add,
    grams,
    log_ticks,
    mass_looks,
    middle,
    panels,
    rows_panel,
)
from butterfly.report.log_figures import first_stretch, time_figure
from butterfly.report.page import forest
from butterfly.signals.frequency_response import ResponsePoint, response_point, rms_amplitude

_ROW = 34  # pixels of a parameter
_HEIGHTS = [0.36, 0.26, 0.19, 0.19]  # of gain, phase, and what is left of either
_POINTS = 300  # of a line
_UNASKED = (0.3, 30.0)  # rad/s, where no sine says what is of interest


@dataclass(frozen=True)
class IdentificationPlots:
    """Figures of an identification.

    Parameters
    ----------
    identification
        With its logs.
    """

    identification: Identified

    def parameters(self) -> Figure:
        """Draw the half-widths of the intervals, in per cent on a logarithmic axis: a forest plot.

        Thick: 95 %, in another colour where the value may be 0; thin: the farthest estimate that
        leaves one added mass out; a diamond: the truth, where it is known.
        """
        rows = self.identification.estimate.table(self.identification.truth)
        bars, places = forest(rows), list(range(len(rows)))
        halves = [bar.half_width for bar in bars]
        zeros = [bar.half_width if bar.may_be_zero else None for bar in bars]
        names = [row.name for row in rows]
        figure = rows_panel(names, "distance from the value, in % of it", _ROW)
        for name, (colour, width, below), sizes in (
            ("95 % half-width", (PALETTE[0], 12, 0.0), halves),
            ("may be 0", (PALETTE[1], 12, 0.0), zeros),
            ("leave-one-mass-out", (GREY, 3, 0.3), [bar.left_out for bar in bars]),
        ):
            x, y = [], []
            for place, bar, size in zip(places, bars, sizes, strict=True):
                if size is not None:
                    x += [bar.axis.decades[0], bar.axis.clipped(size), math.nan]
                    y += [place + below, place + below, math.nan]
            line = {"color": colour, "width": width}
            if x:
                figure.add_scatter(x=x, y=y, mode="lines", name=name, line=line, hoverinfo="x")
        known = [place for place in places if bars[place].true is not None]
        if known:
            figure.add_scatter(
                x=[bars[place].axis.clipped(bars[place].true or 0.0) for place in known],
                y=known,
                mode="markers",
                name="truth",
                marker={"color": PALETTE[2], "symbol": "diamond", "size": 9},
            )
        return figure.update_xaxes(log_ticks(1))

    def corner(self) -> Figure | None:
        """Draw pairs of parameters with 95 % ellipses; None of fewer than two with errors.

        Green: the true values, where they are known; above the diagonal: correlations.
        """
        corner = corner_of(self.identification)
        return None if corner is None else corner_figure(corner)

    def fits(self) -> Figure:
        """Draw the FIT of every log, the worst on top, by added mass."""
        data, fits = self.identification.data, self.identification.fit_of_logs
        order = np.argsort(fits)
        labels = [data.logs[number].label for number in order]
        figure = rows_panel(labels, "FIT in %")
        for mass, (colour, symbol) in mass_looks(data.masses).items():
            rows = [k for k, number in enumerate(order) if data.logs[number].added_mass == mass]
            numbers = order[rows]
            figure.add_scatter(
                x=fits[numbers],
                y=rows,
                text=[escape(labels[row]) for row in rows],
                customdata=numbers.tolist(),  # the log that a click chooses
                mode="markers",
                name=grams(mass),
                marker={"color": colour, "symbol": symbol, "size": 9},
                hovertemplate="%{text}: %{x:.1f} %<extra></extra>",
            )
        return figure

    def frequency_response(self) -> Figure:
        """Draw gain and phase over frequency, measured and modelled, and the residual.

        Each simulated log is evaluated like the measured one. The lines pass through these points;
        in between they follow the describing functions, at a swing in between. Logs without sines
        have only the describing functions, at the median of their rms swings.
        """
        data, parameters = self.identification.data, self.identification.estimate.parameters
        count = len(_HEIGHTS) if data.sines else 2
        way = data.joint.way
        unit = f"{way}/{data.input_kind.unit}"
        titles = (f"gain in {unit}", "phase in °", "gain error<br>in %", "phase error<br>in °")
        height = 820 if data.sines else 520
        across, shares = "frequency in rad/s", _HEIGHTS[:count]
        figure = panels(across, titles[:count], height, spacing=0.03, shares=shares)
        figure.update_xaxes(log_ticks(*(range(1, 10) if data.sines else (1, 2, 5))))
        figure.update_yaxes(log_ticks(1, 2, 5), row=1)
        for mass, (colour, symbol) in mass_looks(data.masses).items():
            pairs = [
                (point, _simulated_gain(run, point))
                for point, run in zip(data.points, self._runs_of_sines, strict=True)
                if point is not None and point.added_mass == mass
            ]
            points = [point for point, _ in pairs]
            if not points and data.sines:
                continue
            loaded = parameters.with_added_mass(mass)
            name = grams(mass)
            common = {"legendgroup": name, "hovertemplate": "%{x:.3g} rad/s: %{y:.4g}"}
            omega, swing = swings_between(points) if points else _typical_swing(data, mass)
            response = quasi_linear_response(loaded, omega, swing)
            modelled = np.array([gain for _, gain in pairs])
            if points:
                response = response * _correction(loaded, points, modelled, omega)
            line = {"color": colour, "width": 1.4}
            look_of_line = {"name": f"{name}, model", "mode": "lines", "line": line, **common}
            for row, values in enumerate((np.abs(response), _degrees(response)), start=1):
                add(figure, row, omega, values, showlegend=row == 1, **look_of_line)
            if not points:
                continue
            at = np.array([p.omega for p in points])
            gain = np.array([p.gain for p in points])
            gain_error = np.array([p.angle.amplitude_error / abs(p.input) for p in points])
            phase_error = np.degrees([p.angle.phase_error for p in points])
            with np.errstate(divide="ignore", invalid="ignore"):  # of a model that does not move
                ratio = gain / modelled
            measured = (
                (np.abs(gain), gain_error),
                (_degrees(gain), phase_error),
                (100 * (np.abs(ratio) - 1), 100 * gain_error / np.abs(gain)),
                (_degrees(ratio), phase_error),
            )
            marker = {"symbol": symbol, "size": 6, "color": colour}
            marks = {"name": f"{name}, measured", "mode": "markers", "marker": marker, **common}
            for row, (values, errors) in enumerate(measured, start=1):
                bars = {"array": 2 * errors, "thickness": 1, "width": 2}
                add(figure, row, at, values, error_y=bars, showlegend=row == 1, **marks)
        return figure

    @property
    def _runs_of_sines(self) -> Sequence[FreeRun | None]:
        """The free run of each log; without sines none is needed."""
        data = self.identification.data
        return self.identification.free_runs if data.sines else [None] * len(data.points)

    def time(self, log: str | int | None = None) -> Figure:
        """Draw measured and simulated angle of a log, by its name or number.

        Of a sine the last five periods are shown first; a double click shows all.

        Parameters
        ----------
        log
            Default: the log with the median FIT.
        """
        runs = self.identification.free_runs
        names = [run.log.name for run in runs]
        if log is None:
            log = middle([run.fit for run in runs])
        if isinstance(log, str):
            if log not in names:
                raise InputError("plot.time", "log", log, nearest(log, names))
            log = names.index(log)
        if not isinstance(log, int) or not -len(runs) <= log < len(runs):
            raise InputError("plot.time", "log", log, f"a number below {len(runs)}")
        run = runs[log]
        figure = time_figure(run, self.identification.residuals.logs[log].band)
        return figure.update_xaxes(range=first_stretch(run.log))


def _simulated_gain(run: FreeRun | None, point: ResponsePoint) -> complex:
    """Return the gain of a simulated log, got as that of the measured one was; NaN of none."""
    if run is None or not math.isfinite(run.fit):
        return complex(math.nan, math.nan)
    try:
        return complex(response_point(replace(run.log, angle=run.simulated), pole=point.pole).gain)
    except InputError:
        return complex(math.nan, math.nan)


def _correction(
    loaded: LumpedParameters,
    points: Sequence[ResponsePoint],
    gains: NDArray[np.complex128],
    omega: Samples,
) -> NDArray[np.complex128]:
    """Return by which factor describing functions are off from simulated logs, in between too."""
    at = np.array([point.omega for point in points])
    described = quasi_linear_response(loaded, at, [point.amplitude for point in points])
    with np.errstate(divide="ignore", invalid="ignore"):
        off = np.log(gains / described)
    known = np.unique(at[np.isfinite(off)])
    if not known.size:
        return np.ones(omega.size, dtype=complex)
    means = np.array([off[(at == one) & np.isfinite(off)].mean() for one in known])
    return np.asarray(np.exp(np.interp(np.log(omega), np.log(known), means)))


def swings_between(points: list[ResponsePoint]) -> tuple[Samples, Samples]:
    """Return frequencies in rad/s between the logs', and swings in rad, smooth through theirs."""
    measured = np.unique([p.omega for p in points])
    swing = [np.mean([np.log(p.amplitude) for p in points if p.omega == w]) for w in measured]
    grid = np.geomspace(measured[0], measured[-1], _POINTS) if measured.size > 1 else measured
    omega = np.unique(np.concatenate([grid, measured]))
    if measured.size == 1:
        return omega, np.exp(np.array(swing))
    return omega, np.exp(PchipInterpolator(np.log(measured), swing)(np.log(omega)))


def _typical_swing(data: DataSet, mass: AddedMass) -> tuple[Samples, Samples]:
    omega = np.geomspace(*_UNASKED, _POINTS)
    logs = [log.angle for log in data.logs if log.added_mass == mass]
    swings = [rms_amplitude(angle - angle.mean()) for angle in logs]
    return omega, np.full_like(omega, np.median(swings))


def _degrees(response: NDArray[np.complex128]) -> Samples:
    """Return phases from -270 to 90 degrees: a lag beyond 180 does not jump to the top."""
    return np.asarray(np.degrees(np.angle(1j * response)) - 90)
