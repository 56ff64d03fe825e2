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

from butterfly.errors import IdentifiabilityError, InputError, nearest, require_number
from butterfly.identify.covariance import cluster_covariance, compress
from butterfly.identify.identifiability import (
    SINGULAR_CONDITION,
    Conditioning,
    sort_by_precision,
)
from butterfly.identify.intervals import honest_limits
from butterfly.identify.weak_signals import HALF_WIDTH, Balance
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass, LumpedParameters
from butterfly.orbit.regression import BASE, FOLDS, Equations, Regression, least

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from butterfly.logs.log import Log

CANDIDATES = (
    *("coulomb", "drag", "p3_offset", "bias", "cogging", "cogging_cosine", "stribeck"),
    "compression",
)
"""Terms that can be estimated besides."""

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
    candidates: tuple[str, ...] = ("coulomb", "drag", "p3_offset", "bias", "compression")
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
        otherwise all but a compression are divided by the p1 of the hand with what it carried.
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
        factors = {"compression": 1.0}
        scaled = {name: factors.get(name, inertia) * value for name, value in values.items()}
        return LumpedParameters(p1=inertia, **scaled, cogging_periods=self.cogging_periods)


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
    masses = {log.added_mass for log in logs}
    base = BASE if len(masses) > 1 else BASE[1:]
    regression = Regression(logs, zero, options)
    _, _, plain = regression.fit(base)
    if not plain.segment.size or plain.segment[-1] < 2 * FOLDS:
        moving = plain.segment.size * options.half_width / 2
        raise IdentifiabilityError(
            f"{moving:.3g} s of motion are too little to re-calibrate: record longer runs"
        )
    names = (*base, *regression.select(base, options.candidates))
    values, on_bound, equations = regression.fit(names)
    conditioning = Conditioning.of(equations.rows, names)
    if conditioning.number > SINGULAR_CONDITION:
        raise IdentifiabilityError(
            f"these runs do not tell {' and '.join(conditioning.weakest)} apart (condition number "
            f"{conditioning.number:.1e}): perturb the start, hold several orbits, or add dither"
        )
    covariance, freedom = _covariance(equations, values)
    lower, upper = honest_limits(values, covariance, freedom, _without_each_run(equations))
    lower = np.maximum(lower, least(names))
    bounded = tuple(np.array(names)[on_bound].tolist())
    return Recalibration(
        method=options.balance.value,
        names=names,
        values=values,
        covariance=covariance,
        lower=lower,
        upper=upper,
        rejected=tuple(name for name in options.candidates if name not in names),
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


def _covariance(
    equations: Equations, values: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (n, n) covariance, clustered by segment, and (n,) degrees of freedom."""
    jacobian, residuals = equations.jacobian(values), equations.residuals(values)
    owned = [equations.segment == number for number in range(equations.segment[-1] + 1)]
    compressed = [compress(jacobian[own], residuals[own]) for own in owned]
    factors, rest = (np.array(each) for each in zip(*compressed, strict=True))
    return cluster_covariance(factors, rest)


def _without_each_run(equations: Equations) -> list[NDArray[np.float64]]:
    """Estimate again without each run, where enough are left to tell the parameters apart."""
    runs = np.unique(equations.run)
    found = []
    for run in runs if runs.size >= _FEWEST_RUNS else []:
        kept = equations.run != run
        if Conditioning.of(equations.rows[kept], equations.names).number < SINGULAR_CONDITION:
            found.append(equations.solve(kept)[0])
    return found
