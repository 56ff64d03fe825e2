"""The thesis's estimators of a resonance frequency, beside better ones.

With x = w^2, 1/|G|^2 = ((a0 - x)^2 + a1^2 x)/b0^2 is exactly a parabola, lowest at the resonance
x = a0 - a1^2/2 (76).
"""

import math
from typing import NamedTuple

import numpy as np

from butterfly.thesis.tables import complex_fit

_REWEIGHTINGS = 5


class Resonance(NamedTuple):
    """A resonance frequency in rad/s with its standard error."""

    omega: float
    error: float = math.nan

    @classmethod
    def of_square(cls, squared, gradient, covariance):
        """Return the root of a square that has this gradient by parameters of this covariance."""
        spread = math.sqrt(gradient @ covariance @ gradient)
        return cls(math.sqrt(squared), spread / (2 * math.sqrt(squared)))


def of_responses(points):
    """Estimate from complex responses, by `complex_fit`."""
    (a1, a0, _), covariance = complex_fit(points)
    return Resonance.of_square(a0 - a1**2 / 2, np.array([-a1, 1.0, 0.0]), covariance)


def two_largest(omega, gain, peak=None, *, corrected=True):
    """Estimate from the two largest gains, (90), or (100) if the peak is not known."""
    second, first = np.argsort(gain, kind="stable")[-2:]
    top = peak or float(gain[first])
    if corrected:
        alpha, beta = (math.sqrt(max(1 / gain[k] ** 2 - 1 / top**2, 0.0)) for k in (second, first))
        if alpha + beta == 0:
            alpha = 1.0
    else:
        alpha, beta = (math.sqrt(gain[k] ** 2 + top**2) for k in (second, first))
    squared = (omega[first] ** 2 * alpha + omega[second] ** 2 * beta) / (alpha + beta)
    return Resonance(math.sqrt(squared))


def three_point(omega, gain, error):
    """Estimate from the largest gain and its neighbours: the parabola through 1/g^2."""
    peak = int(np.argmax(gain))
    rows = slice(peak - 1, peak + 2)
    return parabola(omega[rows], gain[rows], error[rows])


def parabola(omega, gain, error):
    """Estimate from all gains: the parabola in w^2 that fits 1/g^2 best, weighted by its errors."""
    middle = float(np.mean(omega**2))
    design = np.vander(omega**2 / middle - 1, 3, increasing=True)
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
    gradient = np.array([0.0, -1 / (2 * bend), slope / (2 * bend**2)]) / scale
    return Resonance.of_square(middle * (1 - slope / (2 * bend)), middle * gradient, normal)
