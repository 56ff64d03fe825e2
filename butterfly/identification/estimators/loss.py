"""How much a residual counts: squared, or robustly."""

from __future__ import annotations

from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

Samples = NDArray[np.float64]

_NORMAL = 1.4826  # standard deviation over median absolute deviation
_OUTLYING = 1.5  # robust standard deviations beyond which a residual is taken for an outlier


class Loss(StrEnum):
    """How residuals, in robust standard deviations, count (see `scipy.optimize.least_squares`)."""

    LINEAR = "linear"
    SOFT_L1 = "soft_l1"
    HUBER = "huber"
    CAUCHY = "cauchy"

    def values(self, residuals: Samples, scale: float) -> Samples:
        """(n,) what residuals count in the place of their squares.

        ``residuals``: (n,); ``scale``: size from which on a residual counts less.
        """
        squares = (residuals / scale) ** 2
        match self:
            case Loss.SOFT_L1:
                counted = 2 * ((1 + squares) ** 0.5 - 1)
            case Loss.HUBER:
                counted = np.where(squares <= 1, squares, 2 * squares**0.5 - 1)
            case Loss.CAUCHY:
                counted = np.log1p(squares)
            case Loss.LINEAR:
                counted = squares
        return np.asarray(scale**2 * counted)

    def weights(self, residuals: Samples, scale: float) -> Samples:
        """(n,) slopes of `values` in the squares of the residuals."""
        squares = (residuals / scale) ** 2
        match self:
            case Loss.SOFT_L1:
                return np.asarray((1 + squares) ** -0.5)
            case Loss.HUBER:
                return np.asarray(np.maximum(squares, 1.0) ** -0.5)
            case Loss.CAUCHY:
                return np.asarray(1 / (1 + squares))
            case Loss.LINEAR:
                return np.ones_like(residuals)

    def slopes(self, residuals: Samples, scale: float) -> Samples:
        """(n,) slopes of the weighted residuals, `weights` times residuals, in the residuals."""
        squares = (residuals / scale) ** 2
        match self:
            case Loss.SOFT_L1:
                return np.asarray((1 + squares) ** -1.5)
            case Loss.HUBER:
                return np.asarray(squares <= 1, dtype=np.float64)
            case Loss.CAUCHY:
                return np.asarray((1 - squares) / (1 + squares) ** 2)
            case Loss.LINEAR:
                return np.ones_like(residuals)


def outlying(residuals: Samples) -> float:
    """Return the size from which on one of (n,) residuals is taken for an outlier."""
    return _OUTLYING * _NORMAL * float(np.median(np.abs(residuals)))
