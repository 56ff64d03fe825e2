"""The linearisation of the model about rest: one for responses, resonances and control objects."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from butterfly.model.energy import stiffness
from butterfly.model.parameters import LumpedParameters


@dataclass(frozen=True, kw_only=True)
class Linearisation:
    """p1 thdd + damping thd + stiffness th = torque, the motor's torque behind its lag (8).

    time_constant torque' + torque = p4 u(t - delay) - back_emf thd. Friction that holds the joint
    at rest (Coulomb, Stribeck, bristles) has no linearisation and is left out, as is the
    compression of the drive, which vanishes with the input.
    """

    inertia: float  # p1 in kg m^2
    # damping, back_emf: In N m s/rad: outside of the motor, and of its back EMF
    damping: float
    back_emf: float
    stiffness: float  # Slope of gravity, offset and cogging in N m/rad
    gain: float  # p4 in N m per unit of input
    # time_constant, delay: Of the armature, and of the input, in s
    time_constant: float
    delay: float

    @classmethod
    def of(cls, parameters: LumpedParameters, angle: float = 0.0) -> Linearisation:
        """Linearise the loaded hand about an angle in rad at which some constant input holds it."""
        p = parameters
        back_emf = p.back_emf if p.time_constant > 0 else 0.0
        return cls(
            inertia=p.p1,
            damping=p.p2 - back_emf,
            back_emf=back_emf,
            stiffness=stiffness(p, angle),
            gain=p.p4,
            time_constant=p.time_constant,
            delay=p.delay,
        )

    def lag(self, omega: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return 1/(1 + j w L/R) at frequencies in rad/s."""
        if self.time_constant == 0:
            return np.ones(omega.shape, dtype=np.complex128)
        return np.asarray(1 / (1 + 1j * omega * self.time_constant))

    def drive(self, omega: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Torque at standstill over input: gain, delay, and the armature's lag."""
        return np.asarray(self.gain * np.exp(-1j * omega * self.delay) * self.lag(omega))

    def brake(self, omega: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Torque over angle of viscous friction, and of the back EMF behind the armature's lag."""
        return np.asarray(1j * omega * (self.damping + self.back_emf * self.lag(omega)))

    def response(self, omega: ArrayLike) -> NDArray[np.complex128]:
        """G(jw) (13) in rad per unit of input, at frequencies in rad/s of any shape."""
        w = np.asarray(omega, dtype=np.float64)
        return self.drive(w) / (self.stiffness - self.inertia * w**2 + self.brake(w))

    @property
    def resonance(self) -> float:
        """Frequency in rad/s at which |G(jw)| peaks (73), (77), (79); 0 where it has no peak.

        With x = w^2 the square of the denominator is (k - c x)^2 + x (a - b x)^2; its slope
        vanishes at a root of a quadratic, the largest of which is the peak. Without the armature's
        lag, b = 0, there is one root.
        """
        b = self.time_constant * self.inertia
        c = self.inertia + self.time_constant * self.damping
        a = self.damping + self.back_emf + self.time_constant * self.stiffness
        if b == 0:
            damping = a / c if c else 0.0
            excess = self.stiffness / c - damping * damping / 2 if c else 0.0
            return math.sqrt(excess) if excess > 0 else 0.0
        roots = np.roots([3 * b**2, 2 * c**2 - 4 * a * b, a**2 - 2 * c * self.stiffness])
        squares = [float(root.real) for root in roots if root.imag == 0 and root.real > 0]
        return math.sqrt(max(squares, default=0.0))


def frequency_response(parameters: LumpedParameters, omega: ArrayLike) -> NDArray[np.complex128]:
    """G(jw) of the linearisation about the hanging position (see `Linearisation.response`).

    Of the loaded hand, at frequencies in rad/s of any shape.
    """
    return Linearisation.of(parameters).response(omega)


def resonance_frequency(parameters: LumpedParameters) -> float:
    """Frequency in rad/s at which |G(jw)| of the linearisation peaks.

    Zero when the damping is so large, or gravity so small, that there is no peak (Lemma 6).
    """
    return Linearisation.of(parameters).resonance
