"""Parameters drawn from what an estimate leaves open.

They are normally distributed about the estimate. The covariance is that of the scatter of the data,
widened as the intervals are: along the ways that the estimates without one added mass went, as if
each stood on a limit of its interval, and all by a common factor until no parameter is spread less
than its interval says. So a combination that the data know well stays well known. A draw beyond a
bound is moved to it, and the other parameters with it as they are correlated: to the nearest values
that are allowed in the metric of the covariance, as a least-squares fit with bounds ends there.

Normal draws are right where free runs are linear in the parameters: the sum of squared errors S is
then the quadratic S_l of the linearised runs. Where it is not, as where a joint sticks or swings to
another side of its resonance, a draw gets the weight exp(-(S - S_l)/(2 s)), but none above 1: a
quadratic that rises too steeply far out would else leave all weight to a few draws (importance
sampling from an approximate posterior, Gelman et al., Bayesian Data Analysis, 3rd ed. 2013, section
10.4, truncated as by Ionides, J. Comput. Graph. Stat. 17, 2008).

S is a sum over logs of mean squared errors relative to the log's motion: errors within a log are
dependent, so that it counts as one. The scale s is that of the draws themselves, for which the
quadratic part of S_l is n s on average over n parameters, as in a normal distribution; and not
below S/N of the estimate, the share of one of N independent logs.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import Samples, unit_diagonal
from butterfly.errors import IdentifiabilityError, InputError
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.free_run import Setting
from butterfly.identification.inference.covariance import honest_limits, widened
from butterfly.identification.levels import DRAWS, SPREADS
from butterfly.logs.log import Log
from butterfly.model.parameters import AddedMass, LumpedParameters
from butterfly.model.terms import lower_bounds
from butterfly.progress import Track, in_threads, out_of_time, untracked

LEAST = 2 * DRAWS
"""Fewest draws, of which one lies beyond either edge of a band."""

COUNT = 5 * LEAST
"""Draws if no other number is asked for: five lie beyond either edge of a band."""

LEFT_OUT = "some of the draws"
"""What is left out where time is over."""

_STEP = 0.02  # s, between the samples at which a band is worked out
_MOST_KEPT = 5e8  # bytes of angles that are kept from the weighing for the bands
_TINY = float(np.finfo(float).tiny)


@dataclass(frozen=True, kw_only=True, eq=False)
class ParameterDraws:
    """Parameters that an estimate leaves open."""

    estimate: Estimate
    values: Samples  # (m, n) of its n parameters
    weights: Samples  # (m,) how much each draw counts; they add up to 1
    runs: tuple[DrawnRun, ...] = ()  # what they made of logs when they were weighed

    def resampled(self, count: int, seed: int = 0) -> ParameterDraws:
        """Return so many draws that count alike (Kitagawa, J. Comput. Graph. Stat. 5, 1996)."""
        rng = np.random.default_rng(seed)
        at = (rng.uniform() + np.arange(count)) / count
        chosen = np.searchsorted(np.cumsum(self.weights), at).clip(max=len(self.weights) - 1)
        values = rng.permutation(self.values[chosen])
        return replace(self, values=values, weights=np.full(count, 1 / count), runs=())

    @property
    def effective_size(self) -> float:
        """As many equal draws tell as much: 1/sum of squared weights (Kong, 1992)."""
        return float(1 / np.sum(self.weights**2))

    @property
    def parameters(self) -> list[LumpedParameters]:
        """Each draw as parameters of the bare hand."""
        return [each.parameters for each in self.estimates()]

    def estimates(self, horizon: float | None = None) -> Iterator[Estimate]:
        """Yield the estimate with the values of each draw, to simulate logs over a horizon in s."""
        estimate = self.estimate if horizon is None else replace(self.estimate, horizon=horizon)
        for values in self.values:
            yield replace(estimate, values=values)

    def angles_of(self, log: Log, setting: Setting) -> Samples | None:
        """(m, k) angles in rad at the samples of a log's bands, if the draws were weighed by it."""
        return next((each.angles for each in self.runs if each.serves(log, setting)), None)


