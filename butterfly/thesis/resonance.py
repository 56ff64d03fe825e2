"""Estimators of the resonance frequency from one robot's gains or responses.

With x = w^2, 1/|G|^2 = ((a0 - x)^2 + a1^2 x)/b0^2 is exactly a parabola, lowest at the resonance
x = a0 - a1^2/2 (76). The thesis's own estimators stand beside, as printed and corrected.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from butterfly.errors import IdentifiabilityError, InputError
from butterfly.logs.log import Log
from butterfly.signals.frequency_response import ResponsePoint, response_point
from butterfly.signals.window import STEADY_SECONDS

_ITERATIONS = 30
_REWEIGHTINGS = 5
_TRANSIENT_ROUNDS = 6
_STEP = 1e-6  # relative, of the differences behind the standard errors


@dataclass(frozen=True, kw_only=True)
class Resonance:
    """A resonance frequency in rad/s with its standard error, NaN where none can be given."""

    omega: float
    error: float = math.nan


def largest_gain(omega: NDArray[np.float64], gain: NDArray[np.float64]) -> Resonance:
    """Return the frequency of the largest gain, the first realisation of (86)."""
    return Resonance(omega=float(omega[np.argmax(gain)]))


def two_largest(
    omega: NDArray[np.float64],
    gain: NDArray[np.float64],
    peak: float | None = None,
    *,
    corrected: bool = True,
) -> Resonance:
    """Estimate from the two largest gains, (90), or (100) if the peak is not known.

    Parameters
    ----------
    omega, gain
        (n,) frequencies in rad/s and gains.
    peak
        Largest gain |G(j w_opt)|, the root of A (91); the largest one measured if not known.
    corrected
        With the sign that makes it exact, alpha = sqrt(1/g^2 - 1/A); otherwise as printed,
        sqrt(g^2 + A), which tends to the middle of the two frequencies.
    """
    second, first = np.argsort(gain, kind="stable")[-2:]
    top = peak or float(gain[first])
    if corrected:
        alpha, beta = (math.sqrt(max(1 / gain[k] ** 2 - 1 / top**2, 0.0)) for k in (second, first))
        if alpha + beta == 0:
            alpha = 1.0
    else:
        alpha, beta = (math.sqrt(gain[k] ** 2 + top**2) for k in (second, first))
    squared = (omega[first] ** 2 * alpha + omega[second] ** 2 * beta) / (alpha + beta)
    return Resonance(omega=math.sqrt(squared))


def from_curvature(
    omega: NDArray[np.float64], gain: NDArray[np.float64], curvature: float
) -> Resonance:
    """Estimate from the two largest gains by (89), with B = b0^2/(a1^4 (a0 - a1^2/4)^2) known."""
    second, first = np.argsort(gain, kind="stable")[-2:]
    x, y = omega[first] ** 2, omega[second] ** 2
    rise = (gain[first] ** 2 - gain[second] ** 2) / (x - y)
    return Resonance(omega=math.sqrt((x + y) / 2 + rise / (2 * curvature)))


def three_point(
    omega: NDArray[np.float64], gain: NDArray[np.float64], error: NDArray[np.float64]
) -> Resonance:
    """Estimate from the largest gain and its neighbours: the parabola through 1/g^2.

    Parameters
    ----------
    omega, gain, error
        (n,) different frequencies in rad/s, gains, and their standard errors.

    Raises
    ------
    IdentifiabilityError
        If the largest gain is at an end of the frequencies, or there is no peak.
    """
    order = np.argsort(omega)
    peak = int(np.argmax(gain[order]))
    if not 0 < peak < omega.size - 1:
        raise IdentifiabilityError(
            f"the largest gain is at {omega[order][peak]:.4g} rad/s, an end of the frequencies: "
            "measure beyond it"
        )
    rows = order[peak - 1 : peak + 2]
    return parabola(omega[rows], gain[rows], error[rows])


def parabola(
    omega: NDArray[np.float64], gain: NDArray[np.float64], error: NDArray[np.float64]
) -> Resonance:
    """Estimate from all gains: the parabola in w^2 that fits 1/g^2 best, weighted by its errors.

    Parameters
    ----------
    omega, gain, error
        (n,) frequencies in rad/s, three different ones at least; gains and standard errors.

    Raises
    ------
    IdentifiabilityError
        If there are too few frequencies, or no peak.
    """
    if np.unique(omega).size < 3:  # noqa: PLR2004 - a parabola
        raise IdentifiabilityError("fewer than three frequencies do not show a resonance")
    middle = float(np.mean(omega**2))
    x = omega**2 / middle - 1
    design = np.vander(x, 3, increasing=True)
    fitted = gain
    for _ in range(_REWEIGHTINGS):
        # Weights from measured gains would favour those that noise has raised.
        weight = fitted**3 / (2 * np.maximum(error, 1e-15 * gain))
        rows = design * weight[:, None]
        scale = np.linalg.norm(rows, axis=0)
        normal = np.linalg.inv((rows / scale).T @ (rows / scale))
        coefficients = normal @ ((rows / scale).T @ (weight / gain**2)) / scale
        predicted = design @ coefficients
        fitted = np.where(predicted > 0, np.abs(predicted) ** -0.5, gain)
    _, slope, bend = coefficients
    vertex = -slope / (2 * bend) if bend > 0 else math.nan
    squared = middle * (1 + vertex)
    if not squared > 0:
        raise IdentifiabilityError("1/|G|^2 has no minimum over w^2: there is no resonance peak")
    gradient = np.array([0.0, -1 / (2 * bend), slope / (2 * bend**2)]) / scale
    spread = middle * math.sqrt(gradient @ normal @ gradient)
    return Resonance(omega=math.sqrt(squared), error=spread / (2 * math.sqrt(squared)))


def complex_fit(points: Sequence[ResponsePoint]) -> Resonance:
    """Estimate from complex responses, by maximum likelihood of b0/(-w^2 + j a1 w + a0).

    Sanathanan and Koerner's iteration, weighted by the measured errors: with each row divided by
    the denominator of the round before it minimises response errors, whose Gaussian likelihood is
    the largest there.

    Parameters
    ----------
    points
        Of one robot; three frequencies at least.

    Raises
    ------
    IdentifiabilityError
        If there is no resonance peak.
    InputError
        If the points carry different added masses.
    """
    if len({point.added_mass for point in points}) > 1:
        raise InputError("resonance", "added mass", "several", "one")
    values, covariance = _rational(*_responses(points))
    a1, a0, _ = values

    def peak(parameters: NDArray[np.float64]) -> float:
        return float(parameters[1] - parameters[0] ** 2 / 2)

    squared = peak(values)
    if not squared > 0:
        raise IdentifiabilityError(f"a0 = {a0:.4g} and a1 = {a1:.4g} have no resonance (73)")
    gradient = _gradient(peak, values)
    spread = math.sqrt(gradient @ covariance @ gradient)
    return Resonance(omega=math.sqrt(squared), error=spread / (2 * math.sqrt(squared)))


def transient_fit(logs: Sequence[Log]) -> Resonance:
    """Estimate from whole records, their transients fitted with the responses.

    The decaying oscillation with which a record begins says as much of the poles as the responses
    do, and need not be waited for: its poles are those of the fit before (`complex_fit`), in turn.

    Parameters
    ----------
    logs
        Sines on one robot, from rest or any other state; linear, so without Coulomb friction.

    Raises
    ------
    IdentifiabilityError
        If there is no resonance peak, or no oscillation.
    InputError
        If a log is no sine, or they carry different added masses.
    """
    pole: complex | None = None
    for _ in range(_TRANSIENT_ROUNDS):
        span = math.inf if pole else STEADY_SECONDS
        points = [response_point(log, span, pole) for log in logs]
        found = complex_fit(points)
        (a1, a0, _), _ = _rational(*_responses(points))
        if not (a0 > a1**2 / 4 and a1 > 0):
            raise IdentifiabilityError("the response does not ring: there is no transient to fit")
        pole = complex(-a1 / 2, math.sqrt(a0 - a1**2 / 4))
    return found


def _responses(
    points: Sequence[ResponsePoint],
) -> tuple[NDArray[np.float64], NDArray[np.complex128], NDArray[np.float64]]:
    omega = np.array([p.omega for p in points])
    response = np.array([p.gain for p in points])
    error = np.array([p.angle.amplitude_error / abs(p.input) for p in points])
    return omega, response, np.maximum(error, 1e-15 * np.abs(response))


def _rational(
    omega: NDArray[np.float64], response: NDArray[np.complex128], error: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (3,) a1, a0, b0 and their covariance."""
    weight = 1 / (error * omega**2)
    for _ in range(_ITERATIONS):
        matrix = np.column_stack([1j * omega * response, response, -np.ones(omega.size)])
        rows = matrix * weight[:, None]
        target = omega**2 * response * weight
        rows = np.concatenate([rows.real, rows.imag])
        target = np.concatenate([target.real, target.imag])
        scale = np.linalg.norm(rows, axis=0)
        values = np.linalg.lstsq(rows / scale, target, rcond=None)[0] / scale
        denominator = values[1] - omega**2 + 1j * omega * values[0]
        weight = 1 / (error * np.abs(denominator))
    normal = np.linalg.inv((rows / scale).T @ (rows / scale)) / np.outer(scale, scale)
    return values, normal


def _gradient(
    function: Callable[[NDArray[np.float64]], float], at: NDArray[np.float64]
) -> NDArray[np.float64]:
    steps = np.diag(_STEP * np.abs(at))
    return np.array([(function(at + h) - function(at - h)) / (2 * abs(h).sum()) for h in steps])
