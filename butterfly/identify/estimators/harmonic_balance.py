"""The default method: one linear regression over all logs, at their own finite amplitudes.

At each log's frequency w, with the phasors th of the angle and u of the input and a = |th|, the
balance of the fundamental of (78) with Coulomb friction and an input delay d reads

    [-(p1 + Z) w^2 + j w p2 + (p3 + X) 2 J1(a)/a + j 4 T_c/(pi a)] th = p4 e^(-j w d) u

which is linear in p1, p2, p3, T_c, p4 and, to first order about the current delay, in p4 d; so are
the describing functions of all other terms that it offers. The
known Z = m l^2 and X = m g l set the scale, so two different added masses are needed. Each row is
divided by the slope of its left-hand side in th at the previous iterate (Sanathanan & Koerner,
IEEE Trans. Autom. Control 8, 1963), which turns equation errors into angle errors, and by the
angle error's standard deviation: the measured one of the phasor, and one in proportion to the
swing, common to all logs, that makes room for what the model leaves out (Paule & Mandel, J. Res.
NBS 87, 1982).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
from scipy.optimize import brentq

from butterfly.errors import IdentifiabilityError
from butterfly.identify.estimate import ParameterEstimate, Solved
from butterfly.identify.estimators.base import Estimator, names_of
from butterfly.identify.judgement.findings import Finding, FindingKind, Severity
from butterfly.identify.judgement.identifiability import refuse_one_mass
from butterfly.identify.judgement.intervals import without_each_mass
from butterfly.identify.phasors import Phasors
from butterfly.identify.regression import Regression

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from butterfly.identify.data import DataSet
    from butterfly.model.parameters import AddedMass
    from butterfly.signals.frequency_response import ResponsePoint

LINEAR = ("p1", "p2", "p3", "p4")
"""What is estimated in the limit of small swings without Coulomb friction and delay."""

_MAX_ITERATIONS = 60
_TOLERANCE = 1e-10  # relative change of the predicted angles


@dataclass(frozen=True, kw_only=True)
class HarmonicBalance(Estimator):
    """p1..p4, Coulomb torque, delay and terms from the steady responses of all sines.

    At least four logs, with at least two different added masses (none counts as one). The
    covariance is the cluster-robust one over logs; the intervals are widened to hold the estimates
    that leave one added mass out.

    Parameters
    ----------
    terms
        Fitted besides p1..p4, Coulomb torque and delay.
    check
        Whether to fit again without each added mass.
    """

    method: Literal["harmonic-balance"] = "harmonic-balance"
    terms: tuple[str, ...] = ()
    check: bool = True

    summary: ClassVar[str] = "joint linear fit of the steady responses"

    def __post_init__(self) -> None:
        names_of(self.method, self.terms)

    def __call__(self, data: DataSet) -> ParameterEstimate:
        """Estimate from the sines of a data set (see `Estimator`)."""
        return self.of_points(data.sines)

    def of_points(self, points: Sequence[ResponsePoint]) -> ParameterEstimate:
        """Estimate from steady responses (see `Estimator`)."""
        names = names_of(self.method, self.terms)
        return _fit(points, names, "harmonic balance", small=False, check=self.check)


@dataclass(frozen=True, kw_only=True)
class Linear(Estimator):
    """p1..p4 of the linearisation from the steady responses of all sines.

    For swings so small that sin th = th, without Coulomb friction and delay: what is left of the
    harmonic balance is the joint linear complex fit -p1 w^2 G + j w p2 G + p3 G - p4 =
    (Z w^2 - X) G.

    Parameters
    ----------
    check
        Whether to fit again without each added mass.
    """

    method: Literal["linear"] = "linear"
    check: bool = True

    summary: ClassVar[str] = "joint complex fit for small swings without friction"

    def __call__(self, data: DataSet) -> ParameterEstimate:
        """Estimate from the sines of a data set (see `Estimator`)."""
        return self.of_points(data.sines)

    def of_points(self, points: Sequence[ResponsePoint]) -> ParameterEstimate:
        """Estimate from steady responses (see `Estimator`)."""
        return _fit(points, LINEAR, "joint linear complex fit", small=True, check=self.check)


def _fit(
    points: Sequence[ResponsePoint],
    names: tuple[str, ...],
    method: str,
    *,
    small: bool,
    check: bool,
) -> ParameterEstimate:
    _refuse_too_few(points, names)
    solved = _solve(Phasors.of(points, names, small=small))

    def without(mass: AddedMass) -> NDArray[np.float64]:
        kept = [point for point in points if point.added_mass != mass]
        _refuse_too_few(kept, names)
        return _solve(Phasors.of(kept, names, small=small)).values

    masses = [point.added_mass for point in points]
    left_out, said = without_each_mass(masses, without, asked=check)
    return ParameterEstimate.from_rows(
        solved, method=method, left_out=left_out, findings=said, masses=masses
    )


def _refuse_too_few(points: Sequence[ResponsePoint], names: Sequence[str]) -> None:
    if not points:
        raise IdentifiabilityError(
            "no log says that its input was a sine: give omega and amplitude in the manifest; the "
            "methods weak-form and output-error take any input"
        )
    refuse_one_mass(point.added_mass for point in points)
    if 2 * len(points) <= len(names):
        raise IdentifiabilityError(
            f"{len(points)} logs give {2 * len(points)} equations for {len(names)} "
            "parameters: add runs at other frequencies"
        )


@np.errstate(divide="ignore", over="ignore", invalid="ignore")
def _solve(phasors: Phasors) -> Solved:
    count = len(phasors.names)
    logs = np.arange(phasors.omega.size)
    values, weights, delay = np.zeros(count), np.ones(logs.size), 0.0
    for _ in range(_MAX_ITERATIONS):
        matrix, target = phasors.equations(delay)
        regression = Regression(
            names=phasors.names,
            rows=_real(matrix * weights[:, None]),
            target=_real(target * weights),
            cluster=np.tile(logs, 2),
            about={"delay": delay},
        )
        solution = regression.solve()
        before, unknowns = (regression.unknowns(each) for each in (values, solution.values))
        values = solution.values
        slope = phasors.slope(values)
        swing = np.abs(phasors.angle)
        errors = np.abs(matrix @ unknowns - target) / (slope * swing)
        if not np.isfinite(errors).all():
            raise IdentifiabilityError("no joint's response balances these logs: check their units")
        spread = _model_variance(errors, phasors.variance / swing**2, count)
        weights = 1.0 / (slope * np.sqrt(phasors.variance + spread * swing**2))
        if "delay" in phasors.names:
            delay = float(values[phasors.names.index("delay")])
        change = np.linalg.norm(regression.rows @ (unknowns - before))
        settled = bool(change < _TOLERANCE * np.linalg.norm(regression.rows @ unknowns))
        if settled:
            break
    rounds = Finding(kind=FindingKind.ROUNDS, number=_MAX_ITERATIONS, severity=Severity.WARNING)
    return Solved.of(regression, solution, unsettled=None if settled else rounds)


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
