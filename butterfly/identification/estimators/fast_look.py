"""A fast look: linear regressions over the steady responses to sines.

At each log's frequency w, with the phasors th of the angle and u of the input and a = |th|, the
balance of the fundamental of (78) with Coulomb friction and an input delay d reads

    [-(p1 + Z) w^2 + j w p2 + (p3 + X) 2 J1(a)/a + j 4 T_c/(pi a)] th = p4 e^(-j w d) u

which is linear in p1, p2, p3, T_c, p4 and, to first order about the current delay, in p4 d; so are
the describing functions of all other terms that it offers. For small swings without friction and
delay it is the linear complex fit of p1..p4. The known Z = m l^2 and X = m g l set
the scale, so two different added masses are needed. Each row is divided by its left-hand side over
th at the previous iterate (Sanathanan & Koerner, IEEE Trans. Autom. Control 8, 1963), and by the
angle error's standard deviation: the phasor's, and one in proportion to the swing, common to all
logs (DerSimonian & Laird, Controlled Clinical Trials 7, 1986). Intervals do not include the errors
of describing functions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from butterfly.arrays import ROUNDING, Samples
from butterfly.errors import IdentifiabilityError, require_names
from butterfly.identification.consistency import with_scale
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators.base import Estimator
from butterfly.identification.fit import MOST, Fit
from butterfly.identification.infer import Basis
from butterfly.identification.linearisation import Regression
from butterfly.identification.stagewise import STRIBECK, stribeck_velocity
from butterfly.identification.trust import SHOWS, Ending, Finding, FindingKind
from butterfly.model.parameters import AddedMass
from butterfly.model.prior import NO_PRIOR, Penalty, Prior, require_usable
from butterfly.model.terms import BASE_TERMS, PARAMETERS, TERMS, FrictionTerms, offered
from butterfly.signals.frequency_response import ResponsePoint

LINEAR = PARAMETERS[:4]
"""Parameters in the limit of small swings without Coulomb friction and delay."""

_EXACT = ROUNDING**3  # relative variance of a phasor that rounding leaves even to exact data


@dataclass(frozen=True, kw_only=True)
class HarmonicBalance(Estimator):
    """Estimate p1..p4, coulomb, delay and terms from the steady responses to sines: a fast look.

    Needs at least four logs with two different added masses (none counts as one), or enough known
    values. Its intervals do not include the errors of describing functions: use it with care at
    best. Stribeck friction has the known velocity, or else a tenth of the largest speed.

    Parameters
    ----------
    terms
        Terms fitted besides p1..p4, coulomb and delay. Default: none.
    """

    method: Literal["harmonic-balance"] = "harmonic-balance"
    terms: tuple[str, ...] = ()

    summary: ClassVar[str] = "fast look at the steady responses to sines"

    def __post_init__(self) -> None:
        require_names(self.method, "terms", self.terms, offered(self.method))

    def fit(self, data: DataSet) -> tuple[Basis, Fit]:
        """Fit the sines of a data set."""
        data.require_angles(self.method)
        require_usable(self.method, data.known)
        points, count = data.take(data.steady).sines, len(data.sines)
        names = (*PARAMETERS, *(self.terms))
        if len(points) == count:
            return _fitted(points, data.known, names, "harmonic balance")
        if 2 * len(points) <= len(data.known.fitted(PARAMETERS)):
            raise IdentifiabilityError(
                f"only {len(points)} of {count} sine logs show a steady swing about a rest angle: "
                "in the others the joint turns over, rests elsewhere, swings too wide or does not "
                "settle; use weak-form or output-error, which accept any motion"
            )
        sines = (k for k, point in enumerate(data.points) if point)
        lost = tuple(data.logs[k].name for k in sines if k not in data.steady)
        excluded = Finding(FindingKind.LEFT_OUT, number=count, logs=lost)
        basis, fit = _fitted(points, data.known, names, "harmonic balance")
        return basis, replace(fit, findings=(excluded,))

    def of_points(self, points: Sequence[ResponsePoint], known: Prior = NO_PRIOR) -> Estimate:
        """Estimate from steady responses (see `Estimator`)."""
        names = (*PARAMETERS, *(self.terms))
        return self.infer(*_fitted(points, known, names, "harmonic balance"))


@dataclass(frozen=True, kw_only=True)
class Linear(Estimator):
    """Estimate p1..p4 of the linearisation from the steady responses to sines.

    For small swings (sin th = th) without Coulomb friction and delay, harmonic balance reduces to
    the linear complex fit -p1 w^2 G + j w p2 G + p3 G - p4 = (Z w^2 - X) G.
    """

    method: Literal["linear"] = "linear"

    summary: ClassVar[str] = "linear fit of the steady responses, small swings without friction"

    def fit(self, data: DataSet) -> tuple[Basis, Fit]:
        """Fit the sines of a data set."""
        data.require_angles(self.method)
        return self._of_points(data.sines, data.known)

    def of_points(self, points: Sequence[ResponsePoint], known: Prior = NO_PRIOR) -> Estimate:
        """Estimate from steady responses (see `Estimator`)."""
        return self.infer(*self._of_points(points, known))

    def _of_points(self, points: Sequence[ResponsePoint], known: Prior) -> tuple[Basis, Fit]:
        """Fit steady responses."""
        require_usable(HarmonicBalance.method, known, LINEAR)
        return _fitted(points, known, LINEAR, "linear fit of the steady responses", small=True)


def _fitted(
    points: Sequence[ResponsePoint],
    known: Prior,
    names: tuple[str, ...],
    method: str,
    *,
    small: bool = False,
) -> tuple[Basis, Fit]:
    """Fit some parameters; with ``small``, sin th is th.

    Its intervals do not include errors of the method.
    """
    if not points:
        raise IdentifiabilityError(
            "no log is marked as a sine: set omega and amplitude in the manifest, or use weak-form "
            "or output-error, which accept any input"
        )
    masses, names = [point.added_mass for point in points], known.fitted(names)
    known = with_scale(masses, known)
    if 2 * len(points) <= len(names):
        count = f"{len(points)} {'log gives' if len(points) == 1 else 'logs give'}"
        equations = f"{2 * len(points)} equations for {len(names)} parameters"
        raise IdentifiabilityError(f"{count} {equations}: add runs at other frequencies")
    phasors = Phasors.of(points, known.fitted(names), known, small=small)
    basis = Basis(
        method=method,
        masses=masses,
        known=known,
        timed=True,
        fixed={"stribeck_velocity": phasors.slow} if STRIBECK in names else {},
        findings=[Finding(FindingKind.APPROXIMATE)],
    )
    return basis, balanced(phasors)


@dataclass(frozen=True, eq=False)
class Phasors:
    """The (n,) arrays that enter the balance of n responses."""

    # omega, angle, input: frequencies in rad/s, phasors of angle in rad and input in its unit
    omega: Samples
    angle: NDArray[np.complex128]
    input: NDArray[np.complex128]
    variance: Samples  # of each component of the angle's phasor, in rad^2
    masses: tuple[AddedMass, ...]
    names: tuple[str, ...]  # the parameters that are estimated
    swing: Samples  # in rad, at which the describing functions are taken
    # of the robot; exactly known parameters are not among the names
    known: Prior = NO_PRIOR

    @classmethod
    def of(
        cls, points: Sequence[ResponsePoint], names: tuple[str, ...], known: Prior, *, small: bool
    ) -> Phasors:
        """Collect them from steady responses; with ``small``, sin th counts as th."""
        angle = np.array([p.angle.fundamental for p in points])
        return cls(
            omega=np.array([p.omega for p in points]),
            angle=angle,
            input=np.array([p.input for p in points]),
            variance=np.array(
                [max(np.trace(p.angle.covariance) / 2, _EXACT * p.amplitude**2) for p in points]
            ),
            masses=tuple(p.added_mass for p in points),
            names=names,
            swing=np.full(angle.size, ROUNDING) if small else np.abs(angle),
            known=known,
        )

    @cached_property
    def slow(self) -> float:
        """Velocity in rad/s at which Stribeck friction is described."""
        return stribeck_velocity(float(np.max(np.abs(self.angle) * self.omega)), self.known)

    def regression(self, weights: Samples, values: Mapping[str, float]) -> Regression:
        """Return the equations, with (n,) weights, about a delay in s and p4 by name."""
        delay, known = values.get("delay", 0.0), self.known.fixed
        late = self.input * np.exp(-1j * self.omega * delay)
        columns = self._columns | {"p4": -late}
        torque = self._carried + sum(known[name] * columns[name] for name in columns.keys() & known)
        columns["delay"] = 1j * self.omega * late
        matrix = np.column_stack([columns[name] for name in self.names]) * weights[:, None]
        return Regression(
            names=self.names,
            rows=_parts(matrix),
            target=_parts(-torque * weights),
            cluster=np.tile(np.arange(self.omega.size), 2),
            about={"delay": delay},
            gain=values["p4"],
            prior=Penalty.of(self.names, self.known.parameters),
        )

    def named(self, values: Samples) -> dict[str, float]:
        """Return (n,) values and exactly known ones by name."""
        return self.known.fixed | dict(zip(self.names, values.tolist(), strict=True))

    def slope(self, values: Samples) -> Samples:
        """(n,) torque of the left-hand side over the swing."""
        named = self.named(values)
        torque = sum(value * self._columns[n] for n, value in named.items() if n in self._columns)
        inertia = self._of_masses("inertia")
        heaviest = np.maximum(np.abs(inertia + named.get("p1", 0.0)), inertia.max())
        torque, least = torque + self._carried, SHOWS * heaviest * self.omega**2
        return np.asarray(np.maximum(np.abs(torque / self.angle), least))

    @cached_property
    def _columns(self) -> dict[str, NDArray[np.complex128]]:
        """(n,) regressors by parameter, without those of the motor's torque."""
        fields = {"weight": "weight", "mass": "mass", "carried": "swung"}
        given = {field: self._of_masses(name) for field, name in fields.items()}
        periods = self.known.fixed.get("cogging_periods", FrictionTerms.cogging_periods)
        settings = FrictionTerms(stribeck_velocity=self.slow, cogging_periods=periods)
        motion = settings.motion(0.0, 0.0, **given)
        return {
            row.name: np.asarray(row.describing(self.omega, self.swing, motion) * self.angle)
            for row in TERMS.values()
            if row.describing is not None
            and row.name in {*self.names, *self.known.fixed, "p1", "p3"} - {*BASE_TERMS}
        }

    @property
    def _carried(self) -> NDArray[np.complex128]:
        """(n,) torques of the added masses."""
        pairs = (("p1", "inertia"), ("p3", "gravity_moment"))
        return np.asarray(sum(self._of_masses(load) * self._columns[name] for name, load in pairs))

    def _of_masses(self, name: str) -> Samples:
        """(n,) some property of the added masses."""
        return np.array([getattr(mass, name) for mass in self.masses], dtype=np.float64)


