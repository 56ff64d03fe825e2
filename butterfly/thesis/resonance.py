"""The resonance frequency of one robot from its complex responses, by maximum likelihood."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from butterfly.errors import IdentifiabilityError, InputError
from butterfly.signals.frequency_response import ResponsePoint

_ITERATIONS = 30
_STEP = 1e-6  # relative, of the differences behind the standard errors


@dataclass(frozen=True, kw_only=True)
class Resonance:
    """A resonance frequency in rad/s with its standard error, NaN where none can be given."""

    omega: float
    error: float = math.nan


def complex_fit(points: Sequence[ResponsePoint]) -> Resonance:
    """Estimate from complex responses, by maximum likelihood of b0/(-w^2 + j a1 w + a0).

    Sanathanan and Koerner's iteration, weighted by the measured errors: with each row divided by
    the denominator of the round before it minimises response errors, whose Gaussian likelihood is
    the largest there.

    From three frequencies of one robot or more; an IdentifiabilityError if there is no resonance
    peak.
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
