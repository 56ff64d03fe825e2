"""The harmonic balance as a regression: regressors, targets, weights and the solution.

The balance of fundamentals is solved by weighted linear least squares, and the weights anew.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize

from butterfly.arrays import Samples
from butterfly.errors import IdentifiabilityError
from butterfly.identification.blocks import Conditions
from butterfly.identification.equations import CellEquations, Regression, Solution
from butterfly.identification.inference.agreement import lacking_term
from butterfly.identification.inference.submodels import Submodels
from butterfly.identification.inference.term_choice import (
    BASE,
    NEGLIGIBLE,
    RARER,
    candidates,
    submodels_of,
)
from butterfly.identification.levels import MOST, ROUNDING, SHOWS
from butterfly.model.parameters import AddedMass, LumpedParameters
from butterfly.model.prior import NO_PRIOR, Penalty, Prior
from butterfly.model.terms import (
    DRIVE,
    IDEAL,
    PARAMETERS,
    TERMS,
    FrictionTerms,
    companions,
    offered,
)
from butterfly.signals.frequency_response import ResponsePoint

Shape = Sequence[float] | Samples
"""Logarithms of a base's frequency in rad/s and damping ratio."""

_ON_BASE = ("moment", "base")
# least and largest of a base over the fastest input's; how many are tried
_NATURAL = (1.0, 10.0, 7)
_DAMPING = (0.02, 2.0, 5)  # the same of damping ratios
_HALVES = 12  # of a stretch, by which the limit of what residuals allow is found
_SWING_STEP = ROUNDING**0.5  # relative, of the differences in the swing
_EXACT = ROUNDING**3  # relative variance of a phasor that rounding leaves even to exact data


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
    # torque in N m that the motion of the model leaves over in the balance of its fundamentals:
    # what describing functions neglect, transients that still ring, stamps that are not regular
    remainder: NDArray[np.complex128]
    # what is known of the robot; what is known exactly is not among the names
    known: Prior = NO_PRIOR
    # in rad/s, at which Stribeck friction is described
    stribeck_velocity: float = FrictionTerms.stribeck_velocity
    # the bare hand on the base whose pushes are described, if it gives
    standing: LumpedParameters = field(
        default_factory=lambda: LumpedParameters(p1=1.0, p2=0.0, p3=0.0, p4=1.0)
    )

    @classmethod
    def of(
        cls,
        points: Sequence[ResponsePoint],
        names: tuple[str, ...],
        *,
        small: bool,
        known: Prior = NO_PRIOR,
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
            remainder=np.zeros(angle.size, dtype=np.complex128),
            known=known,
            stribeck_velocity=known.fixed.get("stribeck_velocity", FrictionTerms.stribeck_velocity),
        )

    def equations(
        self, about: LumpedParameters
    ) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """(n, p) regressors and (n,) targets; what p4 multiplies enters as p4 (value - about)."""
        late = self.input * np.exp(-1j * self.omega * about.delay)
        driven = {}
        if about.drive != IDEAL or not set(DRIVE).isdisjoint(self.names):
            late, slopes = about.of_sines(late)
            driven = {name: -slope for name, slope in slopes.items()}
        driven |= {"p4": -late, "delay": 1j * self.omega * late}
        columns = [driven[name] if name in driven else self._columns[name] for name in self.names]
        gain = self.known.fixed.get("p4", 0.0)
        return np.column_stack(columns), self._target - gain * driven["p4"]

    def described(self, values: Samples) -> LumpedParameters:
        """Return the model's parameters: (n,) values of the names, and what is known exactly."""
        found = dict(zip(self.names, values.tolist(), strict=True))
        told = self.base | self.known.fixed | {"stribeck_velocity": self.stribeck_velocity}
        return LumpedParameters(**told | found)

    @property
    def base(self) -> dict[str, float]:
        """Frequency and damping ratio of the bare base."""
        return {name: getattr(self.standing, name) for name in sorted(companions({BASE}))}

    def slope(self, values: Samples) -> Samples:
        """Rms slope of the left-hand side in the angle's phasor, over its directions, (n,)."""
        found = self.known.fixed | dict(zip(self.names, values.tolist(), strict=True))
        inertia = self._inertia + found.get("p1", 0.0)
        acting = {**found, "p1": inertia, "p3": self._moment + found.get("p3", 0.0)}
        torques = sum(acting[name] * each for name, each in self._swings.items())
        below, there, above = np.asarray(torques)
        radial = (above - below) / (2 * _SWING_STEP * self.swing)
        tangential = there / self.swing
        least = SHOWS * np.maximum(np.abs(inertia), self._inertia.max()) * self.omega**2
        rms = np.sqrt((np.abs(radial) ** 2 + np.abs(tangential) ** 2) / 2)
        return np.asarray(np.maximum(rms, least))

    @cached_property
    def _inertia(self) -> Samples:
        """(n,) in kg m^2, of the added masses."""
        return np.array([mass.inertia for mass in self.masses])

    @cached_property
    def _moment(self) -> Samples:
        """(n,) gravity moments in N m of the added masses."""
        return np.array([mass.gravity_moment for mass in self.masses])

    @cached_property
    def _columns(self) -> dict[str, NDArray[np.complex128]]:
        """What parameters multiply, the motor's torque aside: (n,) each."""
        described = self._described(self.swing)
        return {name: np.asarray(each * self.angle) for name, each in described.items()}

    @cached_property
    def _swings(self) -> dict[str, NDArray[np.complex128]]:
        """What they multiply in swings a little narrower, as they are, and wider: (3, n) each."""
        steps = np.array([[1 - _SWING_STEP], [1.0], [1 + _SWING_STEP]])
        described = self._described(steps * self.swing)
        return {name: np.asarray(each * steps * self.swing) for name, each in described.items()}

    def _described(self, swing: Samples) -> dict[str, NDArray[np.complex128]]:
        """Return the describing functions of what acts, at (..., n) swings in rad."""
        weight = np.array([mass.weight for mass in self.masses])
        periods = self.known.fixed.get("cogging_periods", FrictionTerms.cogging_periods)
        settings = FrictionTerms(stribeck_velocity=self.stribeck_velocity, cogging_periods=periods)
        swung = np.array([mass.swung for mass in self.masses])
        mass = np.array([mass.mass for mass in self.masses])
        on_base = {each: self.standing.with_added_mass(each).on_base for each in {*self.masses}}
        pushed = {each: np.array([on_base[m][each] for m in self.masses]).T for each in _ON_BASE}
        motion = settings.motion(0.0, 0.0, weight=weight, mass=mass, carried=swung, **pushed)
        return {
            row.name: np.asarray(row.describing(self.omega, swing, motion))
            for row in TERMS.values()
            if row.describing is not None
            and row.name in {*self.names, *self.known.fixed, "p1", "p3"}
        }

    @cached_property
    def _target(self) -> NDArray[np.complex128]:
        """(n,) torques that the known masses and the remainder leave to the parameters."""
        carried = self._inertia * self._columns["p1"] + self._moment * self._columns["p3"]
        for name, value in self.known.fixed.items():
            if name in self._columns:
                carried = carried + value * self._columns[name]
        return np.asarray(self.remainder - carried)


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
        count = len(phasors.names)
        values, weights = np.zeros(count), np.ones(phasors.omega.size)
        for _ in range(MOST):
            about = phasors.described(values)
            matrix, target = phasors.equations(about)
            regression = _regression(phasors, (matrix, target), weights, about)
            solution = regression.solve()
            moved = solution.values - values
            before, unknowns = (regression.unknowns(each) for each in (values, solution.values))
            values = solution.values
            slope = phasors.slope(values)
            swing = np.abs(phasors.angle)
            errors = np.abs(matrix @ unknowns - target) / (slope * swing)
            if not np.isfinite(errors).all():
                raise IdentifiabilityError(
                    "no joint fits the steady responses of these logs: check their units"
                )
            spread = _model_variance(errors, phasors.variance / swing**2, count)
            weights = 1.0 / (slope * np.sqrt(phasors.variance + spread * swing**2))
            change = np.linalg.norm(regression.rows @ (unknowns - before))
            settled = bool(change < ROUNDING * np.linalg.norm(regression.rows @ unknowns))
            if settled:
                break
        solved = CellEquations.of(regression, solution)
        solved = solved if settled else solved.stopped(moved)
        return cls(phasors=phasors, weights=weights, regression=regression, solved=solved)

    @property
    def parameters(self) -> LumpedParameters:
        """The solution as parameters of the model."""
        return self.phasors.described(self.solved.values)

    @property
    def misfit(self) -> float:
        """Variance of the angles' relative errors that sensors do not explain."""
        phasors, values = self.phasors, self.solved.values
        matrix, target = phasors.equations(self.parameters)
        left = matrix @ self.regression.unknowns(values) - target
        swing = np.abs(phasors.angle)
        errors = np.abs(left) / (phasors.slope(values) * swing)
        return _model_variance(errors, phasors.variance / swing**2, values.size)

    @property
    def idle(self) -> tuple[str, ...]:
        """Terms that a bound holds at nothing."""
        names = zip(self.phasors.names, self.solved.on_bound.tolist(), strict=True)
        kept = {*PARAMETERS, *self.phasors.known.parameters}
        return tuple(name for name, held in names if held and name not in kept)

    def moved_to(self, other: HarmonicBalanceFit) -> float:
        """Return by what share of its errors another fit of the same names lies elsewhere."""
        there = self.regression.unknowns(other.solved.values)
        here = self.regression.unknowns(self.solved.values)
        left = float(np.linalg.norm(self.solved.residuals))
        return float(np.linalg.norm(self.regression.rows @ (there - here))) / left if left else 0.0

    def nested(self, phasors: Phasors) -> Submodels:
        """Return the equations of a balance with more terms, as this one weighs them."""
        about = self.parameters
        regression = _regression(phasors, phasors.equations(about), self.weights, about)
        values = np.array([getattr(about, name) for name in phasors.names])
        solution = Solution(values=values, on_bound=np.zeros(values.size, dtype=bool))
        slope, swing = self.phasors.slope(self.solved.values), np.abs(self.phasors.angle)
        negligible = NEGLIGIBLE * float(np.mean(self.weights * slope * swing))
        return submodels_of(CellEquations.of(regression, solution), phasors.masses, negligible)

    def on_likeliest_base(self, more: Sequence[str] = ()) -> HarmonicBalanceFit:
        """Return the fit, its phasors on the likeliest base beside ``more`` terms."""
        naturals, dampings = self._shapes

        def left(shape: Shape) -> float:
            return self._on_base(shape, more)[0]

        best = min(product(naturals, dampings), key=left)
        if not np.isfinite(left(best)):
            return self
        bounds = [(each[0], each[-1]) for each in (naturals, dampings)]
        how = {"method": "Nelder-Mead", "bounds": bounds, "options": {"maxiter": MOST}}
        standing = self._standing(minimize(left, best, **how).x)
        return replace(self, phasors=replace(self.phasors, standing=standing))

    @property
    def on_other_bases(self) -> tuple[Samples, ...]:
        """(n,) values on bases in 8 directions, residuals grown as by two standard errors."""
        shape = np.log(list(self.phasors.base.values()))[::-1]
        limits = np.array([(each[0], each[-1]) for each in self._shapes])
        least, _ = self._on_base(shape)
        most = least * (1 + 2 / (2 * self.phasors.omega.size - len(self.phasors.names) - 2))
        found = []
        for turn in np.arange(8) * np.pi / 4:
            way, near, far = np.array([np.cos(turn), np.sin(turn)]), 0.0, float(np.ptp(limits))
            for _ in range(_HALVES):
                middle = (near + far) / 2
                inside = self._on_base(np.clip(shape + middle * way, *limits.T))[0] <= most
                near, far = (middle, far) if inside else (near, middle)
            found.append(self._on_base(np.clip(shape + near * way, *limits.T))[1])
        return tuple(found)

    @property
    def _shapes(self) -> tuple[Samples, Samples]:
        """Logarithms of the frequencies and damping ratios of bases that are tried."""
        naturals = self.phasors.omega.max() * np.geomspace(*_NATURAL)
        return np.log(naturals), np.log(np.geomspace(*_DAMPING))

    def _standing(self, shape: Shape) -> LumpedParameters:
        """Return the hand on a base of some shape."""
        natural, damping = np.exp(shape).tolist()
        return replace(self.parameters, base_frequency=natural, base_damping=damping)

    def _on_base(self, shape: Shape, more: Sequence[str] = ()) -> tuple[float, Samples]:
        """Return the squared residuals, and the values, of the balance on a base of some shape."""
        names = tuple(dict.fromkeys((*self.phasors.names, BASE, *more)))
        on = replace(self.phasors, names=names, standing=self._standing(shape))
        about = self.parameters
        equations = _regression(on, on.equations(about), self.weights, about)
        found = equations.solve().values
        errors = equations.rows @ equations.unknowns(found) - equations.target
        return (float(errors @ errors) if found[names.index(BASE)] > 0 else np.inf), found

    def lacking(self, lost: Sequence[str], conditions: Conditions) -> str | None:
        """Return the rarer term that the balance lacks, if any; those ``lost`` are not tried."""
        names = (*self.phasors.names, *lost, BASE)
        if "stribeck" in names:  # what its velocity is off by would look like a spring
            names = (*names, "spring")
        every = candidates(RARER, self.phasors.masses, self.phasors.known)
        tried = tuple(n for n in every if n in offered("harmonic-balance") and n not in names)
        nested = self.nested(replace(self.phasors, names=(*self.phasors.names, *tried)))
        return lacking_term(nested.equations, tried, conditions)


