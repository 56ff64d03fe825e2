"""Answers compared: whether a robot changed between two, and which estimator predicts best."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import count

import numpy as np
from scipy.special import chdtrc, fdtrc, ndtri, stdtr, stdtrit

from butterfly.arrays import Samples
from butterfly.errors import ButterflyError, InputError
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators import Estimator
from butterfly.identification.free_run import FitSummary
from butterfly.identification.identify import judged
from butterfly.identification.limits import widened
from butterfly.identification.validate import Gain, Split, cross_validate
from butterfly.model.terms import GROWING, PARAMETERS, TERMS
from butterfly.progress import Track, out_of_time, untracked
from butterfly.verdict import CONFIDENCE

LEVEL = 1 - CONFIDENCE
"""Level of significance: largest rate of false alarms."""

_OF_EACH = LEVEL / 2  # for the parameters one by one, by Holm's method
_OF_ALL = LEVEL / 2  # for all of them together
_POWER = float(ndtri(0.8))  # a detectable change is found four times in five
_INFORMATIVE = 0.9  # share of a prior's uncertainty; logs that leave more of it are no evidence
_SINGULAR = 1e12  # condition number of a correlation matrix


@dataclass(frozen=True)
class ParameterChange:
    """One parameter, or a ratio of two, before and after."""

    name: str  # of the parameter, or x/y of a ratio
    before: float
    after: float
    error: float  # standard error of the difference, not less than the intervals say
    freedom: float  # degrees of freedom of that error; infinite if not known
    count: int  # of parameters that are tested
    corrected: float = math.nan  # probability, corrected by Holm for their number; NaN of a ratio

    @property
    def difference(self) -> float:
        """After minus before."""
        return self.after - self.before

    @property
    def relative(self) -> float:
        """Difference over the value before; NaN if that is hardly known."""
        return self.difference / abs(self.before) if abs(self.before) > 2 * self.error else math.nan

    @property
    def probability(self) -> float:
        """Probability of the difference by chance, for this parameter alone."""
        freedom = min(self.freedom, _ALMOST_NORMAL)
        return float(2 * stdtr(freedom, -abs(self.difference) / self.error)) if self.error else 1.0

    @property
    def detectable(self) -> float:
        """Difference detectable with 80 % power."""
        return self.error * float(_quantile(self.freedom, 1 - _OF_EACH / self.count / 2) + _POWER)

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the difference, for this parameter alone."""
        reach = float(_quantile(self.freedom, 0.5 + CONFIDENCE / 2)) * self.error
        return self.difference - reach, self.difference + reach

    @property
    def changed(self) -> bool:
        """Whether it has changed significantly."""
        return self.corrected <= _OF_EACH


@dataclass(frozen=True, kw_only=True)
class Change:
    """Two identifications compared."""

    parameters: tuple[ParameterChange, ...]  # those that were estimated in both
    joint_probability: float  # of so large a difference of all by chance; NaN if not known
    ratio: ParameterChange | None  # of two parameters, that which has changed most clearly
    untested: dict[str, str]  # why other parameters are not tested

    @property
    def changed(self) -> tuple[ParameterChange, ...]:
        """The significantly changed parameters, the clearest first."""
        parameters = (parameter for parameter in self.parameters if parameter.changed)
        return tuple(sorted(parameters, key=lambda parameter: parameter.probability))

    @property
    def jointly_changed(self) -> bool:
        """Whether the parameters together have changed significantly."""
        return self.joint_probability <= _OF_ALL


