"""The thesis's estimators of a resonance frequency, as printed and corrected.

With x = w^2, 1/|G|^2 = ((a0 - x)^2 + a1^2 x)/b0^2 is exactly a parabola, lowest at the resonance
x = a0 - a1^2/2 (76).
"""

import math

import numpy as np

from butterfly.errors import IdentifiabilityError
from butterfly.signals.frequency_response import STEADY_SECONDS, response_point
from butterfly.thesis.resonance import Resonance, _rational, _responses, complex_fit

_REWEIGHTINGS = 5
_TRANSIENT_ROUNDS = 6


def largest_gain(omega, gain):
    """Return the frequency of the largest gain, the first realisation of (86)."""
    return Resonance(omega=float(omega[np.argmax(gain)]))


def two_largest(
    omega,
    gain,
    peak=None,
    *,
    corrected=True,
):
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
    return Resonance(omega=math.sqrt(squared))


def from_curvature(omega, gain, curvature):
    """Estimate from the two largest gains by (89), with B = b0^2/(a1^4 (a0 - a1^2/4)^2) known."""
    second, first = np.argsort(gain, kind="stable")[-2:]
    x, y = omega[first] ** 2, omega[second] ** 2
    rise = (gain[first] ** 2 - gain[second] ** 2) / (x - y)
    return Resonance(omega=math.sqrt((x + y) / 2 + rise / (2 * curvature)))


def three_point(omega, gain, error):
    """Estimate from the largest gain and its neighbours: the parabola through 1/g^2."""
    order = np.argsort(omega)
    peak = int(np.argmax(gain[order]))
    if not 0 < peak < omega.size - 1:
        raise IdentifiabilityError(
            f"the largest gain is at {omega[order][peak]:.4g} rad/s, an end of the frequencies: "
            "measure beyond it"
        )
    rows = order[peak - 1 : peak + 2]
    return parabola(omega[rows], gain[rows], error[rows])


def parabola(omega, gain, error):
    """Estimate from all gains: the parabola in w^2 that fits 1/g^2 best, weighted by its errors."""
    if np.unique(omega).size < 3:
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


def transient_fit(logs):
    """Estimate from whole records, their transients fitted with the responses.

    The decaying oscillation with which a record begins says as much of the poles as the responses
    do, and need not be waited for: its poles are those of the fit before (`complex_fit`), in turn.
    """
    pole = None
    for _ in range(_TRANSIENT_ROUNDS):
        span = math.inf if pole else STEADY_SECONDS
        points = [response_point(log, span, pole) for log in logs]
        found = complex_fit(points)
        (a1, a0, _), _ = _rational(*_responses(points))
        if not (a0 > a1**2 / 4 and a1 > 0):
            raise IdentifiabilityError("the response does not ring: there is no transient to fit")
        pole = complex(-a1 / 2, math.sqrt(a0 - a1**2 / 4))
    return found
