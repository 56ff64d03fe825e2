"""The linearised model: about rest, with delay, or for one swing by describing functions."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from butterfly.arrays import Samples
from butterfly.errors import InputError
from butterfly.model.parameters import LumpedParameters
from butterfly.model.terms import CONSERVATIVE, TERMS, torque_of

HIGHEST_ORDER = 10
"""At this order a delay of half a turn is exact to rounding."""

LARGEST_SWING = 1.0
"""Swing in rad beyond which harmonics and resonance jumps appear."""

_SMALLEST_SWING = 1e-6  # rad
_ASIDE = 1e-20  # rad, of an imaginary step

_DESCRIBED = tuple(row for row in TERMS.values() if row.describing and row.name != "p2")


@dataclass(frozen=True, kw_only=True)
class LinearJoint:
    """p1 thdd + damping thd + stiffness th = torque, the motor's torque after its lag (8).

    time_constant torque' + torque = p4 u(t - delay) - back_emf thd. Friction that holds the joint
    at rest (Coulomb, Stribeck, gear, bristles) has no linearisation and is omitted, like the terms
    of the drive.
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
    def of(cls, parameters: LumpedParameters, angle: float = 0.0) -> LinearJoint:
        """Linearise the loaded joint about an angle in rad at which a constant input holds it."""
        p = parameters
        # by an imaginary step, exact to rounding (Squire & Trapp, SIAM Review 40, 1998)
        motion = p.motion(angle + 1j * _ASIDE, 0.0)
        back_emf = p.back_emf if p.time_constant > 0 else 0.0
        return cls(
            inertia=p.p1,
            damping=p.p2 - back_emf,
            back_emf=back_emf,
            stiffness=float(np.imag(torque_of(p, motion, CONSERVATIVE)) / _ASIDE),
            gain=p.p4,
            time_constant=p.time_constant,
            delay=p.delay,
        )

    def lag(self, omega: Samples) -> NDArray[np.complex128]:
        """Return 1/(1 + j w L/R) at frequencies in rad/s."""
        if self.time_constant == 0:
            return np.ones(omega.shape, dtype=np.complex128)
        return np.asarray(1 / (1 + 1j * omega * self.time_constant))

    def drive(self, omega: Samples) -> NDArray[np.complex128]:
        """Torque at standstill over input: gain, delay, and the armature's lag."""
        return np.asarray(self.gain * np.exp(-1j * omega * self.delay) * self.lag(omega))

    def brake(self, omega: Samples) -> NDArray[np.complex128]:
        """Torque over angle of viscous friction, and of the back EMF with the armature's lag."""
        return np.asarray(1j * omega * (self.damping + self.back_emf * self.lag(omega)))

    def response(self, omega: ArrayLike) -> NDArray[np.complex128]:
        """G(jw) (13) in rad per unit of input, at frequencies in rad/s of any shape."""
        w = np.asarray(omega, dtype=np.float64)
        return self.drive(w) / (self.stiffness - self.inertia * w**2 + self.brake(w))


def resonance_frequency(parameters: LumpedParameters) -> float:
    """Frequency in rad/s at which |G(jw)| of the linearisation peaks (73), (77), (79), or 0.

    With x = w^2 the square of the denominator is (k - c x)^2 + x (a - b x)^2; its slope vanishes
    at a root of a quadratic, the largest of which is the peak. Without the armature's lag, b = 0,
    there is one root.
    """
    p = LinearJoint.of(parameters)
    b, c = p.time_constant * p.inertia, p.inertia + p.time_constant * p.damping
    a = p.damping + p.back_emf + p.time_constant * p.stiffness
    if b == 0:
        damping = a / c if c else 0.0
        excess = p.stiffness / c - damping * damping / 2 if c else 0.0
        return math.sqrt(excess) if excess > 0 else 0.0
    roots = np.roots([3 * b**2, 2 * c**2 - 4 * a * b, a**2 - 2 * c * p.stiffness])
    squares = [float(root.real) for root in roots if root.imag == 0 and root.real > 0]
    return math.sqrt(max(squares, default=0.0))


@dataclass(frozen=True, kw_only=True, eq=False)
class DelayStates:
    """x' = a x + b u, y = c x + feedthrough u, where y is the delayed u."""

    # a, b, c: (n, n), (n,) and (n,)
    a: Samples
    b: Samples
    c: Samples
    feedthrough: float  # 1 or -1: every frequency comes through at its size

    @classmethod
    def of(cls, delay: float, order: int) -> DelayStates:
        """Approximate exp(-s delay) by a ratio of polynomials of an order up to `HIGHEST_ORDER`.

        The error at w rad/s is (n!)^2/((2n)! (2n + 1)!) (w delay)^(2n + 1) and less beyond (Baker &
        Graves-Morris, Padé Approximants, 1996, 1.2).
        """
        if not delay > 0:
            raise InputError("Padé", "delay", delay, "a positive time in s")
        if not isinstance(order, int) or order not in range(1, HIGHEST_ORDER + 1):
            raise InputError("Padé", "order", order, f"an integer from 1 to {HIGHEST_ORDER}")
        powers = np.arange(order + 1)
        size = [
            math.comb(order, int(k)) * math.perm(2 * order - int(k), order - int(k)) for k in powers
        ]
        # In time in units of delay/rate all coefficients are of one size.
        rate = float(size[0]) ** (1 / order)
        below = np.array(size, dtype=np.float64) * rate ** (powers - order)
        sign = (-1.0) ** powers
        a = np.diag(np.ones(order - 1), 1)
        a[-1] = -below[:-1]
        feedthrough = sign[-1]
        return cls(
            a=a * rate / delay,
            b=np.eye(order)[-1] * rate / delay,
            c=(sign * below - feedthrough * below)[:-1],
            feedthrough=float(feedthrough),
        )


def quasi_linear_response(
    parameters: LumpedParameters, omega: ArrayLike, amplitude: ArrayLike
) -> NDArray[np.complex128]:
    """Fundamental of the angle over that of the input, for swings of the loaded joint.

    The swing is about angle 0; terms without describing function (bias, offset, cosine of cogging,
    bristles, friction of a gear, terms of the drive) are omitted.
    """
    linear = LinearJoint.of(parameters)
    w, a = np.asarray(omega, dtype=np.float64), np.asarray(amplitude, dtype=np.float64)
    motion = parameters.motion(0.0, 0.0, **parameters.on_base)
    torque = linear.brake(w)
    for row in _DESCRIBED:
        value = getattr(parameters, row.name)
        if value:
            assert row.describing is not None  # noqa: S101 - or it would not be here
            torque = torque + value * row.describing(w, a, motion)
    return np.asarray(linear.drive(w) / torque)


def predicted_swing(parameters: LumpedParameters, omega: float, amplitude: float) -> float:
    """Return the steady amplitude in rad of a loaded joint driven by a sine, by harmonic balance.

    The largest if there are several (the resonance of a pendulum bends over); zero if Coulomb
    friction holds the joint, infinite if no swing below pi balances the drive.
    """
    swings = np.linspace(_SMALLEST_SWING, np.pi, 4096)
    excess = swings / np.abs(quasi_linear_response(parameters, omega, swings)) - abs(amplitude)
    falls_short = np.flatnonzero(excess < 0)
    if falls_short.size == 0:
        return 0.0
    last = int(falls_short[-1])
    if last == swings.size - 1:
        return math.inf
    share = excess[last] / (excess[last] - excess[last + 1])
    return float(swings[last] + share * (swings[last + 1] - swings[last]))
