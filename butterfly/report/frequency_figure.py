"""The frequency response of an identification: measured, and the model at the measured swing."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from butterfly.identification.data import DataSet
from butterfly.identification.identification import Identification
from butterfly.model.harmonic import quasi_linear_response
from butterfly.model.parameters import AddedMass
from butterfly.report.figures import add, grams, look
from butterfly.signals.frequency_response import ResponsePoint
from butterfly.signals.spectrum import rms_amplitude

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

    Samples = NDArray[np.float64]
    Responses = NDArray[np.complex128]

_HEIGHTS = [0.36, 0.26, 0.19, 0.19]  # of gain, phase, and what is left of either
_POINTS = 300  # of a line
_UNASKED = (0.3, 30.0)  # rad/s, where no sine says what is of interest


def frequency_response_figure(identification: Identification) -> Figure:
    """Gain and phase measured and modelled, and what is left, against frequency.

    The model is shown at the swing of the logs by its describing functions: the lines pass through
    what it says of each log, and take a swing in between where no log is. Of logs without sines
    there are only lines, at the median of their rms swings.
    """
    data, parameters = identification.data, identification.estimate.parameters
    rows = len(_HEIGHTS) if data.sines else 2
    figure = make_subplots(
        rows=rows, cols=1, shared_xaxes=True, vertical_spacing=0.03, row_heights=_HEIGHTS[:rows]
    )
    for index, mass in enumerate(data.masses):
        points = [p for p in data.sines if p.added_mass == mass]
        if not points and data.sines:
            continue
        loaded = parameters.with_added_mass(mass)
        colour, symbol = look(index)
        name = grams(mass)
        common = {"legendgroup": name, "hovertemplate": "%{x:.3g} rad/s: %{y:.4g}"}
        omega, swing = swings_between(points) if points else _typical_swing(data, mass)
        line = quasi_linear_response(loaded, omega, swing)
        drawn = {"mode": "lines", "line": {"color": colour, "width": 1.4}}
        for row, values in enumerate((np.abs(line), _degrees(line)), start=1):
            add(
                figure,
                row,
                omega,
                values,
                name=f"{name}, model",
                showlegend=row == 1,
                **drawn,
                **common,
            )
        if not points:
            continue
        at = np.array([p.omega for p in points])
        own = quasi_linear_response(loaded, at, [p.amplitude for p in points])
        gain = np.array([p.gain for p in points])
        gain_error, phase_error = _errors(points)
        with np.errstate(divide="ignore", invalid="ignore"):  # of a model that does not move
            ratio = gain / own
        panels = (
            (np.abs(gain), gain_error),
            (_degrees(gain), phase_error),
            (100 * (np.abs(ratio) - 1), 100 * gain_error / np.abs(gain)),
            (_degrees(ratio), phase_error),
        )
        marker = {"symbol": symbol, "size": 6, "color": colour}
        for row, (values, errors) in enumerate(panels, start=1):
            bars = {"array": 2 * errors, "thickness": 1, "width": 2}
            add(
                figure,
                row,
                at,
                values,
                name=f"{name}, measured",
                error_y=bars,
                mode="markers",
                marker=marker,
                showlegend=row == 1,
                **common,
            )
    figure.update_xaxes(type="log", dtick="D1")
    figure.update_xaxes(title="ω in rad/s", row=rows)
    way = data.joint.way
    unit = f"{way}/V" if data.input_kind == "voltage" else f"{way} per unit"
    titles = (f"|θ/u| in {unit}", "phase in °", "gain error in %", "phase error in °")
    for row, title in enumerate(titles[:rows], start=1):
        figure.update_yaxes(title=title, row=row)
    figure.update_yaxes(type="log", dtick="D2", row=1)
    figure.update_layout(height=820 if data.sines else 520)
    return figure


def swings_between(points: list[ResponsePoint]) -> tuple[Samples, Samples]:
    """Return frequencies in rad/s from the first log's to the last one's, and swings in rad.

    The swing is that of the logs at their frequencies (their geometric mean where several share
    one), and between them on straight lines over logarithms.

    Parameters
    ----------
    points
        At least one.
    """
    measured = np.unique([p.omega for p in points])
    swing = [np.mean([np.log(p.amplitude) for p in points if p.omega == w]) for w in measured]
    grid = np.geomspace(measured[0], measured[-1], _POINTS) if measured.size > 1 else measured
    omega = np.unique(np.concatenate([grid, measured]))
    return omega, np.exp(np.interp(np.log(omega), np.log(measured), swing))


def _typical_swing(data: DataSet, mass: AddedMass) -> tuple[Samples, Samples]:
    omega = np.geomspace(*_UNASKED, _POINTS)
    logs = [log.angle for log in data.logs if log.added_mass == mass]
    swings = [rms_amplitude(angle - angle.mean()) for angle in logs]
    return omega, np.full_like(omega, np.median(swings))


def _degrees(response: Responses) -> Samples:
    """Phase within -270 .. 90 degrees, so that a lag beyond 180 does not jump to the top."""
    return np.asarray(np.degrees(np.angle(1j * response)) - 90)


def _errors(points: list[ResponsePoint]) -> tuple[Samples, Samples]:
    """Return standard errors of gain, in its unit, and of phase in degrees."""
    gain = np.array([p.angle.amplitude_error / abs(p.input) for p in points])
    phase = np.array([np.degrees(p.angle.phase_error) for p in points])
    return gain, phase
