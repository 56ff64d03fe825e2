"""The grey-box equation: rates of the state (velocity, torque of the motor, bristles)."""

from __future__ import annotations

import math

from butterfly.compiled import compiled

_LAG_STEPS = 16  # least number of steps in one time constant of the armature
_BRISTLE_STEPS = 4  # the same in one time constant of the bristles
_VANISHED = 6.0  # Stribeck velocities, at which exp(-36) is lost in rounding


@compiled
def rates(state, drive, sign, c):
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


@compiled
def pull(x, c):
    """Torque in N m that depends on the angle alone: gravity, cogging and bias."""
    torque = c.bias - c.p3 * math.sin(x)
    if c.p3_offset != 0.0:
        torque -= c.p3_offset * math.cos(x)
    if c.cogging != 0.0 or c.cogging_cosine != 0.0:
        turned = c.cogging_periods * x
        torque += c.cogging * math.sin(turned) + c.cogging_cosine * math.cos(turned)
    return torque


@compiled
def friction_level(v, c):
    """Coulomb and Stribeck friction g(v) in N m, without its sign."""
    return c.coulomb if c.stribeck == 0.0 else c.coulomb + c.stribeck * excess_at(v, c)


@compiled
def excess_at(v, c):
    """Share of the Stribeck friction that is left at a velocity."""
    if abs(v) > _VANISHED * c.stribeck_velocity:
        return 0.0
    return math.exp(-((v / c.stribeck_velocity) ** 2))


@compiled
def least_steps(c, v, h):
    """Count the steps that lag and bristles ask for in h s at a velocity of v rad/s."""
    count = 1
    if c.lag > 0.0:
        count = max(count, math.ceil(_LAG_STEPS * h / c.lag))
    if c.bristle_stiffness > 0.0:
        damping = (c.viscous + c.bristle_damping) / c.p1
        fastest = max(
            c.bristle_stiffness * abs(v) / friction_level(v, c),
            damping,
            math.sqrt(c.bristle_stiffness / c.p1),
        )
        count = max(count, math.ceil(_BRISTLE_STEPS * h * fastest))
    return count
