"""Describing functions: the gain of a nonlinear torque on a sinusoidal angle.

With th(t) = Re{a e^(j w t)} it is the fundamental of the torque over that of the angle (Gelb &
Vander Velde, Multiple-Input Describing Functions, 1968, ch. 2).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import dawsn, j0, j1, jv

from butterfly.arrays import Samples


def gravity_describing_function(a: Samples) -> Samples:
    """Gain 2 J1(a)/a of ``sin`` for a sinusoid of amplitude a > 0 in rad; tends to 1 for a -> 0.

    That of ``sin(N th)`` is N times that of N a.
    """
    return np.asarray(2.0 * j1(a) / a)


def coulomb_describing_function(a: Samples) -> NDArray[np.complex128]:
    """Gain j 4/(pi a) of ``sgn(thd)`` on a sinusoidal angle of amplitude a > 0 in rad, in 1/rad."""
    return np.asarray(4j / (np.pi * a))


def stribeck_describing_function(
    omega: Samples, a: Samples, velocity: float
) -> NDArray[np.complex128]:
    """Gain of ``sgn(thd) exp(-(thd/v_s)^2)`` on a sinusoidal angle of amplitude a in rad, in 1/rad.

    With b = a w/v_s it is j 4/(pi a) D(b)/b, D Dawson's integral.
    """
    b = a * omega / velocity
    return np.asarray(coulomb_describing_function(a) * dawsn(b) / b)


def base_describing_function(
    omega: Samples, a: Samples, moment: float, base: tuple[float, float]
) -> NDArray[np.complex128]:
    """Gain, per compliance, by which a base reduces the torque on a joint that swings by a rad.

    ``moment``: first moment H in kg m; ``base``: its frequency in rad/s and damping ratio. With
    Q = 1 - (w/w_b)^2 + 2 j zeta w/w_b of a stiff base, h' = H cos th pulls with H cos(th) s'' where
    Q s = w^2 times the fundamental of H sin th.
    """
    natural, damping = base
    pushed = moment * gravity_describing_function(a)
    force = omega**2 * pushed / (1 - (omega / natural) ** 2 + 2j * damping * omega / natural)
    along, across = j0(a) - jv(2, a), j0(a) + jv(2, a)
    return np.asarray(-(omega**2) * moment * (along * force.real + 1j * across * force.imag))
