"""Intervals that hold more than the scatter of the data."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.special import stdtrit

from butterfly.errors import IdentifiabilityError
from butterfly.identify.estimate import CONFIDENCE
from butterfly.identify.identifiability import refuse_one_mass

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from numpy.typing import NDArray

    from butterfly.model.parameters import AddedMass


def without_each_mass(
    masses: Iterable[AddedMass], refit: Callable[[AddedMass], NDArray[np.float64]]
) -> dict[AddedMass, NDArray[np.float64]]:
    """Estimate again without each added mass, but where the rest cannot determine the parameters.

    Parameters
    ----------
    masses
        Of the logs.
    refit
        Returns the (n,) estimates from all logs but those of one added mass.
    """
    different = sorted(set(masses))
    left_out = {}
    for mass in different:
        try:
            refuse_one_mass(other for other in different if other != mass)
            left_out[mass] = refit(mass)
        except IdentifiabilityError:
            continue
    return left_out


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
