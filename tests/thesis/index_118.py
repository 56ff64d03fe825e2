"""The thesis's index for re-calibration (118), as printed and normalised: kept to show it fail.

With I(t) the invariant (107) at estimated parameters and a-bar its decay (115), (118) sums the
squares of I(t + h) - a-bar I(t). Scaling p1 and p3 by s scales I by s and the index by s^2, so
I = 0 minimises it. Divided by the sum of I^2 it still knows nothing of p2; and since a controller
built on wrong parameters settles at a constant I other than 0, a-bar = 1 fits best: p4 = 0.
"""

from __future__ import annotations

from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from butterfly.logs.log import Log
from butterfly.model.energy import Orbit
from butterfly.model.parameters import LumpedParameters
from butterfly.signals.polynomials import slope
from butterfly.signals.spectrum import resample, uniform_grid

_PARTS = 20  # of a period, n of (117)
_VELOCITY = 0.02  # s, half-width of the polynomials whose slope is the velocity
_VELOCITY_ORDER = 4


class Index(StrEnum):
    """How (118) is read."""

    PRINTED = "printed"
    NORMALISED = "normalised"
    FIXED_INERTIA = "fixed-inertia"


def minimise_index(
    log: Log, zero: float, start: LumpedParameters, amplitude: float, *, gamma: float, index: Index
) -> NDArray[np.float64]:
    """Minimise (118) over p1, p3 and p4, none of them negative.

    Parameters
    ----------
    log
        Of the loop on its way to the orbit.
    zero
        Encoder reading in rad of the hanging hand.
    start
        Parameters to start from.
    amplitude
        Of the orbit, in rad.
    gamma
        Of the controller that ran.
    index
        As printed, divided by the sum of I^2, or as printed with p1 held at its start.

    Returns
    -------
    (3,) p1, p3, p4 at the minimum.
    """
    grid = uniform_grid(log.time)
    step = float(grid[1] - grid[0])
    angle = resample(log.time, log.angle, grid) - zero
    velocity = slope(angle, max(round(_VELOCITY / step), _VELOCITY_ORDER), _VELOCITY_ORDER, step)
    area = np.concatenate([[0.0], np.cumsum(velocity[:-1] ** 2) * step])
    every = max(1, round(Orbit.of_amplitude(start, amplitude).period / _PARTS / step))
    kinetic, height = 0.5 * velocity[::every] ** 2, np.cos(amplitude) - np.cos(angle[::every])
    areas = np.diff(area[::every])
    scale = np.array([start.p1, start.p3, start.p4])

    def residuals(shares: NDArray[np.float64]) -> NDArray[np.float64]:
        full = np.append(1.0, shares) if index is Index.FIXED_INERTIA else shares
        p1, p3, p4 = full * scale
        invariant = (p1 * kinetic + p3 * height) / start.p3
        misfit = invariant[1:] - np.exp(-p4 * gamma * areas) * invariant[:-1]
        if index is Index.NORMALISED:
            misfit = misfit / max(float(np.linalg.norm(invariant)), 1e-300)
        return np.asarray(misfit)

    count = 2 if index is Index.FIXED_INERTIA else 3
    fit = least_squares(residuals, np.ones(count), bounds=(0.0, np.inf), xtol=1e-12, ftol=1e-14)
    shares = np.append(1.0, fit.x) if index is Index.FIXED_INERTIA else fit.x
    return np.asarray(shares * scale)
