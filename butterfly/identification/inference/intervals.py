"""Intervals that hold more than the scatter of the data."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtrit

from butterfly.errors import IdentifiabilityError
from butterfly.identification.diagnostics.findings import Finding, FindingKind
from butterfly.identification.inference.covariance import FEW
from butterfly.identification.inference.identifiability import refuse_without_scale
from butterfly.model.known import Knowledge
from butterfly.model.parameters import AddedMass
from butterfly.verdict import Level

CONFIDENCE = 0.95
"""Level of all intervals."""

SPREADS = float(ndtri(0.5 + CONFIDENCE / 2))
"""Half width of an interval, in standard deviations of a normal distribution."""


def without_each_mass(
    masses: Iterable[AddedMass],
    refit: Callable[[AddedMass], NDArray[np.float64]],
    known: Knowledge,
    *,
    asked: bool,
    driven: bool = True,
) -> tuple[dict[Hashable, NDArray[np.float64]], list[Finding]]:
    """Estimate again without each added mass, but where the rest cannot determine the parameters.

    ``refit`` returns the (n,) estimates from all logs but those of one added mass. If what is known
    of the robot is exact, even one mass may be enough; a scale that rests on what is uncertain
    would tell of that alone. Returns the estimates, and what is to be said if there are none.
    """
    different = sorted(set(masses))
    if not asked:
        return {}, [Finding(kind=FindingKind.UNCHECKED)]
    left_out: dict[Hashable, NDArray[np.float64]] = {}
    sure = known.within(known.exact)
    for mass in different if len(different) > 1 else ():
        rest = [other for other in different if other != mass]
        try:
            refuse_without_scale(rest, sure, driven=driven)
            left_out[mass] = refit(mass)
        except IdentifiabilityError:
            continue
    few = Finding(kind=FindingKind.FEW_MASSES, number=len(different), severity=Level.CARE)
    return left_out, [] if left_out or known.scale else [few]


def of_few_logs(count: int) -> list[Finding]:
    """Say of how many logs the intervals are, where these are few: blocks of time vary less."""
    if count > FEW:
        return []
    return [Finding(kind=FindingKind.FEW_LOGS, number=count, severity=Level.CARE)]


def widened(
    values: NDArray[np.float64],
    covariance: NDArray[np.float64],
    left_out: Sequence[NDArray[np.float64]],
    rivals: Sequence[NDArray[np.float64]] = (),
) -> NDArray[np.float64]:
    """(n, n) covariance, wider along the ways that estimates of partial data and rivals went.

    Each of the first counts as if it were a limit of its interval (see `honest_limits`).
    """
    if left_out:
        apart = np.array(left_out) - values
        covariance = covariance + apart.T @ apart / SPREADS**2
    if rivals:
        apart = np.array(rivals) - values
        covariance = covariance + apart.T @ apart / len(rivals)
    return covariance


def honest_limits(
    values: NDArray[np.float64],
    covariance: NDArray[np.float64],
    freedom: NDArray[np.float64],
    left_out: Iterable[NDArray[np.float64]],
    rivals: Iterable[NDArray[np.float64]] = (),
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return Student's limits at `CONFIDENCE`, widened to hold the estimates of partial data.

    (n,) values, their (n, n) covariance and (n,) degrees of freedom. More logs do not help where
    the model is wrong in a way that depends on what was left out. Of rivals, fits that predict as
    well, any may be the right one, so that the limits hold what is as far from each.
    """
    reach = stdtrit(freedom, 0.5 + CONFIDENCE / 2) * np.sqrt(np.diag(covariance))
    likely, partial = np.array([values, *rivals]), np.array([values, *left_out])
    lower = np.minimum(likely.min(axis=0) - reach, partial.min(axis=0))
    upper = np.maximum(likely.max(axis=0) + reach, partial.max(axis=0))
    return lower, upper
