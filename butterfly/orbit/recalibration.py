"""Re-calibrate the model next to an orbit, from logs of the control loop itself.

The equation of motion (or its product with the velocity, the balance of energy) against test
functions is linear in the parameters, whatever controller made the input; see
`butterfly.identify.weak_signals`. One robot without a known mass gives the ratios p_i/p1 alone,
which is all that a controller needs; logs with another known mass set the scale.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import lsq_linear

from butterfly.errors import IdentifiabilityError, InputError, nearest, require_number
from butterfly.identify.covariance import cluster_covariance, compress
from butterfly.identify.estimate import lower_bounds
from butterfly.identify.identifiability import (
    SINGULAR_CONDITION,
    Conditioning,
    sort_by_precision,
)
from butterfly.identify.intervals import honest_limits
from butterfly.identify.weak_signals import HALF_WIDTH, Balance, weak_signals
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass, LumpedParameters

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from butterfly.logs.log import Log

BASE = ("p1", "p2", "p3", "p4")
"""Always estimated."""

CANDIDATES = ("coulomb", "drag", "p3_offset", "bias", "cogging", "cogging_cosine", "stribeck")
"""Terms that can be estimated besides."""

_SEGMENT = 10  # test functions in a row, which share noise; segments count as independent
_FOLDS = 5
_SIGNIFICANT = 2.0  # standard errors by which a term must lower the held-out loss
_LARGEST_STICK = 0.05  # share of a window that may stand still
_FEWEST_RUNS = 3  # to leave one out


@dataclass(frozen=True, kw_only=True)
class RecalibrationOptions:
    """How to re-calibrate.

    Parameters
    ----------
    balance
        Of momentum (the weak form) or of energy.
    candidates
        Of `CANDIDATES`; each is kept only if it predicts held-out parts of the logs better.
    half_width
        Of the test functions in s.
    delay
        From input to torque in s, as known.
    cogging_periods
        Of the cogging torque in a turn, as known; the sine of one period a turn is what p3 is.
    """

    balance: Balance = Balance.MOMENTUM
    candidates: tuple[str, ...] = ("coulomb", "drag", "p3_offset", "bias")
    half_width: float = HALF_WIDTH
    delay: float = 0.0
    cogging_periods: float = 1.0

    def __post_init__(self) -> None:
        for name in self.candidates:
            if name not in CANDIDATES:
                raise InputError("recalibration", "candidates", name, nearest(name, CANDIDATES))
        if "cogging" in self.candidates and self.cogging_periods == 1:
            expected = "2 or more: one period a turn cannot be told from p3"
            raise InputError("recalibration", "cogging_periods", 1, expected)
        require_number("recalibration", positive=True, half_width=self.half_width)
        require_number("recalibration", delay=self.delay)


@dataclass(frozen=True, kw_only=True, eq=False)
class Recalibration:
    """Parameters next to an orbit, and how far to trust them.

    Parameters
    ----------
    method
        How they were obtained.
    names, values, covariance
        n names, (n,) values and their (n, n) covariance; p1 is among them if they are absolute,
        otherwise all are divided by the p1 of the hand with what it carried.
    lower, upper
        (n,) limits of 95 % intervals, widened to hold the estimates that leave one run out.
    rejected
        Candidates that did not help.
    on_bound
        Parameters held at 0.
    condition
        Condition number of the column-scaled regression.
    carried
        The added mass, if all logs had the same one.
    cogging_periods
        Of a cogging torque.
    verdict
        What can be concluded, in words.
    """

    method: str
    names: tuple[str, ...]
    values: NDArray[np.float64]
    covariance: NDArray[np.float64]
    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    rejected: tuple[str, ...]
    on_bound: tuple[str, ...]
    condition: float
    carried: AddedMass | None
    cogging_periods: float
    verdict: tuple[str, ...]

    @property
    def is_absolute(self) -> bool:
        """Whether p1 is known, not ratios to it alone."""
        return "p1" in self.names

    @property
    def standard_errors(self) -> NDArray[np.float64]:
        """(n,) square roots of the variances."""
        return np.sqrt(np.diag(self.covariance))

    def loaded(self, added: AddedMass = NO_ADDED_MASS, inertia: float = 1.0) -> LumpedParameters:
        """Return the parameters of the hand carrying a mass.

        Parameters
        ----------
        added
            What it carries.
        inertia
            p1 of the hand so loaded, where the estimate is of ratios.

        Raises
        ------
        IdentifiabilityError
            If the estimate is of ratios, with another added mass.
        """
        values = dict(zip(self.names, self.values.tolist(), strict=True))
        if self.is_absolute:
            bare = LumpedParameters(**values, cogging_periods=self.cogging_periods)
            return bare.with_added_mass(added)
        if added != self.carried:
            raise IdentifiabilityError(
                f"ratios p_i/p1 with {self.carried} say nothing of the hand with {added}: "
                "re-calibrate with both"
            )
        scaled = {name: inertia * value for name, value in values.items()}
        return LumpedParameters(p1=inertia, **scaled, cogging_periods=self.cogging_periods)


@dataclass(frozen=True, eq=False)
class _Segment:
    """A few consecutive test functions of one run: columns by parameter, and the known torque."""

    run: int
    columns: dict[str, NDArray[np.float64]]
    known: NDArray[np.float64]

    def equations(self, names: Sequence[str]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(m, n) regressors and (m,) targets; without p1 among the names it is taken as 1."""
        known = self.known if "p1" in names else self.columns["p1"]
        return np.column_stack([self.columns[name] for name in names]), -known


