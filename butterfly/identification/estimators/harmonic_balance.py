"""Harmonic balance: a linear regression over the steady responses to sines, as a fast look.

At each log's frequency w, with the phasors th of the angle and u of the input and a = |th|, the
balance of the fundamental of (78) with Coulomb friction and an input delay d reads

    [-(p1 + Z) w^2 + j w p2 + (p3 + X) 2 J1(a)/a + j 4 T_c/(pi a)] th = p4 e^(-j w d) u

which is linear in p1, p2, p3, T_c, p4 and, to first order about the current delay, in p4 d; so are
the describing functions of all other terms that it offers. The known Z = m l^2 and X = m g l set
the scale, so two different added masses are needed. Each row is divided by its left-hand side over
th at the previous iterate (Sanathanan & Koerner, IEEE Trans. Autom. Control 8, 1963), and by the
angle error's standard deviation: the phasor's, and one in proportion to the swing, common to all
logs (DerSimonian & Laird, Controlled Clinical Trials 7, 1986). What describing functions neglect is
in no interval.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import Samples
from butterfly.errors import IdentifiabilityError
from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.findings import Finding, FindingKind
from butterfly.identification.equations import CellEquations, Regression, Solution
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators.base import Estimator, require_names, require_usable
from butterfly.identification.inference.identifiability import ScaleParameter, refuse_without_scale
from butterfly.identification.inference.infer import FittedLogs, SolvedFit, infer
from butterfly.identification.inference.linear_terms import (
    STRIBECK,
    LinearModel,
    TermChoice,
    candidates,
    choose,
    demanded,
    stribeck_velocities,
)
from butterfly.identification.inference.submodels import NEGLIGIBLE, Submodels, submodels_of
from butterfly.identification.levels import MOST, ROUNDING, SHOWS
from butterfly.model.parameters import AddedMass, LumpedParameters
from butterfly.model.prior import NO_PRIOR, Penalty, Prior
from butterfly.model.terms import BASE_TERMS, COMMON, PARAMETERS, TERMS, FrictionTerms, offered
from butterfly.signals.frequency_response import ResponsePoint

LINEAR = ("p1", "p2", "p3", "p4")
"""What is estimated in the limit of small swings without Coulomb friction and delay."""

_EXACT = ROUNDING**3  # relative variance of a phasor that rounding leaves even to exact data


@dataclass(frozen=True, kw_only=True)
class HarmonicBalance(Estimator):
    """Estimate p1..p4, coulomb, delay and terms from the steady responses to sines: a fast look.

    Needs at least four logs with two different added masses (none counts as one), or enough known
    values. Its intervals do not know what describing functions neglect, so that it is to be used
    with care at best. The Stribeck velocity comes from a grid search.

    Parameters
    ----------
    terms
        Terms fitted besides p1..p4, coulomb and delay; if not given, those that improve the
        prediction of held-out logs.
    """

    method: Literal["harmonic-balance"] = "harmonic-balance"
    terms: tuple[str, ...] | None = None

    summary: ClassVar[str] = "fast look at the steady responses to sines"

    def __post_init__(self) -> None:
        require_names(self.method, "terms", self.terms or (), offered(self.method))

    def __call__(self, data: DataSet) -> Estimate:
        """Estimate from the sines of a data set (see `Estimator`)."""
        data.require_angles(self.method)
        require_usable(self.method, data.known)
        points = [point for k in data.steady if (point := data.points[k]) is not None]
        lost = [k for k, point in enumerate(data.points) if point and k not in data.steady]
        if lost and 2 * len(points) <= len(data.known.fitted(PARAMETERS)):
            raise IdentifiabilityError(
                f"only {len(points)} of {len(data.sines)} sine logs show a steady swing about a "
                "rest angle: in the others the joint turns over, rests elsewhere, swings too wide "
                "or does not settle; use weak-form or output-error, which accept any motion"
            )
        names = tuple(data.logs[k].name for k in lost)
        said = Finding(FindingKind.LEFT_OUT, number=len(data.sines), logs=names)
        found = self.of_points(points, data.known)
        return found.with_findings(said) if lost else found

    def of_points(self, points: Sequence[ResponsePoint], known: Prior = NO_PRIOR) -> Estimate:
        """Estimate from steady responses (see `Estimator`)."""
        reference, first = _begun(points, known, PARAMETERS)
        chosen, fit = self.chosen(first, COMMON)
        return _judged(fit, "harmonic balance", reference, chosen)

    def path(self, data: DataSet, candidates: tuple[str, ...]) -> tuple[tuple[str, ...], ...]:
        """Return the terms after each round of a stagewise choice from some candidates."""
        self.with_terms(candidates)
        points = [point for k in data.steady if (point := data.points[k]) is not None]
        _, first = _begun(points, data.known, PARAMETERS)
        return replace(self, terms=None).chosen(first, candidates)[0].path

    def chosen(
        self, fit: HarmonicBalanceFit, offers: Sequence[str]
    ) -> tuple[TermChoice, HarmonicBalanceFit]:
        """Choose from some offers, or, of given terms, only a Stribeck velocity; fit them."""
        phasors, known = fit.phasors, fit.phasors.known
        rows = self.terms
        if rows is None:
            able = [name for name in offers if name in offered(self.method)]
            rows = candidates(able, phasors.masses, known)
        rows = tuple(name for name in rows if name not in known.parameters)
        speeds = [phasors.stribeck_velocity]
        if STRIBECK in rows:
            fastest = float(np.max(np.abs(phasors.angle) * phasors.omega))
            speeds = stribeck_velocities(fastest, known)
        names = (*phasors.names, *rows)
        models = tuple(
            fit.nested(replace(phasors, names=names, stribeck_velocity=speed)) for speed in speeds
        )
        model = LinearModel(models=models, optional=rows, masses=phasors.masses)
        chosen = choose(model) if self.terms is None else demanded(model, rows)
        slow = chosen.settings.get("stribeck_velocity", phasors.stribeck_velocity)
        with_them = replace(phasors, names=chosen.names, stribeck_velocity=slow)
        return chosen, HarmonicBalanceFit.of(with_them)


@dataclass(frozen=True, kw_only=True)
class Linear(Estimator):
    """Estimate p1..p4 of the linearisation from the steady responses to sines.

    For small swings (sin th = th) without Coulomb friction and delay, harmonic balance reduces to
    the linear complex fit -p1 w^2 G + j w p2 G + p3 G - p4 = (Z w^2 - X) G.
    """

    method: Literal["linear"] = "linear"

    summary: ClassVar[str] = "linear fit of the steady responses, small swings without friction"

    def __call__(self, data: DataSet) -> Estimate:
        """Estimate from the sines of a data set (see `Estimator`)."""
        data.require_angles(self.method)
        return self.of_points(data.sines, data.known)

    def of_points(self, points: Sequence[ResponsePoint], known: Prior = NO_PRIOR) -> Estimate:
        """Estimate from steady responses (see `Estimator`)."""
        require_usable(HarmonicBalance.method, known, LINEAR)
        reference, fit = _begun(points, known, LINEAR, small=True)
        return _judged(fit, "joint linear complex fit", reference, None)


def _begun(
    points: Sequence[ResponsePoint], known: Prior, names: tuple[str, ...], *, small: bool = False
) -> tuple[ScaleParameter, HarmonicBalanceFit]:
    """Fit some parameters, and say on what their scale rests."""
    _refuse_too_few(points, known.fitted(names), known)
    reference = ScaleParameter.of([point.added_mass for point in points], known)
    known = reference.fixed
    phasors = Phasors.of(points, known.fitted(names), known, small=small)
    return reference, HarmonicBalanceFit.of(phasors)


def _judged(
    fit: HarmonicBalanceFit, method: str, reference: ScaleParameter, chosen: TermChoice | None
) -> Estimate:
    """Return the estimate of a fit, whose intervals do not know what the method neglects."""
    rivals, findings = (chosen.rival_values, chosen.findings) if chosen else ((), ())
    return infer(
        SolvedFit(
            method=method,
            equations=reference.whole(fit.solved),
            rivals=[reference.grown(each, fit.solved.names) for each in rivals],
            fixed=chosen.settings if chosen else {},
            findings=[Finding(FindingKind.APPROXIMATE), *findings],
        ),
        FittedLogs(fit.phasors.masses, known=reference.known),
    )


def _refuse_too_few(points: Sequence[ResponsePoint], names: Sequence[str], known: Prior) -> None:
    if not points:
        raise IdentifiabilityError(
            "no log is marked as a sine: set omega and amplitude in the manifest, or use weak-form "
            "or output-error, which accept any input"
        )
    refuse_without_scale((point.added_mass for point in points), known)
    if 2 * len(points) <= len(names):
        count = f"{len(points)} {'log gives' if len(points) == 1 else 'logs give'}"
        equations = f"{2 * len(points)} equations for {len(names)} parameters"
        raise IdentifiabilityError(f"{count} {equations}: add runs at other frequencies")


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
    # what is known of the robot; what is known exactly is not among the names
    known: Prior = NO_PRIOR
    # in rad/s, at which Stribeck friction is described
    stribeck_velocity: float = FrictionTerms.stribeck_velocity

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
            stribeck_velocity=known.fixed.get("stribeck_velocity", FrictionTerms.stribeck_velocity),
        )

    def equations(
        self, about: LumpedParameters
    ) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """(n, p) regressors and (n,) targets; what p4 multiplies enters as p4 (value - about)."""
        late = self.input * np.exp(-1j * self.omega * about.delay)
        driven = {"p4": -late, "delay": 1j * self.omega * late}
        columns = self._columns | driven
        told = ((n, v) for n, v in self.known.fixed.items() if n in {"p4", *self._columns})
        given = self._carried + sum(value * columns[name] for name, value in told)
        return np.column_stack([columns[name] for name in self.names]), -given

    def weighted(self, weights: Samples, about: LumpedParameters) -> Regression:
        """Return the equations about a delay, as (n,) weights count them."""
        matrix, target = self.equations(about)
        return Regression(
            names=self.names,
            rows=_parts(matrix * weights[:, None]),
            target=_parts(target * weights),
            cluster=np.tile(np.arange(self.omega.size), 2),
            about={"delay": about.delay},
            gain=about.p4,
            prior=Penalty.of(self.names, self.known.parameters),
        )

    def described(self, values: Samples) -> LumpedParameters:
        """Return the model's parameters: (n,) values of the names, and what is known exactly."""
        found = dict(zip(self.names, values.tolist(), strict=True))
        told = self.known.fixed | {"stribeck_velocity": self.stribeck_velocity}
        return LumpedParameters(**told | found)

    def slope(self, values: Samples) -> Samples:
        """(n,) torque of the left-hand side over the swing."""
        found = self.known.fixed | dict(zip(self.names, values.tolist(), strict=True))
        torque = sum(value * self._columns[n] for n, value in found.items() if n in self._columns)
        inertia = self._of_masses("inertia")
        heaviest = np.maximum(np.abs(inertia + found.get("p1", 0.0)), inertia.max())
        torque, least = torque + self._carried, SHOWS * heaviest * self.omega**2
        return np.asarray(np.maximum(np.abs(torque / self.angle), least))

    @cached_property
    def _columns(self) -> dict[str, NDArray[np.complex128]]:
        """What parameters multiply, the motor's torque aside: (n,) each."""
        fields = {"weight": "weight", "mass": "mass", "carried": "swung"}
        given = {field: self._of_masses(name) for field, name in fields.items()}
        periods = self.known.fixed.get("cogging_periods", FrictionTerms.cogging_periods)
        settings = FrictionTerms(stribeck_velocity=self.stribeck_velocity, cogging_periods=periods)
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
        return np.asarray(sum(self._of_masses(own) * self._columns[name] for name, own in pairs))

    def _of_masses(self, name: str) -> Samples:
        """(n,) some property of the added masses."""
        return np.array([getattr(mass, name) for mass in self.masses], dtype=np.float64)


