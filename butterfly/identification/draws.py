"""Parameters drawn from what an estimate leaves open.

They are normally distributed about the estimate. The covariance is that of the scatter of the data,
widened as the intervals are: along the ways that the estimates without one added mass went, as if
each stood on a limit of its interval, and all by a common factor until no parameter is spread less
than its interval says. So a combination that the data know well stays well known. A draw beyond a
bound is moved to it, and the other parameters with it as they are correlated: to the nearest values
that are allowed in the metric of the covariance, as a least-squares fit with bounds ends there.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from butterfly.errors import IdentifiabilityError, InputError
from butterfly.identification.estimate import Estimate
from butterfly.identification.inference.intervals import SPREADS, widened
from butterfly.model.parameters import AddedMass, LumpedParameters
from butterfly.model.terms import lower_bounds

COUNT = 200
"""Draws if no other number is asked for: five lie beyond either edge of a band."""

LEAST = 40
"""Fewest draws, of which one lies beyond either edge of a band."""

_ROUNDS = 100  # of drawing again, until as many as wanted are possible


@dataclass(frozen=True, kw_only=True, eq=False)
class ParameterDraws:
    """Parameters that an estimate leaves open.

    Parameters
    ----------
    estimate
        From which they are drawn.
    values
        (m, n) values of its n parameters.
    weights
        (m,) how much each counts; they add up to 1.
    """

    estimate: Estimate
    values: NDArray[np.float64]
    weights: NDArray[np.float64]

    @property
    def effective_size(self) -> float:
        """As many equal draws tell as much: 1/sum of squared weights (Kong, 1992)."""
        return float(1 / np.sum(self.weights**2))

    @property
    def parameters(self) -> list[LumpedParameters]:
        """Each draw as parameters of the bare hand."""
        return [each.parameters for each in self.estimates()]

    def estimates(self) -> Iterator[Estimate]:
        """Yield the estimate with the values of each draw in place of its own."""
        for values in self.values:
            yield replace(self.estimate, values=values)

    def weighted(self, weights: NDArray[np.float64]) -> ParameterDraws:
        """Return the draws with other (m,) weights, of any sum."""
        return replace(self, weights=weights / np.sum(weights))


def draw_parameters(
    estimate: Estimate,
    count: int = COUNT,
    *,
    masses: Iterable[AddedMass] = (),
    seed: int = 0,
) -> ParameterDraws:
    """Draw parameters within their bounds, all with the same weight.

    Parameters
    ----------
    estimate
        With covariance and intervals.
    count
        How many.
    masses
        Added masses with which each draw has to make a joint: of inertia p1 + Z > 0 and without
        negative friction.
    seed
        Fixes the draws.

    Raises
    ------
    InputError
        If fewer than `LEAST` are asked for, or the seed is negative.
    IdentifiabilityError
        If the estimate has no covariance, or hardly any draw is possible.
    """
    if count < LEAST:
        raise InputError("draws", "count", count, f"at least {LEAST}")
    if seed < 0:
        raise InputError("draws", "seed", seed, "0 or more")
    covariance = honest_covariance(estimate)
    lower, rng = lower_bounds(estimate.names) - estimate.values, np.random.default_rng(seed)
    different, root = tuple(set(masses)), covariance_root(covariance)
    found: list[NDArray[np.float64]] = []
    for _ in range(_ROUNDS):
        moved = rng.standard_normal((count, root.shape[0])) @ root
        for row in np.flatnonzero(np.any(moved < lower, axis=1)):
            moved[row] = _within(moved[row], lower, covariance)
        found.extend(moved[_possible(moved, estimate, different)])
        if len(found) >= count:
            break
    else:
        raise IdentifiabilityError(
            f"the intervals are so wide that hardly any of {_ROUNDS * count} sets of parameters "
            "makes a joint: one with inertia, and with friction that brakes"
        )
    return ParameterDraws(
        estimate=estimate, values=estimate.values + found[:count], weights=np.full(count, 1 / count)
    )


def honest_covariance(estimate: Estimate) -> NDArray[np.float64]:
    """(n, n) covariance whose spreads are at least those of the intervals.

    Raises
    ------
    IdentifiabilityError
        If the estimate has none.
    """
    limits = np.array([estimate.lower, estimate.upper])
    if not (np.isfinite(estimate.covariance).all() and np.isfinite(limits).all()):
        raise IdentifiabilityError(
            f"the method {estimate.method!r} gives no covariance to draw parameters from"
        )
    apart = list(estimate.left_out.values())
    covariance = widened(estimate.values, estimate.covariance, apart, estimate.rivals)
    widths = np.abs(limits - estimate.values)  # a side that a bound cuts is the narrower one
    spread = np.sqrt(np.diag(covariance))
    varies = spread > 0
    factor = np.max(widths.max(axis=0)[varies] / spread[varies], initial=0.0) / SPREADS
    return np.asarray(covariance * max(factor, 1.0) ** 2)


def covariance_root(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, n) matrix that gives rows of independent standard normal numbers a covariance."""
    spread = np.sqrt(np.diag(covariance))
    spread[spread == 0] = 1.0  # of what does not vary
    eigenvalues, axes = np.linalg.eigh(covariance / np.outer(spread, spread))
    return np.asarray(np.sqrt(np.maximum(eigenvalues, 0.0))[:, None] * axes.T * spread)


def _within(
    moved: NDArray[np.float64], lower: NDArray[np.float64], covariance: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Move (n,) values to (n,) bounds that they are beyond, the others as they are correlated."""
    bound = moved < lower
    result = moved
    for _ in range(moved.size):
        back = np.linalg.lstsq(
            covariance[np.ix_(bound, bound)], moved[bound] - lower[bound], rcond=None
        )[0]
        result = np.where(bound, lower, moved - covariance[:, bound] @ back)
        if np.all(result >= lower):
            break
        bound |= result < lower
    return np.asarray(result)


def _possible(
    moved: NDArray[np.float64], estimate: Estimate, masses: Iterable[AddedMass]
) -> NDArray[np.bool_]:
    """(m,) whether (m, n) changes of the estimate make a joint with each mass."""
    possible = np.ones(len(moved), dtype=bool)
    for row, values in enumerate(estimate.values + moved):
        parameters = replace(estimate, values=values).parameters
        loaded = [parameters.with_added_mass(mass) for mass in masses]
        possible[row] = all(each.p1 > 0 and each.coulomb >= 0 for each in loaded)
    return possible