def _regression(
    phasors: Phasors,
    balance: tuple[NDArray[np.complex128], NDArray[np.complex128]],
    weights: Samples,
    about: LumpedParameters,
) -> Regression:
    """Weigh the equations of a balance about a delay and a drive."""
    matrix, target = balance
    return Regression(
        names=phasors.names,
        rows=_real(matrix * weights[:, None]),
        target=_real(target * weights),
        cluster=np.tile(np.arange(phasors.omega.size), 2),
        about={name: getattr(about, name) for name in ("delay", *DRIVE)},
        gain=about.p4,
        prior=Penalty.of(phasors.names, phasors.known.parameters),
    )


def _real(values: NDArray[np.complex128]) -> Samples:
    return np.concatenate([values.real, values.imag])


def _model_variance(errors: Samples, variance: Samples, count: int) -> float:
    """Relative variance per component, common to all logs, that ``variance`` does not explain."""
    freedom = 2 * errors.size - count

    def excess(common: float) -> float:
        return float(np.sum(errors**2 / (variance + common))) - freedom

    largest = float(np.sum(errors**2)) / freedom
    if excess(0.0) <= 0:
        return 0.0
    return float(brentq(excess, 1e-12 * largest, largest * (1 + 1e-9), xtol=1e-9 * largest))