@dataclass(frozen=True, kw_only=True, eq=False)
class DrawnRun:
    """(m, k) angles in rad of one log with each of m draws, at the samples of its bands."""

    log: Log
    setting: Setting  # with the estimate itself
    angles: Samples

    def serves(self, log: Log, setting: Setting) -> bool:
        """Whether a log would be simulated alike: the same record, perhaps read again."""
        asked, own = (
            (each.time, each.measured, *each.command, np.array(each.initial_state))
            for each in (log, self.log)
        )
        return (
            (setting, log.added_mass, log.intersample)
            == (self.setting, self.log.added_mass, self.log.intersample)
        ) and all(map(np.array_equal, asked, own))


def samples_of_bands(log: Log) -> NDArray[np.intp]:
    """(k,) numbers of the samples of a log at which bands are worked out."""
    return np.arange(0, log.time.size, max(1, round(_STEP / log.mean_step)))


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
    return ParameterDraws(
        estimate=estimate, values=estimate.values + found[:count], weights=np.full(count, 1 / count)
    )


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


def weighed(
    draws: ParameterDraws, data: DataSet, *, bands: Sequence[Log] = (), track: Track = untracked
) -> ParameterDraws:
    """Return draws weighed by the estimate's logs, as time allows; keep runs of ``bands``."""
    kept = sum(samples_of_bands(log).nbytes for log in bands) * len(draws.values)
    wanted = {log.name for log in bands} if kept <= _MOST_KEPT else set()
    numbers = range(len(data.logs))
    logs = in_threads(lambda k: _Followed(data, k, draws.estimate, wanted), numbers, untracked, "")
    for done in track(range(0, len(draws.values), LEAST), "Weighing draws"):
        if done and out_of_time(LEFT_OUT):
            draws = replace(draws, values=draws.values[:done])
            break
        some = replace(draws, values=draws.values[done : done + LEAST])
        in_threads(partial(_Followed.simulate, draws=some), logs, untracked, "")
    start = float(np.sum([each.start for each in logs]))
    slope, curvature, risen = (
        np.sum(parts, axis=0)
        for parts in zip(*((each.slope, each.curvature, each.risen) for each in logs), strict=True)
    )
    moved = draws.values - draws.estimate.values
    quadratic = np.sum(moved @ curvature * moved, axis=1)
    scale = max(float(np.mean(quadratic)) / moved.shape[1], start / len(logs), _TINY)
    worse = risen - (2 * moved @ slope + quadratic)
    weights = np.exp(-np.maximum(worse, 0.0) / (2 * scale))
    runs = tuple(each.run for each in logs if each.angles)
    return replace(draws, weights=weights / np.sum(weights), runs=runs)


class _Followed:
    """How one log's mean squared error, relative to its motion, depends on n parameters.

    It is ``start`` with the estimate; its half (n,) ``slope``, half the (n, n) second derivative of
    the linearised run, ``curvature``, and by what it has ``risen`` with each draw so far.
    """

    def __init__(
        self, data: DataSet, number: int, estimate: Estimate, wanted: Container[str]
    ) -> None:
        self._log, self._setting = data.logs[number], partial(data.simulations.setting, number)
        self._own = own = self._setting(estimate)
        self._simulation = data.simulations.simulation(number, own)
        errors, rows, mixture = self._simulation.linearised(
            estimate.names, own.parameters, own.zero, own.velocity
        )
        jacobian = rows @ mixture
        self._square = self._log.rms_measured**2 or _TINY
        self._shown = samples_of_bands(self._log) if self._log.name in wanted else None
        scale = errors.size * self._square
        self.start = own.run(self._simulation).rms ** 2 / self._square
        self.slope, self.curvature = jacobian.T @ errors / scale, jacobian.T @ jacobian / scale
        self.risen: list[float] = []
        self.angles: list[Samples] = []  # at the samples of its bands, if they are wanted

    def simulate(self, draws: ParameterDraws) -> None:
        """Simulate the log with further draws."""
        for each in draws.estimates(self._own.horizon):
            run = self._setting(each).run(self._simulation)
            self.risen.append(run.rms**2 / self._square - self.start)
            if self._shown is not None:
                self.angles.append(run.simulated[self._shown])

    @property
    def run(self) -> DrawnRun:
        """What the draws made of it."""
        return DrawnRun(log=self._log, setting=self._own, angles=np.array(self.angles))
