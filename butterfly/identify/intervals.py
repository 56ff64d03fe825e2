"""Intervals that hold more than the scatter of the data."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.special import stdtrit

from butterfly.identify.estimate import CONFIDENCE

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray


def honest_limits(
    values: NDArray[np.float64],
    covariance: NDArray[np.float64],
    freedom: NDArray[np.float64],
    left_out: Iterable[NDArray[np.float64]],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return Student's limits at `CONFIDENCE`, widened to hold the estimates of partial data.

    More logs do not help where the model is wrong in a way that depends on what was left out.

    Parameters
    ----------
    values, covariance, freedom
        (n,) estimates, their (n, n) covariance and (n,) degrees of freedom.
    left_out
        (n,) estimates with a part of the data left out.
    """
    reach = stdtrit(freedom, 0.5 + CONFIDENCE / 2) * np.sqrt(np.diag(covariance))
    candidates = np.array([values, *left_out])
    lower = np.minimum(values - reach, candidates.min(axis=0))
    upper = np.maximum(values + reach, candidates.max(axis=0))
    return lower, upper
