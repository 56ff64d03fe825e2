"""The balance of fundamentals, solved: weighted linear least squares, and the weights anew."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from butterfly.errors import IdentifiabilityError
from butterfly.identification.diagnostics.findings import Finding, FindingKind
from butterfly.identification.inference.submodels import Nested
from butterfly.identification.inference.term_choice import NEGLIGIBLE
from butterfly.identification.phasors import Phasors
from butterfly.identification.prior import Prior
from butterfly.identification.regression import Regression
from butterfly.identification.solved import Solved
from butterfly.model.parameters import LumpedParameters
from butterfly.model.terms import PARAMETERS, lower_bounds
from butterfly.verdict import Level

_MAX_ITERATIONS = 60
_TOLERANCE = 1e-10  # relative change of the predicted angles


@dataclass(frozen=True, kw_only=True, eq=False)
class DescribingFit:
    """A balance and its solution.

    Parameters
    ----------
    phasors
        What was balanced.
    weights
        (n,) of the n logs.
    regression, solved
        The equations about the solution, and the solution.
    """

    phasors: Phasors
    weights: NDArray[np.float64]
    regression: Regression
    solved: Solved

    @classmethod
    @np.errstate(divide="ignore", over="ignore", invalid="ignore")
    def of(cls, phasors: Phasors) -> DescribingFit:
        """Solve, weigh by the slopes and errors at the solution, and solve again until it rests.

        Raises
        ------
        IdentifiabilityError
            If no solution is a number.
        """
        count = len(phasors.names)
        known = phasors.known.exact
        values, weights = np.zeros(count), np.ones(phasors.omega.size)
        delay, gain = known.get("delay", 0.0), known.get("p4", 0.0)
        for _ in range(_MAX_ITERATIONS):
            matrix, target = phasors.equations(delay)
            regression = _regression(phasors, (matrix, target), weights, delay, gain)
            solution = regression.solve()
            before, unknowns = (regression.unknowns(each) for each in (values, solution.values))
            values = solution.values
            slope = phasors.slope(values)
            swing = np.abs(phasors.angle)
            errors = np.abs(matrix @ unknowns - target) / (slope * swing)
            if not np.isfinite(errors).all():
                raise IdentifiabilityError(
                    "no joint's response balances these logs: check their units"
                )
            variance = phasors.variance + phasors.doubt
            spread = _model_variance(errors, variance / swing**2, count)
            weights = 1.0 / (slope * np.sqrt(variance + spread * swing**2))
            if "delay" in phasors.names:
                delay = float(values[phasors.names.index("delay")])
            if "p4" in phasors.names:
                gain = float(values[phasors.names.index("p4")])
            change = np.linalg.norm(regression.rows @ (unknowns - before))
            settled = bool(change < _TOLERANCE * np.linalg.norm(regression.rows @ unknowns))
            if settled:
                break
        rounds = Finding(kind=FindingKind.ROUNDS, number=_MAX_ITERATIONS, severity=Level.WARNING)
        solved = Solved.of(regression, solution, unsettled=None if settled else rounds)
        return cls(phasors=phasors, weights=weights, regression=regression, solved=solved)

    @property
    def parameters(self) -> LumpedParameters:
        """The solution as parameters of the model."""
        return self.phasors.described(self.solved.values)

    @property
    def idle(self) -> tuple[str, ...]:
        """Terms that a bound holds at nothing."""
        names = zip(self.phasors.names, self.solved.on_bound.tolist(), strict=True)
        kept = {*PARAMETERS, *self.phasors.known.parameters}
        return tuple(name for name, held in names if held and name not in kept)

    def without(self, terms: tuple[str, ...]) -> DescribingFit:
        """Return the fit without some terms."""
        names = tuple(name for name in self.phasors.names if name not in terms)
        return DescribingFit.of(replace(self.phasors, names=names))

    def moved_to(self, other: DescribingFit) -> float:
        """Return by what share of its errors another fit of the same names lies elsewhere."""
        there = self.regression.unknowns(other.solved.values)
        here = self.regression.unknowns(self.solved.values)
        left = float(np.linalg.norm(self.solved.residuals))
        return float(np.linalg.norm(self.regression.rows @ (there - here))) / left if left else 0.0

    def nested(self, phasors: Phasors, folds: NDArray[np.intp]) -> Nested:
        """Return the equations of a balance with more terms, as this one weighs them.

        Their unknowns are the parameters, but for the delay: of that, p4 (delay - this one's).
        """
        known = dict(zip(self.phasors.names, self.solved.values.tolist(), strict=True))
        balance = phasors.equations(self._delay)
        gain = self.parameters.p4
        regression = _regression(phasors, balance, self.weights, self._delay, gain)
        unknowns = np.array([0.0 if n == "delay" else known.get(n, 0.0) for n in phasors.names])
        residuals = regression.rows @ unknowns - regression.target
        count = phasors.omega.size
        slope, swing = self.phasors.slope(self.solved.values), np.abs(self.phasors.angle)
        nested = Nested.of(
            regression.rows.reshape(2, count, -1).swapaxes(0, 1),
            residuals.reshape(2, count).T,
            names=phasors.names,
            values=unknowns,
            lower=lower_bounds(phasors.names),
            folds=folds,
        )
        prior = regression.turned_prior
        return replace(
            nested,
            prior=prior,
            negligible=NEGLIGIBLE * float(np.mean(self.weights * slope * swing)),
        )

    def values_of(self, names: tuple[str, ...], unknowns: dict[str, float]) -> NDArray[np.float64]:
        """Return the values of parameters from unknowns of `nested`; 0 if there is none."""
        found = unknowns
        if "delay" in unknowns:
            gain = unknowns.get("p4", self.parameters.p4) or np.inf
            found = unknowns | {"delay": self._delay + unknowns["delay"] / gain}
        return np.array([found.get(name, 0.0) for name in names])

    @property
    def _delay(self) -> float:
        return self.parameters.delay


def _regression(
    phasors: Phasors,
    balance: tuple[NDArray[np.complex128], NDArray[np.complex128]],
    weights: NDArray[np.float64],
    delay: float,
    gain: float,
) -> Regression:
    """Weigh the equations of a balance about a delay."""
    matrix, target = balance
    return Regression(
        names=phasors.names,
        rows=_real(matrix * weights[:, None]),
        target=_real(target * weights),
        cluster=np.tile(np.arange(phasors.omega.size), 2),
        about={"delay": delay},
        gain=gain,
        prior=Prior.of(phasors.names, phasors.known.parameters),
    )


def _real(values: NDArray[np.complex128]) -> NDArray[np.float64]:
    return np.concatenate([values.real, values.imag])


def _model_variance(
    errors: NDArray[np.float64], variance: NDArray[np.float64], count: int
) -> float:
    """Relative variance per component, common to all logs, that ``variance`` does not explain."""
    freedom = 2 * errors.size - count

    def excess(common: float) -> float:
        return float(np.sum(errors**2 / (variance + common))) - freedom

    largest = float(np.sum(errors**2)) / freedom
    if excess(0.0) <= 0:
        return 0.0
    return float(brentq(excess, 1e-12 * largest, largest * (1 + 1e-9), xtol=1e-9 * largest))
