"""The thesis's estimators of a resonance frequency, and of p1 and p3 from it, beside better ones.

With x = w^2, 1/|G|^2 = ((a0 - x)^2 + a1^2 x)/b0^2 is exactly a parabola, lowest at the resonance
x = a0 - a1^2/2 (76). Without damping Y = (p3 + X)/(p1 + Z) (82), with Y = w_opt^2 of a hand that
carries a mass; multiplied out it is linear (84), but then the noise of Y stands in a regressor.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from butterfly.errors import IdentifiabilityError
from butterfly.signals.frequency_response import STEADY_SECONDS, response_point
from butterfly.thesis.tables import complex_fit

_REWEIGHTINGS = 5
_TRANSIENT_ROUNDS = 6


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


def transient_fit(logs):
    """Estimate from whole records, their transients fitted with the responses.

    The decaying oscillation with which a record begins says as much of the poles as the responses
    do, and need not be waited for: its poles are those of the fit before (`complex_fit`), in turn.
    """
    pole = None
    for _ in range(_TRANSIENT_ROUNDS):
        span = math.inf if pole else STEADY_SECONDS
        points = [response_point(log, span, pole) for log in logs]
        (a1, a0, _), _ = complex_fit(points)
        if not (a0 > a1**2 / 4 and a1 > 0):
            raise IdentifiabilityError("the response does not ring: there is no transient to fit")
        pole = complex(-a1 / 2, math.sqrt(a0 - a1**2 / 4))
    return of_responses(points)


def multiplied_out(resonances):
    """Return (2,) p1 and p3 by ordinary least squares of (84), as the thesis proposes."""
    x, z, y, _ = _variables(resonances)
    return np.linalg.lstsq(np.column_stack([-y, np.ones(y.size)]), y * z - x, rcond=None)[0]


def ratio(resonances):
    """Return (2,) p1 and p3 by nonlinear least squares of (82), and their (2, 2) covariance."""
    x, z, y, error = _variables(resonances)
    start = multiplied_out(resonances)

    def residuals(shares):
        p1, p3 = shares * start
        return ((p3 + x) / (p1 + z) - y) / error

    fit = least_squares(residuals, np.ones(2), xtol=1e-14, ftol=1e-14)
    jacobian = fit.jac / start
    return fit.x * start, np.linalg.inv(jacobian.T @ jacobian)


def _variables(resonances):
    """Return the (n,) X, Z, Y of (81) and standard errors of Y."""
    omega, error = np.array(list(resonances.values())).T
    x = np.array([mass.gravity_moment for mass in resonances])
    return x, np.array([mass.inertia for mass in resonances]), omega**2, 2 * omega * error
