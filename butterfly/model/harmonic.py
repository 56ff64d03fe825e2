"""The model's response to one sinusoid of finite amplitude.

Harmonic balance keeps the fundamental only: each torque enters by its describing function, the
term p3 sin th as p3 2 J1(a)/a th, Coulomb friction as j 4 T_c/(pi a) th, so that the model stays
linear in its parameters (Gelb & Vander Velde, Multiple-Input Describing Functions, 1968, ch. 2).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from butterfly.model.kinematics import Motion
from butterfly.model.linear import Linearisation
from butterfly.model.parameters import LumpedParameters
from butterfly.model.terms import TERMS

LARGEST_SWING = 1.0
"""Swing in rad beyond which harmonics, and jumps of the resonance, set in."""

_SMALLEST_SWING = 1e-6  # rad

_DESCRIBED = tuple(row for row in TERMS.values() if row.describing and row.name != "p2")


def quasi_linear_response(
    parameters: LumpedParameters, omega: ArrayLike, amplitude: ArrayLike
) -> NDArray[np.complex128]:
    """Ratio of the angle's to the input's fundamental when the angle swings with ``amplitude``.

    The swing is taken to be about angle 0; what has no describing function (bias, offset, cosine of
    cogging, bristles, compression) is left out.

    Of the loaded hand; frequencies in rad/s and amplitudes in rad broadcast.
    """
    linear = Linearisation.of(parameters)
    w, a = np.asarray(omega, dtype=np.float64), np.asarray(amplitude, dtype=np.float64)
    motion = Motion.of(parameters, 0.0, 0.0)
    torque = linear.brake(w)
    for row in _DESCRIBED:
        value = getattr(parameters, row.name)
        if value:
            assert row.describing is not None  # noqa: S101 - or it would not be here
            torque = torque + value * row.describing(w, a, motion)
    return np.asarray(linear.drive(w) / torque)


def predicted_swing(parameters: LumpedParameters, omega: float, amplitude: float) -> float:
    """Return the steady amplitude in rad that a sine will drive the joint to, by harmonic balance.

    Where several are possible (a pendulum's resonance bends over) it is the largest. Zero if
    Coulomb friction holds the joint, infinite if no swing below pi balances the drive.

    Of the loaded hand; the input has `omega` in rad/s and `amplitude` in its own unit.
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
