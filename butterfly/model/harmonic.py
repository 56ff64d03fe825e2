"""The grey-box model's response to one sinusoid: linear, and quasi-linear at finite amplitude.

Harmonic balance keeps the fundamental only. With th(t) = Re{a e^(j(w t + phi))} the gravity term
p3 sin th contributes p3 2 J1(a)/a th and Coulomb friction j 4 T_c/(pi a) th, so the model stays
linear in its parameters (Gelb & Vander Velde, Multiple-Input Describing Functions, 1968, ch. 2).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import dawsn, j1

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from butterfly.model.parameters import LumpedParameters

_SMALLEST_SWING = 1e-6  # rad


def gravity_describing_function(amplitude: ArrayLike) -> NDArray[np.float64]:
    """Gain 2 J1(a)/a of ``sin`` for a sinusoid of amplitude a > 0 in rad; tends to 1 for a -> 0."""
    a = np.asarray(amplitude, dtype=np.float64)
    return np.asarray(2.0 * j1(a) / a)


def coulomb_describing_function(amplitude: ArrayLike) -> NDArray[np.complex128]:
    """Gain j 4/(pi a) of ``sgn(thd)`` on a sinusoidal angle of amplitude a > 0 in rad, in 1/rad."""
    a = np.asarray(amplitude, dtype=np.float64)
    return np.asarray(4j / (np.pi * a))


def frequency_response(parameters: LumpedParameters, omega: ArrayLike) -> NDArray[np.complex128]:
    """G(jw) of the linearisation (8), (13) with its input delay, in rad per unit of input.

    Coulomb friction has no linearisation and is left out.

    Parameters
    ----------
    parameters
        Of the hand with its added mass.
    omega
        Frequencies in rad/s, any shape.
    """
    p, w = parameters, np.asarray(omega, dtype=np.float64)
    return _input_gain(p, w) / (p.p3 - p.p1 * w**2 + _damping(p, w))


def quasi_linear_response(
    parameters: LumpedParameters, omega: ArrayLike, amplitude: ArrayLike
) -> NDArray[np.complex128]:
    """Ratio of the angle's to the input's fundamental when the angle swings with ``amplitude``.

    The swing is taken to be about angle 0; bias, offset and bristles are left out.

    Parameters
    ----------
    parameters
        Of the hand with its added mass.
    omega, amplitude
        Frequencies in rad/s and angle amplitudes in rad, shapes that broadcast.
    """
    p, w = parameters, np.asarray(omega, dtype=np.float64)
    stiffness = p.p3 * gravity_describing_function(amplitude) - p.p1 * w**2
    if p.cogging:
        swing = p.cogging_periods * np.asarray(amplitude)
        stiffness = stiffness - p.cogging * p.cogging_periods * gravity_describing_function(swing)
    friction = _friction_gain(p, w, np.asarray(amplitude, dtype=np.float64))
    return _input_gain(p, w) / (stiffness + friction + _damping(p, w))


def drag_describing_function(omega: ArrayLike, amplitude: ArrayLike) -> NDArray[np.complex128]:
    """Gain j 8 a w^2/(3 pi) of ``|thd| thd`` on an angle of amplitude a in rad, in rad/s^2."""
    w, a = np.asarray(omega, dtype=np.float64), np.asarray(amplitude, dtype=np.float64)
    return np.asarray(8j * a * w**2 / (3 * np.pi))


def stribeck_describing_function(
    omega: ArrayLike, amplitude: ArrayLike, velocity: float
) -> NDArray[np.complex128]:
    """Gain of ``sgn(thd) exp(-(thd/v_s)^2)`` on a sinusoidal angle of amplitude a in rad, in 1/rad.

    With b = a w/v_s it is j 4/(pi a) D(b)/b, D Dawson's integral.
    """
    a = np.asarray(amplitude, dtype=np.float64)
    b = a * np.asarray(omega, dtype=np.float64) / velocity
    return np.asarray(coulomb_describing_function(a) * dawsn(b) / b)


def _friction_gain(
    p: LumpedParameters, w: NDArray[np.float64], a: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """Torque over angle of the friction that is not viscous."""
    return np.asarray(
        p.coulomb * coulomb_describing_function(a)
        + p.stribeck * stribeck_describing_function(w, a, p.stribeck_velocity)
        + p.drag * drag_describing_function(w, a)
    )


def _input_gain(p: LumpedParameters, w: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Torque at standstill over input: gain, delay, and the armature's lag."""
    return np.asarray(p.p4 * np.exp(-1j * w * p.delay) / (1 + 1j * w * p.time_constant))


def _damping(p: LumpedParameters, w: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Torque over angle of friction and of the back EMF, the latter behind the armature's lag."""
    lagged = p.back_emf / (1 + 1j * w * p.time_constant)
    return np.asarray(1j * w * (p.p2 - p.back_emf + lagged))


def predicted_swing(parameters: LumpedParameters, omega: float, amplitude: float) -> float:
    """Return the steady amplitude in rad that a sine will drive the joint to, by harmonic balance.

    Where several are possible (a pendulum's resonance bends over) it is the largest. Zero if
    Coulomb friction holds the joint, infinite if no swing below pi balances the drive.

    Parameters
    ----------
    parameters
        Of the hand with its added mass.
    omega, amplitude
        Of the input, in rad/s and units of the input.
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


def resonance_frequency(parameters: LumpedParameters) -> float:
    """Frequency in rad/s at which |G(jw)| of the linearisation peaks (73), (77), (79).

    Zero when the damping is so large, or gravity so small, that there is no peak (Lemma 6).
    """
    p = parameters
    squared = p.p3 / p.p1 - 0.5 * (p.p2 / p.p1) ** 2
    return math.sqrt(squared) if squared > 0 else 0.0