@np.errstate(divide="ignore", over="ignore", invalid="ignore")
def balanced(phasors: Phasors) -> Fit:
    """Solve, reweight by slopes and errors at the solution, and iterate to convergence."""
    count, swing = len(phasors.names), np.abs(phasors.angle)
    values, weights = np.zeros(count), np.ones(phasors.omega.size)
    for _ in range(MOST):
        regression = phasors.regression(weights, phasors.named(values))
        solution = regression.solve()
        moved = solution.values - values
        before, unknowns = (regression.unknowns(vector) for vector in (values, solution.values))
        values = solution.values
        slope = phasors.slope(values)
        rest = regression.residuals(values).reshape(2, -1) / weights
        errors = np.hypot(*rest) / (slope * swing)
        if not np.isfinite(errors).all():
            raise IdentifiabilityError("no joint fits the steady responses of these logs")
        spread = _spread(errors, phasors.variance / swing**2, max(2 * swing.size - count, 1))
        weights = 1.0 / (slope * np.sqrt(phasors.variance + spread * swing**2))
        change = np.linalg.norm(regression.rows @ (unknowns - before))
        settled = bool(change < ROUNDING * np.linalg.norm(regression.rows @ unknowns))
        if settled:
            break
    fit = Fit(linearisation=regression.linearised(solution))
    return fit if settled else replace(fit, ending=Ending.STOPPED, unsettled=moved)


def _parts(values: NDArray[Any]) -> Samples:
    """Return real parts, then imaginary ones."""
    return np.concatenate([values.real, values.imag])


def _spread(errors: Samples, variance: Samples, freedom: int) -> float:
    """Return the variance of (n,) relative errors besides (n,) known ones (Paule & Mandel 1982)."""

    def excess(common: float) -> float:
        return float(np.sum(errors**2 / (variance + common))) - freedom

    most = float(errors @ errors) / freedom
    # at the most it is 0 where nothing is known, but for rounding
    return float(brentq(excess, ROUNDING * most, 2 * most)) if excess(ROUNDING * most) > 0 else 0.0
