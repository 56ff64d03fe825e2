"""Describing functions: the gain of a nonlinear torque on a sinusoidal angle.

With th(t) = Re{a e^(j w t)} each returns the fundamental of the torque over that of the angle
(Gelb & Vander Velde, Multiple-Input Describing Functions, 1968, ch. 2).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import dawsn, j1


def gravity_describing_function(amplitude: ArrayLike) -> NDArray[np.float64]:
    """Gain 2 J1(a)/a of ``sin`` for a sinusoid of amplitude a > 0 in rad; tends to 1 for a -> 0."""
    a = np.asarray(amplitude, dtype=np.float64)
    return np.asarray(2.0 * j1(a) / a)


def cogging_describing_function(amplitude: ArrayLike, periods: float) -> NDArray[np.float64]:
    """Gain N 2 J1(N a)/(N a) of ``sin(N th)``, N its periods in a turn."""
    a = np.asarray(amplitude, dtype=np.float64)
    return np.asarray(periods * gravity_describing_function(periods * a))


def coulomb_describing_function(amplitude: ArrayLike) -> NDArray[np.complex128]:
    """Gain j 4/(pi a) of ``sgn(thd)`` on a sinusoidal angle of amplitude a > 0 in rad, in 1/rad."""
    a = np.asarray(amplitude, dtype=np.float64)
    return np.asarray(4j / (np.pi * a))


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
