"""The harmonic balance as a regression: regressors, targets, and the slope that weighs them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from butterfly.model.kinematics import Motion
from butterfly.model.known import NOTHING, Knowledge
from butterfly.model.parameters import AddedMass, LumpedParameters
from butterfly.model.terms import TERMS, FrictionTerms
from butterfly.signals.frequency_response import ResponsePoint

_SMALL_SWING = 1e-6  # rad, at which sin th = th to rounding
_SWING_STEP = 1e-4  # relative step of the differences in the swing
_LEAST_SLOPE = 1e-3  # of the inertia's torque: no joint is damped less than half of this
_EXACT = 1e-24  # relative variance of a phasor that rounding leaves even to exact data


@dataclass(frozen=True, eq=False)
class Phasors:
    """The (n,) arrays that enter the balance of n responses."""

    # omega, angle, input: frequencies in rad/s, phasors of angle in rad and input in its unit
    omega: NDArray[np.float64]
    angle: NDArray[np.complex128]
    input: NDArray[np.complex128]
    variance: NDArray[np.float64]  # of each component of the angle's phasor, in rad^2
    masses: tuple[AddedMass, ...]
    names: tuple[str, ...]  # the parameters that are estimated
    swing: NDArray[np.float64]  # in rad, at which the describing functions are taken
    # torque in N m that the motion of the model leaves over in the balance of its fundamentals:
    # what describing functions neglect, transients that still ring, stamps that are not regular
    remainder: NDArray[np.complex128]
    # further variance in rad^2, of logs in which the model does not move like the robot
    doubt: NDArray[np.float64]
    # what is known of the robot; what is known exactly is not among the names
    known: Knowledge = NOTHING
    # in rad/s, at which Stribeck friction is described
    stribeck_velocity: float = FrictionTerms.stribeck_velocity

    @classmethod
    def of(
        cls,
        points: Sequence[ResponsePoint],
        names: tuple[str, ...],
        *,
        small: bool,
        known: Knowledge = NOTHING,
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
            swing=np.full(angle.size, _SMALL_SWING) if small else np.abs(angle),
            remainder=np.zeros(angle.size, dtype=np.complex128),
            doubt=np.zeros(angle.size),
            known=known,
            stribeck_velocity=known.exact.get("stribeck_velocity", FrictionTerms.stribeck_velocity),
        )

    def take(self, rows: NDArray[np.bool_]) -> Phasors:
        """Return the balance of some responses, by a mask."""
        return replace(
            self,
            omega=self.omega[rows],
            angle=self.angle[rows],
            input=self.input[rows],
            variance=self.variance[rows],
            masses=tuple(mass for mass, taken in zip(self.masses, rows, strict=True) if taken),
            swing=self.swing[rows],
            remainder=self.remainder[rows],
            doubt=self.doubt[rows],
        )

    def corrected(
        self,
        parameters: LumpedParameters,
        moved: NDArray[np.complex128],
        told: NDArray[np.bool_],
        doubt: NDArray[np.float64],
    ) -> Phasors:
        """Return the balance, with the remainder of a model's motion.

        ``parameters``: of the model; ``moved``: (n,) phasors in rad of its angle, simulated with
        the recorded inputs; ``told``: (n,) whether they can tell of a remainder; ``doubt``: (n,)
        variance in rad^2 of the angles of logs in which the model does not move alike.
        """
        model = replace(
            self, angle=moved, swing=np.abs(moved), remainder=np.zeros_like(self.remainder)
        )
        matrix, target = model.equations(parameters.delay)
        values = [0.0 if n == "delay" else getattr(parameters, n) for n in self.names]
        left = matrix @ np.array(values) - target
        remainder = np.where(told, left, 0.0)
        return replace(self, remainder=remainder, doubt=doubt)

    def equations(self, delay: float) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """(n, p) regressors of the parameters, p4 (d - ``delay``) for the delay; (n,) targets."""
        late = self.input * np.exp(-1j * self.omega * delay)
        driven = {"p4": -late, "delay": 1j * self.omega * late}
        columns = [driven[name] if name in driven else self._columns[name] for name in self.names]
        gain = self.known.exact.get("p4", 0.0)
        return np.column_stack(columns), self._target - gain * driven["p4"]

    def described(self, values: NDArray[np.float64]) -> LumpedParameters:
        """Return the model's parameters: (n,) values of the names, and what is known exactly."""
        found = dict(zip(self.names, values.tolist(), strict=True))
        told = self.known.exact | {"stribeck_velocity": self.stribeck_velocity}
        return LumpedParameters(**told | found)

    def slope(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Rms slope of the left-hand side in the angle's phasor, over its directions, (n,)."""
        found = self.known.exact | dict(zip(self.names, values.tolist(), strict=True))
        inertia = self._inertia + found.get("p1", 0.0)
        acting = {**found, "p1": inertia, "p3": self._moment + found.get("p3", 0.0)}
        torques = sum(acting[name] * each for name, each in self._swings.items())
        below, there, above = np.asarray(torques)
        radial = (above - below) / (2 * _SWING_STEP * self.swing)
        tangential = there / self.swing
        least = _LEAST_SLOPE * np.maximum(np.abs(inertia), self._inertia.max()) * self.omega**2
        rms = np.sqrt((np.abs(radial) ** 2 + np.abs(tangential) ** 2) / 2)
        return np.asarray(np.maximum(rms, least))

    @cached_property
    def _inertia(self) -> NDArray[np.float64]:
        """(n,) in kg m^2, of the added masses."""
        return np.array([mass.inertia for mass in self.masses])

    @cached_property
    def _moment(self) -> NDArray[np.float64]:
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

    def _described(self, swing: NDArray[np.float64]) -> dict[str, NDArray[np.complex128]]:
        """Return the describing functions of what acts, at (..., n) swings in rad."""
        weight = np.array([mass.weight for mass in self.masses])
        periods = self.known.exact.get("cogging_periods", FrictionTerms.cogging_periods)
        settings = FrictionTerms(stribeck_velocity=self.stribeck_velocity, cogging_periods=periods)
        motion = Motion.of(settings, 0.0, 0.0, weight=weight)
        return {
            row.name: np.asarray(row.describing(self.omega, swing, motion))
            for row in TERMS.values()
            if row.describing is not None
            and row.name in {*self.names, *self.known.exact, "p1", "p3"}
        }

    @cached_property
    def _target(self) -> NDArray[np.complex128]:
        """(n,) torques that the known masses and the remainder leave to the parameters.

        So do the parameters that are known exactly, but for the motor's.
        """
        carried = self._inertia * self._columns["p1"] + self._moment * self._columns["p3"]
        for name, value in self.known.exact.items():
            if name in self._columns:
                carried = carried + value * self._columns[name]
        return np.asarray(self.remainder - carried)