def recalibrate(
    logs: Sequence[Log], zero: float, options: RecalibrationOptions = RecalibrationOptions()
) -> Recalibration:
    """Estimate p1..p4 and friction terms by constrained linear least squares.

    Parameters
    ----------
    logs
        Of runs next to the orbit, none of them quite on it: there the control only makes up for
        friction, and nothing is told apart.
    zero
        Encoder reading in rad of the hanging hand.
    options
        See `RecalibrationOptions`.

    Raises
    ------
    IdentifiabilityError
        If the logs cannot tell the parameters apart.
    InputError
        If a log is shorter than a test function.
    """
    segments = [part for k, log in enumerate(logs) for part in _segments(k, log, zero, options)]
    masses = {log.added_mass for log in logs}
    base = BASE if len(masses) > 1 else BASE[1:]
    if len(segments) < 2 * _FOLDS:
        raise IdentifiabilityError(
            f"{len(segments)} s of motion are too little to re-calibrate: record longer runs"
        )
    terms = _select(segments, base, options.candidates)
    names = (*base, *terms)
    rows, target = _stack(segments, names)
    conditioning = Conditioning.of(rows, names)
    if conditioning.number > SINGULAR_CONDITION:
        raise IdentifiabilityError(
            f"these runs do not tell {' and '.join(conditioning.weakest)} apart (condition number "
            f"{conditioning.number:.1e}): perturb the start, hold several orbits, or add dither"
        )
    values, on_bound = _solve(rows, target, names)
    parts = [part.equations(names) for part in segments]
    compressed = [compress(r, r @ values - t) for r, t in parts]
    factors, residuals = (np.array(each) for each in zip(*compressed, strict=True))
    covariance, freedom = cluster_covariance(factors, residuals)
    lower, upper = honest_limits(values, covariance, freedom, _without_each(segments, names))
    lower = np.maximum(lower, least(names))
    bounded = tuple(np.array(names)[on_bound].tolist())
    return Recalibration(
        method=options.balance.value,
        names=names,
        values=values,
        covariance=covariance,
        lower=lower,
        upper=upper,
        rejected=tuple(name for name in options.candidates if name not in terms),
        on_bound=bounded,
        condition=conditioning.number,
        carried=masses.pop() if len(masses) == 1 else None,
        cogging_periods=options.cogging_periods,
        verdict=(
            "Absolute values, the scale set by the known masses."
            if "p1" in names
            else "Ratios to p1: no known mass was changed, and a controller needs no more.",
            sort_by_precision(values, lower, upper, names),
            *conditioning.words(),
            *([f"{', '.join(bounded)} on the bound 0."] if bounded else []),
        ),
    )


