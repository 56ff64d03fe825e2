"""What a torque at the joint may depend on, and what the table of terms says of each.

A describing function is the gain of a nonlinear torque on a sinusoidal angle: with
th(t) = Re{a e^(j w t)} it is the fundamental of the torque over that of the angle (Gelb & Vander
Velde, Multiple-Input Describing Functions, 1968, ch. 2).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import dawsn, j1

from butterfly.arrays import Samples


class Motion(NamedTuple):
    """What a torque may depend on: numbers, or arrays of one shape."""

    angle: Any  # In rad from hanging down
    velocity: Any  # In rad/s
    direction: Any  # Sign of the velocity
    periods: float  # Of cogging in a turn
    stribeck_velocity: float  # In rad/s
    input: Any = 0.0  # As the drive delivers it
    weight: Any = 0.0  # Added weight on the bearing in N, where it is not in T_c already
    carried: Any = 0.0  # m l^2 in kg m^2 of the added mass, where it is not in p1 already


@dataclass(frozen=True)
class Term:
    """A row: one parameter and what it does."""

    name: str  # As in code,
    symbol: str  # and as printed
    unit: str  # In which "unit" is the input's
    meaning: str
    _: KW_ONLY
    lower: float = -math.inf  # Least value that an estimate can have
    # Braking torque per unit of the parameter, where it is a function of the `Motion`
    basis: Callable[[Motion], Any] | None = None
    # 2 for the inertia and 1 for viscous friction, whose basis is that derivative of the angle
    derivative: int = 0
    # Energy per unit of the parameter at an angle, with the periods of cogging in a turn; its slope
    # is the basis
    potential: Callable[[Any, float], Any] | None = None
    # Torque over angle, per unit, for a sine: from frequencies in rad/s, amplitudes in rad and the
    # `Motion` that holds weight and settings
    describing: Callable[[Samples, Samples, Motion], Any] | None = None
    # Whether it holds the joint at rest: a friction level times the sign of the velocity
    dry: bool = False
    of_gain: bool = False  # Whether what enters the equation is p4 times the parameter
    sign_observable: bool = True  # Whether motion tells the sign
    state: str = ""  # What it makes a state of the joint, if anything
    # Typical size, for scaling, where there is no basis to tell it: from the speed in rad/s and the
    # rate in rad/s of the motion
    size: Callable[[float, float], float] | None = None
    # What a residual torque of this shape is called; empty for one that is not looked for
    looks_like: str = ""
    follows: str = ""  # The term without which it says nothing
    # Names of the estimators that can estimate it when asked to
    offered: frozenset[str] = frozenset()


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