@dataclass(frozen=True, kw_only=True, eq=False)
class HarmonicBalanceFit:
    """A balance and its solution."""

    phasors: Phasors  # what was balanced
    weights: Samples  # (n,) of the n logs
    regression: Regression  # regression, solved: the equations about the solution, and the solution
    solved: CellEquations

    @classmethod
    @np.errstate(divide="ignore", over="ignore", invalid="ignore")
    def of(cls, phasors: Phasors) -> HarmonicBalanceFit:
        """Solve, weigh by the slopes and errors at the solution, and solve again until it rests."""
        count, swing = len(phasors.names), np.abs(phasors.angle)
        values, weights = np.zeros(count), np.ones(phasors.omega.size)
        for _ in range(MOST):
            about = phasors.described(values)
            regression = phasors.weighted(weights, about)
            solution = regression.solve()
            moved = solution.values - values
            before, unknowns = (regression.unknowns(each) for each in (values, solution.values))
            values = solution.values
            slope = phasors.slope(values)
            rest = (regression.rows @ unknowns - regression.target).reshape(2, -1) / weights
            errors = np.hypot(*rest) / (slope * swing)
            if not np.isfinite(errors).all():
                raise IdentifiabilityError(
                    "no joint fits the steady responses of these logs: check their units"
                )
            left = float(errors @ errors) / max(2 * swing.size - count, 1)
            spread = max(left - float(np.mean(phasors.variance / swing**2)), 0.0)
            weights = 1.0 / (slope * np.sqrt(phasors.variance + spread * swing**2))
            change = np.linalg.norm(regression.rows @ (unknowns - before))
            settled = bool(change < ROUNDING * np.linalg.norm(regression.rows @ unknowns))
            if settled:
                break
        solved = CellEquations.of(regression, solution)
        solved = solved if settled else solved.stopped(moved)
        return cls(phasors=phasors, weights=weights, regression=regression, solved=solved)

    def nested(self, phasors: Phasors) -> Submodels:
        """Return the equations of a balance with more terms, as this one weighs them."""
        about = self.phasors.described(self.solved.values)
        regression = phasors.weighted(self.weights, about)
        values = np.array([getattr(about, name) for name in phasors.names])
        solution = Solution(values=values, on_bound=np.zeros(values.size, dtype=bool))
        slope, swing = self.phasors.slope(self.solved.values), np.abs(self.phasors.angle)
        negligible = NEGLIGIBLE * float(np.mean(self.weights * slope * swing))
        found = submodels_of(CellEquations.of(regression, solution), phasors.masses, negligible)
        return replace(found, settings={"stribeck_velocity": phasors.stribeck_velocity})


def _parts(values: NDArray[np.complex128]) -> Samples:
    """Return real parts, then imaginary ones."""
    return np.concatenate([values.real, values.imag])
