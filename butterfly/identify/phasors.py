"""The harmonic balance as a regression: regressors, targets, and the slope that weighs them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from butterfly.model.friction import FrictionTerms
from butterfly.model.harmonic import (
    coulomb_describing_function,
    drag_describing_function,
    gravity_describing_function,
    quasi_linear_response,
    stribeck_describing_function,
)
from butterfly.model.parameters import LumpedParameters

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from butterfly.model.parameters import AddedMass
    from butterfly.signals.frequency_response import ResponsePoint

_SMALL_SWING = 1e-3  # rad, at which the slope of sin is 1
_SWING_STEP = 1e-4  # relative step of the differences in the swing
_EXACT = 1e-24  # relative variance of a phasor that rounding leaves even to exact data


@dataclass(frozen=True, eq=False)
class Phasors:
    """The (n,) arrays that enter the balance of n responses.

    Parameters
    ----------
    omega, angle, input
        Frequencies in rad/s, phasors of angle in rad and input in its unit.
    variance
        Of each component of the angle's phasor, in rad^2.
    masses
        What the hand carried.
    names
        The parameters that are estimated.
    small
        Whether the swings count as small, so that sin th = th.
    """

    omega: NDArray[np.float64]
    angle: NDArray[np.complex128]
    input: NDArray[np.complex128]
    variance: NDArray[np.float64]
    masses: tuple[AddedMass, ...]
    names: tuple[str, ...]
    small: bool

    @classmethod
    def of(cls, points: Sequence[ResponsePoint], names: tuple[str, ...], *, small: bool) -> Phasors:
        """Collect them from steady responses."""
        return cls(
            omega=np.array([p.omega for p in points]),
            angle=np.array([p.angle.fundamental for p in points]),
            input=np.array([p.input for p in points]),
            variance=np.array(
                [max(np.trace(p.angle.covariance) / 2, _EXACT * p.amplitude**2) for p in points]
            ),
            masses=tuple(p.added_mass for p in points),
            names=names,
            small=small,
        )

    def regression(self, delay: float) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """(n, p) regressors of the parameters, p4 (d - ``delay``) for the delay; (n,) targets."""
        w, th, a = self.omega, self.angle, np.abs(self.angle)
        u = self.input * np.exp(-1j * w * delay)
        gravity = th if self.small else gravity_describing_function(a) * th
        coulomb = coulomb_describing_function(a) * th
        velocity = FrictionTerms.stribeck_velocity
        columns = {
            "p1": -(w**2) * th,
            "p2": 1j * w * th,
            "p3": gravity,
            "p4": -u,
            "coulomb": coulomb,
            "delay": 1j * w * u,
            "drag": drag_describing_function(w, a) * th,
            "load": np.array([mass.weight for mass in self.masses]) * coulomb,
            "stribeck": stribeck_describing_function(w, a, velocity) * th,
        }
        inertia = np.array([mass.inertia for mass in self.masses])
        moment = np.array([mass.gravity_moment for mass in self.masses])
        matrix = np.column_stack([columns[name] for name in self.names])
        return matrix, inertia * w**2 * th - moment * gravity

    def slope(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Rms slope of the left-hand side in the angle's phasor, over its directions, (n,)."""
        known = dict(zip(self.names, values.tolist(), strict=True)) | {"delay": 0.0}
        hand = LumpedParameters(**known)
        swings = np.full(self.omega.size, _SMALL_SWING) if self.small else np.abs(self.angle)
        slopes = np.empty(self.omega.size)
        for mass in set(self.masses):
            rows = np.array([each == mass for each in self.masses])
            loaded = hand.with_added_mass(mass)
            slopes[rows] = _slope(loaded, self.omega[rows], swings[rows])
        return slopes


def _slope(
    loaded: LumpedParameters, omega: NDArray[np.float64], swing: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Rms, over its directions, of the slope of torque in angle at the swings of some logs."""
    h = _SWING_STEP * swing
    torques = [a / quasi_linear_response(loaded, omega, a) for a in (swing - h, swing, swing + h)]
    below, there, above = (loaded.p4 * torque for torque in torques)
    radial, tangential = (above - below) / (2 * h), there / swing
    return np.asarray(np.sqrt((np.abs(radial) ** 2 + np.abs(tangential) ** 2) / 2))
