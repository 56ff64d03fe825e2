"""The torques of the grey-box equation, compiled."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numba

if TYPE_CHECKING:
    from butterfly.model.parameters import LumpedParameters


State = tuple[float, float, float, float]
"""Angle in rad, velocity in rad/s, torque of the motor in N m (a state only with a lag), and
deflection of the bristles in rad (a state only with a stiffness of theirs)."""


class Constants(NamedTuple):
    """What the compiled equation needs to know, all numbers; see `LumpedParameters`."""

    p1: float
    viscous: float
    back_emf: float
    lag: float
    p3: float
    p3_offset: float
    coulomb: float
    stribeck: float
    stribeck_velocity: float
    bristle_stiffness: float
    bristle_damping: float
    drag: float
    bias: float
    cogging: float
    cogging_cosine: float
    cogging_periods: float

    @classmethod
    def of(cls, p: LumpedParameters) -> Constants:
        """Take them from the parameters of the hand with its added mass."""
        own = {"viscous": p.p2 - p.back_emf, "lag": p.time_constant}
        return cls(*(float(own.get(name, getattr(p, name, 0.0))) for name in cls._fields))


@numba.njit(cache=True)
def pull(x: float, c: Constants) -> float:
    """Torque in N m that depends on the angle alone: gravity, cogging and bias."""
    torque = c.bias - c.p3 * math.sin(x)
    if c.p3_offset != 0.0:
        torque -= c.p3_offset * math.cos(x)
    if c.cogging != 0.0 or c.cogging_cosine != 0.0:
        turned = c.cogging_periods * x
        torque += c.cogging * math.sin(turned) + c.cogging_cosine * math.cos(turned)
    return torque


@numba.njit(cache=True)
def friction_level(v: float, c: Constants) -> float:
    """Coulomb and Stribeck friction g(v) in N m, without its sign."""
    if c.stribeck == 0.0:
        return c.coulomb
    return c.coulomb + c.stribeck * math.exp(-((v / c.stribeck_velocity) ** 2))


@numba.njit(cache=True)
def rates(state: State, drive: float, sign: float, c: Constants) -> tuple[float, float, float]:
    """Return the rates of velocity, motor torque and bristles, sliding in the direction sign."""
    x, v, motor, bend = state
    torque = drive - c.back_emf * v
    motor_rate = 0.0
    if c.lag > 0.0:
        motor_rate = (torque - motor) / c.lag
        torque = motor
    bend_rate = 0.0
    level = friction_level(v, c)
    if c.bristle_stiffness > 0.0:
        bend_rate = v - c.bristle_stiffness * abs(v) * bend / level
        torque -= c.bristle_stiffness * bend + c.bristle_damping * bend_rate
    else:
        torque -= sign * level
    torque += pull(x, c) - (c.viscous + c.drag * abs(v)) * v
    return torque / c.p1, motor_rate, bend_rate
