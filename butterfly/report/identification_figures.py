"""Figures of an identification: intervals, how they go together, FIT log by log, responses."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape

import numpy as np
from numpy.typing import NDArray
from plotly.graph_objects import Figure
from plotly.subplots import make_subplots

from butterfly.errors import InputError, nearest
from butterfly.identification.data import DataSet
from butterfly.identification.identification import Identification
from butterfly.model.linear import quasi_linear_response
from butterfly.model.parameters import AddedMass, LumpedParameters
from butterfly.model.terms import TERMS
from butterfly.report.figures import GREY, PALETTE, add, grams, look, middle, panels, ranked_panel
from butterfly.report.log_figures import time_figure
from butterfly.report.page import Whisker
from butterfly.signals.frequency_response import ResponsePoint
from butterfly.signals.spectrum import rms_amplitude

_ROW = 64  # pixels of a panel and what is below it
_GAP = 0.6  # of a panel and what is below it, that is below
_FEWEST = 2  # parameters that can hang together
_CELL = 44  # pixels of a cell of the map
_MOST_NUMBERED = 12  # parameters, up to which the cells of the map have numbers
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

    identification: Identification

    def parameters(self, truth: LumpedParameters | None = None) -> Figure:
        """Draw the estimates with their intervals, each on a scale of its own: a forest plot.

        Thick: 95 %; thin: what leaving one added mass out would give; a diamond: the truth, where
        it is known.
        """
        rows = self.identification.estimate.table(truth)
        figure = make_subplots(rows=len(rows), cols=1, vertical_spacing=_GAP / max(len(rows), 1))
        for number, row in enumerate(rows, start=1):
            whisker, named = Whisker.of(row), number == 1
            wide = {"mode": "lines", "hoverinfo": "x", "showlegend": named}
            marks = {"mode": "markers", "showlegend": named}
            for limits, height, colour, width, name in (
                (whisker.limits, 0.0, PALETTE[0], 6, "95 % interval"),
                (whisker.left_out, -0.6, GREY, 3, "one mass left out"),
            ):
                if limits is not None:
                    line = {"color": colour, "width": width}
                    add(figure, number, limits, [height] * 2, name=name, line=line, **wide)
            dot = {"color": PALETTE[5], "size": 9, "symbol": "circle"}
            add(figure, number, [whisker.value], [0], name="estimate", marker=dot, **marks)
            if whisker.true is not None:
                diamond = {"color": PALETTE[2], "size": 9, "symbol": "diamond"}
                add(figure, number, [whisker.true], [0.6], name="truth", marker=diamond, **marks)
            label = f"{row.name} in {row.unit}"
            figure.update_yaxes(row=number, tickvals=[0], ticktext=[label], range=[-1, 1])
            ends = whisker.scale if np.isfinite(whisker.scale).all() else None
            figure.update_xaxes(row=number, range=ends, nticks=6)
        figure.update_layout(height=_ROW * len(rows) + 80)
        return figure

    def correlations(self) -> Figure | None:
        """Draw how the errors of the parameters go together; None without a covariance."""
        estimate = self.identification.estimate
        symbols = [TERMS[name].symbol for name in estimate.names]
        if len(symbols) < _FEWEST or not np.isfinite(estimate.covariance).all():
            return None
        numbered = len(symbols) <= _MOST_NUMBERED
        errors = estimate.standard_errors
        sizes = np.where(errors > 0, errors, 1.0)
        correlation = estimate.covariance / np.outer(sizes, sizes)
        figure = Figure()
        figure.add_heatmap(
            z=correlation[::-1],
            x=symbols,
            y=symbols[::-1],
            zmin=-1,
            zmax=1,
            colorscale="RdBu",
            texttemplate="%{z:.2f}" if numbered else None,
            showscale=not numbered,
            hovertemplate="%{y} and %{x}: %{z:.3f}",
            colorbar={"title": {"text": "correlation"}},
        )
        figure.update_layout(height=_CELL * len(symbols) + 110)
        return figure

    def fits(self) -> Figure:
        """Draw the FIT of every log, the worst first, by added mass."""
        data, fits = self.identification.data, self.identification.fit_of_logs
        order = np.argsort(fits)
        figure = ranked_panel(len(fits))
        for index, mass in enumerate(data.masses):
            colour, symbol = look(index)
            ranks = [k for k, number in enumerate(order) if data.logs[number].added_mass == mass]
            numbers = order[ranks]
            figure.add_scatter(
                x=[rank + 1 for rank in ranks],
                y=fits[numbers],
                text=[escape(data.logs[number].label) for number in numbers],
                customdata=numbers.tolist(),  # the log that a click chooses
                mode="markers",
                name=grams(mass),
                marker={"color": colour, "symbol": symbol, "size": 9},
                hovertemplate="%{text}: %{y:.1f} %<extra></extra>",
            )
        return figure

    def frequency_response(self) -> Figure:
        """Draw gain and phase over frequency, measured and modelled, and what is left.

        The model is shown at the swing of the logs by its describing functions: the lines pass
        through what it says of each log, and take a swing in between where no log is. Of logs
        without sines there are only lines, at the median of their rms swings.
        """
        data, parameters = self.identification.data, self.identification.estimate.parameters
        count = len(_HEIGHTS) if data.sines else 2
        way = data.joint.way
        unit = f"{way}/V" if data.input_kind == "voltage" else f"{way} per unit"
        titles = (f"|θ/u| in {unit}", "phase in °", "gain error in %", "phase error in °")
        height = 820 if data.sines else 520
        figure = panels("ω in rad/s", titles[:count], height, spacing=0.03, shares=_HEIGHTS[:count])
        figure.update_xaxes(type="log", dtick="D1")
        figure.update_yaxes(type="log", dtick="D2", row=1)
        for index, mass in enumerate(data.masses):
            points = [p for p in data.sines if p.added_mass == mass]
            if not points and data.sines:
                continue
            loaded = parameters.with_added_mass(mass)
            colour, symbol = look(index)
            name = grams(mass)
            common = {"legendgroup": name, "hovertemplate": "%{x:.3g} rad/s: %{y:.4g}"}
            omega, swing = swings_between(points) if points else _typical_swing(data, mass)
            response = quasi_linear_response(loaded, omega, swing)
            line = {"color": colour, "width": 1.4}
            look_of_line = {"name": f"{name}, model", "mode": "lines", "line": line, **common}
            for row, values in enumerate((np.abs(response), _degrees(response)), start=1):
                add(figure, row, omega, values, showlegend=row == 1, **look_of_line)
            if not points:
                continue
            at = np.array([p.omega for p in points])
            own = quasi_linear_response(loaded, at, [p.amplitude for p in points])
            gain = np.array([p.gain for p in points])
            gain_error = np.array([p.angle.amplitude_error / abs(p.input) for p in points])
            phase_error = np.degrees([p.angle.phase_error for p in points])
            with np.errstate(divide="ignore", invalid="ignore"):  # of a model that does not move
                ratio = gain / own
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

    def time(self, log: str | int | None = None) -> Figure:
        """Draw measured and simulated angle of a log, by its name or number.

        Parameters
        ----------
        log
            The one with the middle FIT if not given.

        Raises
        ------
        InputError
            If there is no such log.
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
        return time_figure(runs[log], self.identification.residuals.logs[log].band)


def swings_between(points: list[ResponsePoint]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return frequencies in rad/s from the first log's to the last one's, and swings in rad.

    Those of the logs at theirs (the geometric mean of several), on straight lines over logarithms
    between.
    """
    measured = np.unique([p.omega for p in points])
    swing = [np.mean([np.log(p.amplitude) for p in points if p.omega == w]) for w in measured]
    grid = np.geomspace(measured[0], measured[-1], _POINTS) if measured.size > 1 else measured
    omega = np.unique(np.concatenate([grid, measured]))
    return omega, np.exp(np.interp(np.log(omega), np.log(measured), swing))


def _typical_swing(
    data: DataSet, mass: AddedMass
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    omega = np.geomspace(*_UNASKED, _POINTS)
    logs = [log.angle for log in data.logs if log.added_mass == mass]
    swings = [rms_amplitude(angle - angle.mean()) for angle in logs]
    return omega, np.full_like(omega, np.median(swings))


def _degrees(response: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Phase within -270 .. 90 degrees, so that a lag beyond 180 does not jump to the top."""
    return np.asarray(np.degrees(np.angle(1j * response)) - 90)