def change(before: Estimate, after: Estimate) -> Change:
    """Test whether parameters differ between two estimates from independent logs.

    Each by Student's t with Welch's degrees of freedom, corrected for their number (Holm, Scand. J.
    Stat. 6, 1979); all together by Hotelling's T^2. Standard errors are at least those of
    the intervals, which held-out masses and competing models have widened. Each kind of test uses
    half of `LEVEL`. InputError if no parameter has an uncertainty in both.
    """
    untested = _untested(before, after)
    names = [name for name in before.names if name in after.names and name not in untested]
    if not names:
        problem = "no common parameter with a standard error"
        expected = "two identifications with methods that estimate standard errors"
        raise InputError("changed", "estimates", problem, expected)
    sides = [_Side.of(estimate, names) for estimate in (before, after)]
    difference = sides[1].values - sides[0].values
    (one, of_one), (other, of_other) = ((side.errors**2, side.freedom) for side in sides)
    with np.errstate(divide="ignore"):  # where both are infinite
        # of the sum of two variances (Welch, Biometrika 34, 1947)
        freedom = (one + other) ** 2 / (one**2 / of_one + other**2 / of_other)
    columns = (sides[0].values, sides[1].values, np.sqrt(one + other), freedom)
    rows = zip(names, *(column.tolist() for column in columns), strict=True)
    alone = [
        ParameterChange(name, first, second, error, degrees, len(names))
        for name, first, second, error, degrees in rows
    ]
    corrected = _holm(np.array([parameter.probability for parameter in alone])).tolist()
    parameters = tuple(
        replace(parameter, corrected=holm) for parameter, holm in zip(alone, corrected, strict=True)
    )
    covariance = sides[0].covariance + sides[1].covariance
    return Change(
        parameters=parameters,
        joint_probability=_joint_probability(difference, covariance, float(np.median(freedom))),
        ratio=_clearest_ratio(parameters, sides),
        untested=untested,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Side:
    """One estimate of n parameters: values, errors, degrees of freedom, covariance."""

    values: Samples
    errors: Samples
    freedom: Samples
    covariance: Samples

    @classmethod
    def of(cls, estimate: Estimate, names: Sequence[str]) -> _Side:
        rows = [estimate.names.index(name) for name in names]
        free = np.full(len(estimate.names), np.inf)
        freedom = (free if estimate.freedom is None else estimate.freedom)[rows]
        values, covariance = estimate.values[rows], estimate.covariance[np.ix_(rows, rows)]
        limits = np.array([estimate.lower[rows], estimate.upper[rows]])
        half = np.max(np.abs(limits - values), axis=0)  # a side that a bound cuts is the narrower
        spread = np.sqrt(np.diag(covariance))
        errors = np.maximum(spread, half / _quantile(freedom, 0.5 + CONFIDENCE / 2))
        left_out = [refit[rows] for refit in estimate.left_out.values()]
        likely = [rival.values[rows] for rival in estimate.rivals if rival.predicts]
        wide = widened(values, covariance, left_out, likely)
        scale = errors / np.sqrt(np.diag(wide))
        unsigned = [k for k, name in enumerate(names) if not TERMS[name].sign_observable]
        values[unsigned] = np.abs(values[unsigned])
        return cls(
            values=values,
            errors=errors,
            freedom=freedom,
            covariance=np.asarray(scale[:, None] * wide * scale),
        )


def _untested(before: Estimate, after: Estimate) -> dict[str, str]:
    """Return by name why a parameter cannot be compared."""
    both = (before, after)
    names = [name for estimate in both for name in (*estimate.names, *estimate.known.parameters)]
    why: dict[str, str] = {}
    for name in dict.fromkeys(names):
        known = [
            name in estimate.known.parameters and not _informed(estimate, name) for estimate in both
        ]
        fixed = [name in estimate.fixed or name in estimate.known.fixed for estimate in both]
        fitted = [name in estimate.names for estimate in both]
        if all(known):
            why[name] = "given in both"
        elif any(fixed):
            why[name] = f"fixed in {'both' if all(fixed) else _which(fixed)}"
        elif not all(fitted):
            why[name] = f"fitted only in {_which(fitted)}"
        elif not all(_uncertain(estimate, name) for estimate in both):
            why[name] = "without standard error"
    return why


def _informed(estimate: Estimate, name: str) -> bool:
    """Whether logs determine a parameter better than its prior."""
    if name not in estimate.names:
        return False
    error = estimate.standard_errors[estimate.names.index(name)]
    return bool(error < _INFORMATIVE * estimate.known.parameters[name].uncertainty)


def _which(flags: Sequence[bool]) -> str:
    return "the first" if flags[0] else "the second"


def _uncertain(estimate: Estimate, name: str) -> bool:
    row = estimate.names.index(name)
    limits = (estimate.lower[row], estimate.upper[row])
    return bool(estimate.covariance[row, row] > 0 and np.isfinite(limits).all())


def _holm(tails: Samples) -> Samples:
    """Return (n,) probabilities, corrected for their number."""
    order = np.argsort(tails)
    factors = np.arange(tails.size, 0, -1)
    corrected = np.empty_like(tails)
    corrected[order] = np.minimum(np.maximum.accumulate(factors * tails[order]), 1.0)
    return corrected


def _joint_probability(difference: Samples, covariance: Samples, freedom: float) -> float:
    """Return the probability of the distance by chance (Hotelling's T^2)."""
    count = difference.size
    spread = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(spread, spread)
    if np.linalg.cond(correlation) > _SINGULAR or freedom <= count:
        return math.nan
    distance = float(difference / spread @ np.linalg.solve(correlation, difference / spread))
    if math.isinf(freedom):
        return float(chdtrc(count, distance))
    rest = freedom - count + 1
    return float(fdtrc(count, rest, distance * rest / (freedom * count)))


def _clearest_ratio(
    parameters: Sequence[ParameterChange], sides: Sequence[_Side]
) -> ParameterChange | None:
    """Return the ratio of a torque to p1 whose logarithm changed by most standard errors."""
    names = [parameter.name for parameter in parameters]
    if "p1" not in names or any(np.any(side.values == 0) for side in sides):
        return None
    base, candidates = names.index("p1"), []
    for row, name in enumerate(names):
        if name not in GROWING.intersection(PARAMETERS) or row == base:
            continue
        ratios = [float(side.values[row] / side.values[base]) for side in sides]
        errors = []
        for side, ratio in zip(sides, ratios, strict=True):
            slope = np.array([1 / side.values[row], -1 / side.values[base]])
            pair = side.covariance[np.ix_([row, base], [row, base])]
            errors.append(abs(ratio) * math.sqrt(max(float(slope @ pair @ slope), 0.0)))
        moved = replace(parameters[row], before=ratios[0], after=ratios[1], corrected=math.nan)
        candidates.append(replace(moved, name=f"{name}/p1", error=math.hypot(*errors)))
    return min(candidates, key=lambda candidate: candidate.probability, default=None)


def _quantile(freedom: Samples | float, level: float) -> Samples:
    return np.asarray(stdtrit(np.minimum(freedom, _ALMOST_NORMAL), level))


_ALMOST_NORMAL = 1e9  # degrees of freedom, where Student's t is the normal distribution


@dataclass(frozen=True, kw_only=True, eq=False)
class Entry:
    """One estimator on one data set."""

    data: str  # its name; of several of one name, the later ones are *bench (2)*, *bench (3)*
    method: str  # its label
    in_sample: FitSummary | None  # of the logs that the estimator saw; None if it refused them
    held_out: FitSummary | None  # of what was left out; None if nothing could be
    left_out: str  # what was left out at a time, in words
    estimate: Estimate | None  # from all logs, judged; None if the estimator refused them
    seconds: float  # taken by the fit to all logs, checks included
    error: str  # why there is no estimate, or no held-out FIT
    fits: Samples | None = None  # (n,) FIT in per cent of what was held out of each log


def leaderboard(
    sets: Sequence[DataSet],
    estimators: Sequence[Estimator],
    *,
    split: Split = Split.AUTO,
    track: Track = untracked,
) -> list[Entry]:
    """Validate every estimator on every data set; best held-out median FIT first."""
    named: dict[str, DataSet] = {}
    for data in sets:
        names = (f"{data.name} ({k})" if k > 1 else data.name for k in count(1))
        name = next(candidate for candidate in names if candidate not in named)
        named[name] = replace(data, name=name)
    pairs = [(data, estimator) for data in named.values() for estimator in estimators]
    entries: list[Entry] = []
    for data, estimator in track(pairs, "Comparing estimators"):
        if entries and out_of_time("some of the estimators"):
            break
        entries.append(_entry(data, estimator, split))
    return sorted(entries, key=lambda entry: ([*named].index(entry.data), -_score(entry)))


def equals(entries: Sequence[Entry]) -> list[Entry]:
    """Return, of one data set's entries, the first and those within two standard errors of it."""
    best, *others = entries
    if best.fits is None:
        return [best]
    gains = [(entry, Gain.of(best.fits - entry.fits)) for entry in others if entry.fits is not None]
    return [best, *(entry for entry, gain in gains if not gain.mean > 2 * gain.error)]


def _score(entry: Entry) -> float:
    if entry.held_out is not None:
        return entry.held_out.median
    return -1e3 + (entry.in_sample.median if entry.in_sample is not None else -1e3)


def _entry(data: DataSet, estimator: Estimator, split: Split) -> Entry:
    begun = time.perf_counter()
    estimate, seen, held, error = None, None, None, ""
    seconds = 0.0
    try:
        data, estimate = judged(data, estimator)
        seconds = time.perf_counter() - begun
        seen = FitSummary.of(data.simulations.fits(estimate), estimate.horizon)
        held = cross_validate(data, estimator, split)
    except ButterflyError as problem:
        error = str(problem)
    return Entry(
        data=data.name,
        method=estimator.label,
        in_sample=seen,
        held_out=None if held is None else held.summary,
        left_out="" if held is None else held.division.left_out,
        estimate=estimate,
        seconds=seconds or time.perf_counter() - begun,
        error=error,
        fits=None if held is None else held.fits,
    )
