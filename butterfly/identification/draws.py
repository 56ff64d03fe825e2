"""Parameters drawn from what an estimate leaves open.

They are normally distributed about the estimate. The covariance is that of the scatter of the data,
widened as the intervals are: along the ways that the estimates without one added mass went, as if
each stood on a limit of its interval, and all by a common factor until no parameter is spread less
than its interval says. So a combination that the data know well stays well known. A draw beyond a
bound is moved to it, and the other parameters with it as they are correlated: to the nearest values
that are allowed in the metric of the covariance, as a least-squares fit with bounds ends there.

All draws have the same weight. That they are normal is the approximation for many data (Gelman et
al., Bayesian Data Analysis, 3rd ed. 2013, section 4.1): good where free runs are linear in the
parameters over their intervals.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import Samples, unit_diagonal
from butterfly.errors import IdentifiabilityError, InputError
from butterfly.identification.estimate import Estimate
from butterfly.identification.inference.covariance import honest_limits, widened
from butterfly.identification.levels import DRAWS, SPREADS
from butterfly.model.parameters import AddedMass, LumpedParameters
from butterfly.model.terms import lower_bounds

LEAST = 2 * DRAWS
"""Fewest draws, of which one lies beyond either edge of a band."""

COUNT = 5 * LEAST
"""Draws if no other number is asked for: five lie beyond either edge of a band."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ParameterDraws:
    """Parameters that an estimate leaves open."""

    estimate: Estimate
    values: Samples  # (m, n) of its n parameters

    @property
    def parameters(self) -> list[LumpedParameters]:
        """Each draw as parameters of the bare hand."""
        return [each.parameters for each in self.estimates()]

    def estimates(self, horizon: float | None = None) -> Iterator[Estimate]:
        """Yield the estimate with the values of each draw, to simulate logs over a horizon in s."""
        estimate = self.estimate if horizon is None else replace(self.estimate, horizon=horizon)
        for values in self.values:
            yield replace(estimate, values=values)


def draw_parameters(
    estimate: Estimate, count: int = COUNT, *, masses: Iterable[AddedMass] = (), seed: int = 0
) -> ParameterDraws:
    """Draw parameters within their bounds, all with the same weight.

    Each draw makes a joint with each of the added ``masses``: of inertia p1 + Z > 0 and without
    negative friction. InputError if fewer than `LEAST` are asked for, or the seed is negative;
    IdentifiabilityError without a covariance, or if hardly any draw is possible.
    """
    if count < LEAST:
        raise InputError("draws", "count", count, f"at least {LEAST}")
    if seed < 0:
        raise InputError("draws", "seed", seed, "0 or more")
    covariance = honest_covariance(estimate)
    lower, rng = lower_bounds(estimate.names) - estimate.values, np.random.default_rng(seed)
    different, root = tuple(set(masses)), covariance_root(covariance)
    found: list[Samples] = []
    for _ in range(count):
        moved = rng.standard_normal((count, root.shape[0])) @ root
        for row in np.flatnonzero(np.any(moved < lower, axis=1)):
            moved[row] = _within(moved[row], lower, covariance)
        found.extend(moved[_possible(moved, estimate, different)])
        if len(found) >= count:
            break
    else:
        raise IdentifiabilityError(
            f"the intervals are too wide: hardly any of {count**2} drawn sets of parameters is "
            "physical (positive inertia, friction that brakes)"
        )
    return ParameterDraws(estimate=estimate, values=estimate.values + found[:count])


def honest_covariance(estimate: Estimate) -> Samples:
    """(n, n) covariance as wide as the intervals, but for conditions beyond those seen."""
    limits = np.array([estimate.lower, estimate.upper])
    if not (np.isfinite(estimate.covariance).all() and np.isfinite(limits).all()):
        raise IdentifiabilityError(
            f"the method {estimate.method!r} gives no covariance, which drawing parameters needs"
        )
    apart = list(estimate.left_out.values())
    if estimate.freedom is not None:
        own = (estimate.values, estimate.covariance, estimate.freedom, apart, estimate.rivals)
        limits = np.clip(honest_limits(*own), *limits)
    covariance = widened(estimate.values, estimate.covariance, apart, estimate.rivals)
    widths = np.abs(limits - estimate.values)  # a side that a bound cuts is the narrower one
    spread = np.sqrt(np.diag(covariance))
    varies = spread > 0
    factor = np.max(widths.max(axis=0)[varies] / spread[varies], initial=0.0) / SPREADS
    return np.asarray(covariance * max(factor, 1.0) ** 2)


def covariance_root(covariance: Samples) -> Samples:
    """(n, n) matrix that gives rows of independent standard normal numbers a covariance."""
    correlation, spread = unit_diagonal(covariance)
    eigenvalues, axes = np.linalg.eigh(correlation)
    return np.asarray(np.sqrt(np.maximum(eigenvalues, 0.0))[:, None] * axes.T * spread)


def _within(moved: Samples, lower: Samples, covariance: Samples) -> Samples:
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


def _possible(moved: Samples, estimate: Estimate, masses: Iterable[AddedMass]) -> NDArray[np.bool_]:
    """(m,) whether (m, n) changes of the estimate make a joint with each mass."""
    possible = np.ones(len(moved), dtype=bool)
    for row, values in enumerate(estimate.values + moved):
        parameters = replace(estimate, values=values).parameters
        loaded = [parameters.with_added_mass(mass) for mass in masses]
        possible[row] = all(each.p1 > 0 and each.coulomb >= 0 for each in loaded)
    return possible