def _segments(run: int, log: Log, zero: float, options: RecalibrationOptions) -> list[_Segment]:
    signals = weak_signals(
        log,
        zero,
        options.half_width,
        options.delay,
        balance=options.balance,
        cogging_periods=options.cogging_periods,
    )
    moving = np.flatnonzero(signals.still < _LARGEST_STICK)
    columns = {name: signals.mean[name] for name in (*BASE, *options.candidates)}
    added = log.added_mass
    known = added.inertia * columns["p1"] + added.gravity_moment * columns["p3"]
    parts = [moving[k : k + _SEGMENT] for k in range(0, moving.size, _SEGMENT)]
    return [_Segment(run, {n: c[part] for n, c in columns.items()}, known[part]) for part in parts]


def _stack(
    segments: Sequence[_Segment], names: Sequence[str]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    rows, targets = zip(*(part.equations(names) for part in segments), strict=True)
    return np.concatenate(rows), np.concatenate(targets)


def least(names: Sequence[str]) -> NDArray[np.float64]:
    """(n,) least values of parameters: as everywhere, and the input drives forwards."""
    return np.where(np.array(names) == "p4", 0.0, lower_bounds(names))


def _solve(
    rows: NDArray[np.float64], target: NDArray[np.float64], names: Sequence[str]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return (n,) values, and which are held by a bound."""
    scale = np.linalg.norm(rows, axis=0)
    fit = lsq_linear(rows / scale, target, (least(names), np.inf), method="bvls", tol=1e-14)
    return fit.x / scale, np.asarray(fit.active_mask != 0)


def _without_each(segments: Sequence[_Segment], names: Sequence[str]) -> list[NDArray[np.float64]]:
    """Estimate again without each run, where enough are left to tell the parameters apart."""
    runs = {part.run for part in segments}
    found = []
    for run in sorted(runs) if len(runs) >= _FEWEST_RUNS else []:
        rows, target = _stack([part for part in segments if part.run != run], names)
        if Conditioning.of(rows, tuple(names)).number < SINGULAR_CONDITION:
            found.append(_solve(rows, target, names)[0])
    return found


def _select(
    segments: Sequence[_Segment], base: tuple[str, ...], candidates: Sequence[str]
) -> tuple[str, ...]:
    """Add terms one by one, the most helpful first, while held-out segments gain by it."""
    chosen: tuple[str, ...] = ()
    losses = _held_out_losses(segments, base)
    while True:
        gains = {
            name: losses - _held_out_losses(segments, (*base, *chosen, name))
            for name in candidates
            if name not in chosen
        }
        scores = {name: _score(gain) for name, gain in gains.items()}
        best = max(scores, key=lambda name: scores[name], default="")
        if not best or scores[best] < _SIGNIFICANT:
            return chosen
        chosen = (*chosen, best)
        losses = losses - gains[best]


def _score(gain: NDArray[np.float64]) -> float:
    """Mean gain over its standard error."""
    return float(gain.mean() / max(gain.std(ddof=1) / gain.size**0.5, 1e-300))


def _held_out_losses(segments: Sequence[_Segment], names: Sequence[str]) -> NDArray[np.float64]:
    """(k,) mean squared residuals of k segments, each by a fit that has not seen it."""
    losses = np.zeros(len(segments))
    for fold in range(_FOLDS):
        seen = [part for k, part in enumerate(segments) if k % _FOLDS != fold]
        values, _ = _solve(*_stack(seen, names), names)
        for k in range(fold, len(segments), _FOLDS):
            rows, target = segments[k].equations(names)
            losses[k] = np.mean((rows @ values - target) ** 2)
    return losses
