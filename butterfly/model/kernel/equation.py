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


_ROUNDING = 1e-12  # share of an interval


@compiled
def drive_at(drives, fraction):
    """Evaluate the parabola through drives at fractions 0, 1/2 and 1 of the interval."""
    start, middle, end = drives
    bend = 2.0 * (start - 2.0 * middle + end)
    return start + fraction * (end - start - bend + bend * fraction)


@compiled
def drive_slope(drives, fraction):
    """Differentiate `drive_at` by the fraction."""
    start, middle, end = drives
    bend = 2.0 * (start - 2.0 * middle + end)
    return end - start - bend + 2.0 * bend * fraction


@compiled
def exceeds_at(drives, begin, load, most):
    """Return where a parabola and a load first exceed ``most`` from a fraction on, and their sign.

    The fraction is 1 where they do not; at ``begin`` they do not yet.
    """
    start, middle, end = drives
    bend = 2.0 * (start - 2.0 * middle + end)
    slope = end - start - bend
    first, side = 1.0, 0.0
    for sign in (-1.0, 1.0):
        offset = start + load - sign * most
        square = slope**2 - 4.0 * bend * offset
        if square <= 0.0:
            continue
        outward = sign * math.sqrt(square)  # the slope where it is exceeded
        if slope * outward >= 0.0:
            at = -2.0 * offset / (slope + outward)
        elif bend != 0.0:
            at = (outward - slope) / (2.0 * bend)
        else:
            continue
        if begin - _ROUNDING <= at < first:
            first, side = max(at, begin), sign
    return first, side


@compiled
def part_of(drives, part, parts):
    """Return the drives of one of ``parts`` equal parts of the interval, counted from 0."""
    return (
        drive_at(drives, part / parts),
        drive_at(drives, (part + 0.5) / parts),
        drive_at(drives, (part + 1) / parts),
    )


@compiled
def piece_of(drives, begin, share):
    """Return the drives of ``share`` of the interval from fraction ``begin`` on."""
    return (
        drive_at(drives, begin),
        drive_at(drives, begin + 0.5 * share),
        drive_at(drives, begin + share),
    )
