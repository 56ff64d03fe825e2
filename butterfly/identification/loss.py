"""Losses of residuals: squares, and robust ones that count outliers less.

With z the square of a residual over that of the scale, the loss is scale^2 rho(z); see
`scipy.optimize.least_squares`, and Huber & Ronchetti, Robust Statistics, 2nd ed. 2009.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum

import numpy as np
from scipy.special import ndtri

from butterfly.arrays import Samples
from butterfly.verdict import SPREADS

_NORMAL = 1 / float(ndtri(0.75))  # standard deviation over median absolute deviation


class Loss(StrEnum):
    """Loss of residuals over their robust scale (see `scipy.optimize.least_squares`)."""

    LINEAR = "linear"
    SOFT_L1 = "soft_l1"
    HUBER = "huber"
    CAUCHY = "cauchy"

    def values(self, residuals: Samples, scale: float) -> Samples:
        """(n,) loss of residuals in place of their squares; smaller than these above the scale."""
        return np.asarray(scale**2 * _COUNTED[self][0]((residuals / scale) ** 2))

    def weights(self, residuals: Samples, scale: float) -> Samples:
        """(n,) derivatives of `values` by the squares of the residuals."""
        return np.asarray(_COUNTED[self][1]((residuals / scale) ** 2))

    def slopes(self, residuals: Samples, scale: float) -> Samples:
        """(n,) derivatives of `weights` times residuals by the residuals."""
        return np.asarray(_COUNTED[self][2]((residuals / scale) ** 2))


_COUNTED: dict[Loss, tuple[Callable[[Samples], Samples], ...]] = {
    Loss.LINEAR: (lambda z: z, np.ones_like, np.ones_like),
    Loss.SOFT_L1: (
        lambda z: 2 * ((1 + z) ** 0.5 - 1),
        lambda z: (1 + z) ** -0.5,
        lambda z: (1 + z) ** -1.5,
    ),
    Loss.HUBER: (
        lambda z: np.where(z <= 1, z, 2 * z**0.5 - 1),
        lambda z: np.maximum(z, 1.0) ** -0.5,
        lambda z: np.where(z <= 1, 1.0, 0.0),
    ),
    Loss.CAUCHY: (np.log1p, lambda z: 1 / (1 + z), lambda z: (1 - z) / (1 + z) ** 2),
}
"""Of squares over that of the scale: loss, its derivative, and that of the weighted residuals."""


def outlying(residuals: Samples) -> float:
    """Return the size above which one of (n,) residuals counts as an outlier."""
    return SPREADS * _NORMAL * float(np.median(np.abs(residuals)))
