"""The grey-box equation: its constants, rates of the state, derivatives; a moving base."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from butterfly.compiled import compiled, inlined, inner, pasted
from butterfly.model.terms import DRIVE, LOOP_TERMS

State = tuple[float, float, float, float]
"""Angle in rad, velocity in rad/s, motor torque in N m (a state only with a lag), and deflection of
the bristles in rad (a state only with bristles); on a moving base, which has neither, the last two
are the force of its spring in N and its rate in N/s."""

X, V, M, Z = range(4)


class Constants(NamedTuple):
    """All numbers of the equation; see `LumpedParameters`."""

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
    spring: float
    cogging: float
    cogging_cosine: float
    cogging_periods: float
    motor_friction: float
    load_friction: float
    motor_stribeck: float
    load_stribeck: float
    lifting_stribeck: float
    lowering_stribeck: float
    geared: float  # 1 with any of the last six
    give: float  # Of a moving base, the rest too
    swing: float
    slow: float
    moment: float
    moment_offset: float
    coulomb_slope: float


THROUGH_DRIVE = ("p4", "delay", "slow_delay", *DRIVE, *LOOP_TERMS, "begin_to_give")
COLUMNS = {name: number for number, name in enumerate((*Constants._fields, *THROUGH_DRIVE))}
"""Number of the derivative by each constant, and by each parameter of the drives."""

DRIVES = len(Constants._fields)
MOST_DRIVES = len(COLUMNS) - DRIVES

P1, VISCOUS, BACK_EMF, LAG, P3, P3_OFFSET, COULOMB, STRIBECK = range(8)
STRIBECK_VELOCITY, STIFFNESS, DAMPING, DRAG, BIAS, SPRING = range(8, 14)
COGGING, COGGING_COSINE, PERIODS = range(14, 17)
MOTOR_FRICTION, LOAD_FRICTION, MOTOR_STRIBECK, LOAD_STRIBECK = range(17, 21)
LIFTING_STRIBECK, LOWERING_STRIBECK = range(21, 23)
GIVE, SWING, SLOW, MOMENT, MOMENT_OFFSET, COULOMB_SLOPE = range(24, 30)

BASIS = 4
WEIGHT = BASIS + DRIVES + MOST_DRIVES
RATE = WEIGHT + 4
GAIN = RATE + 1
BY_BEGIN, BY_SHARE, DIRECT = range(GAIN + 1, GAIN + 4)
START = GAIN + 4
PRODUCT = START + 1
MOVE = PRODUCT + 4
STAGE_WIDTH = MOVE + 4
"""Columns of a stage after the derivatives by the states: derivatives by constants and drives,
weights of the stage, rates, the derivative by the drive, and (in the first stage) the derivatives
of a step's end by its begin and its share, with what `differentiate.carry_all` needs."""

MOST_STEPS = 20_000
"""Steps of one interval beyond which a motion counts as diverged: what settles ten thousand times
within it no log shows, and less than 1,500 are what stiff bristles at full speed need in 10 ms."""

_LAG_STEPS = 16  # least number of steps in one time constant of the armature
_DAMPED_STEPS = 2  # the same in one time constant of the speed: from 0.4 on RK4 is stable
_BRISTLE_STEPS = 4  # the same in one time constant of the bristles
_TANGENTS = 30  # at most: straight parts of friction need three
_ROUNDING = 1e-14
_VANISHED = 6.0  # Stribeck velocities, at which exp(-36) is lost in rounding


@inlined
def rates(state, drive, sign, c):
    """Return the rates of velocity, motor torque and bristles, sliding in the direction sign."""
    x, v, motor, bend = state
    torque = drive - c.back_emf * v
    motor_rate = 0.0
    if c.lag > 0.0:
        motor_rate = (torque - motor) / c.lag
        torque = motor
    bend_rate = 0.0
    load = pull(x, c)
    level = friction_level(x, v, sign, torque, load, c)
    if c.bristle_stiffness > 0.0:
        bend_rate = v - c.bristle_stiffness * abs(v) * bend / level
        torque -= c.bristle_stiffness * bend + c.bristle_damping * bend_rate
    else:
        torque -= sign * level
    torque += load - (c.viscous + c.drag * abs(v)) * v
    return torque / c.p1, motor_rate, bend_rate


@inner
def pull(x, c):
    """Torque in N m that depends only on the angle: gravity, spring, cogging and bias."""
    torque = c.bias - c.p3 * math.sin(x) - c.spring * x
    if c.p3_offset != 0.0:
        torque -= c.p3_offset * math.cos(x)
    if c.cogging != 0.0 or c.cogging_cosine != 0.0:
        turned = c.cogging_periods * x
        torque += c.cogging * math.sin(turned) + c.cogging_cosine * math.cos(turned)
    return torque


@pasted
def coulomb_at(x, c):
    """Coulomb torque in N m at an angle."""
    return c.coulomb if c.coulomb_slope == 0.0 else max(c.coulomb + c.coulomb_slope * x, 0.0)


@inner
def friction_level(x, v, sign, motor, load, c):
    """Friction g(v) in N m towards ``sign``, under the torques of motor and load in N m."""
    level, at_rest = coulomb_at(x, c), c.stribeck
    if c.geared != 0.0:
        level += abs(c.motor_friction * motor - c.load_friction * load)
        at_rest = stribeck_level(sign, motor, load, c)
    return level if at_rest == 0.0 else level + at_rest * excess_at(v, c)


@pasted
def stribeck_level(sign, motor, load, c):
    """Excess of friction at rest in N m, under the torques of motor and load in N m."""
    excess = c.stribeck + abs(c.motor_stribeck * motor - c.load_stribeck * load)
    if c.lifting_stribeck != 0.0 or c.lowering_stribeck != 0.0:
        excess += _by_direction(sign, load, c) * passed_on(motor, load) ** 2
    return excess


@pasted
def _by_direction(sign, load, c):
    """Return the growth with torque squared: for the motor driving the load, or driven by it."""
    return c.lifting_stribeck if sign * load < 0.0 else c.lowering_stribeck


@pasted
def passed_on(motor, load):
    """Smaller torque in N m of motor and load if they oppose each other, else 0."""
    return min(abs(motor), abs(load)) if motor * load < 0.0 else 0.0


@pasted
def slope(by_motor, by_load, motor, load):
    """Differentiate ``abs(by_motor motor - by_load load)`` by both; from 0 onwards."""
    way = np.sign(by_motor * motor - by_load * load)
    return (way * motor, -way * load) if way != 0.0 else (abs(motor), abs(load))


@pasted
def slopes(sign, motor, load, c):
    """Slopes of friction over the torques of motor and load, and those of its excess at rest."""
    slides = np.sign(c.motor_friction * motor - c.load_friction * load)
    rests = np.sign(c.motor_stribeck * motor - c.load_stribeck * load)
    by_motor, by_load = rests * c.motor_stribeck, -rests * c.load_stribeck
    steep = 2.0 * _by_direction(sign, load, c) * passed_on(motor, load)
    if abs(motor) < abs(load):
        by_motor += steep * np.sign(motor)
    else:
        by_load += steep * np.sign(load)
    return slides * c.motor_friction, -slides * c.load_friction, by_motor, by_load


@inner
def holds_to(x, sign, load, c):
    """Motor torque in N m up to which friction keeps a joint from sliding to ``sign``.

    The excess of torque over friction is concave: tangents approach its zero from one side.
    """
    motor = -load
    for _ in range(_TANGENTS):
        lacking = friction_level(x, 0.0, sign, motor, load, c) - sign * (motor + load)
        by_motor, _, at_rest, _ = slopes(sign, motor, load, c)
        rise = 1.0 - sign * (by_motor + at_rest)
        if rise <= 0.0:
            return sign * math.inf
        motor += sign * lacking / rise
        if lacking <= _ROUNDING * abs(motor) or c.geared == 0.0:
            break
    return motor


@compiled
def friction_at(x, v, motor, c):
    """Friction in N m of a joint at an angle and a velocity under the torque of its motor."""
    load = pull(x, c)
    return friction_level(x, v, np.sign(v if v != 0.0 else motor + load), motor, load, c)


@pasted
def excess_at(v, c):
    """Remaining fraction of the Stribeck friction at a velocity."""
    if abs(v) > _VANISHED * c.stribeck_velocity:
        return 0.0
    return math.exp(-((v / c.stribeck_velocity) ** 2))


@compiled
def least_steps(c, v, h):
    """Return the steps needed in h s at v rad/s for damping, lag and bristles.

    0 for an invalid velocity, or for more than `MOST_STEPS`.
    """
    damping = (c.viscous + c.back_emf + 2.0 * c.drag * abs(v)) / c.p1
    needed = _DAMPED_STEPS * h * damping
    if c.lag > 0.0:
        needed = max(needed, _LAG_STEPS * h / c.lag)
    if c.bristle_stiffness > 0.0:
        slip = c.bristle_stiffness * abs(v) / friction_level(0.0, v, 0.0, 0.0, 0.0, c)
        damping = (c.viscous + c.bristle_damping) / c.p1
        needed = max(needed, _BRISTLE_STEPS * h * max(slip, damping))
        needed = max(needed, _BRISTLE_STEPS * h * math.sqrt(c.bristle_stiffness / c.p1))
    if not needed <= MOST_STEPS:
        return 0
    return math.ceil(needed) if needed > 1.0 else 1


@inlined
def linearise(state, rate, shape, sign, c, ripples, carries, stages, i):
    """Write the derivatives of the rates at stage ``i``, given (sin x, cos x, excess, motor).

    These are the Stribeck excess and the motor torque. Derivatives by the cogging are skipped
    without ``ripples``, those of torque-dependent friction without ``carries``.
    """
    x, v, _, z = state
    sine, cosine, excess, motor = shape
    push, speed, width = 1.0 / c.p1, abs(v), 1.0 / c.stribeck_velocity
    share = v * width
    rub = -sign * push
    at_rest, drive, lift = c.stribeck, push, push  # by the torques of motor and load
    if carries:
        load = pull(x, c)
        at_rest = stribeck_level(sign, motor, load, c)
        by_motor, by_load, rest_by_motor, rest_by_load = slopes(sign, motor, load, c)
        drive += rub * (by_motor + excess * rest_by_motor)
        lift += rub * (by_load + excess * rest_by_load)
        by_motor, by_load = slope(c.motor_friction, c.load_friction, motor, load)
        stages[i, V, BASIS + MOTOR_FRICTION] = rub * by_motor
        stages[i, V, BASIS + LOAD_FRICTION] = rub * by_load
        by_motor, by_load = slope(c.motor_stribeck, c.load_stribeck, motor, load)
        stages[i, V, BASIS + MOTOR_STRIBECK] = rub * excess * by_motor
        stages[i, V, BASIS + LOAD_STRIBECK] = rub * excess * by_load
        square = rub * excess * passed_on(motor, load) ** 2
        stages[i, V, BASIS + LIFTING_STRIBECK] = square if sign * load < 0.0 else 0.0
        stages[i, V, BASIS + LOWERING_STRIBECK] = square if sign * load >= 0.0 else 0.0
    narrowing = 2.0 * at_rest * excess * share * width  # -dg/dv
    stages[i, V, GAIN] = drive
    stages[i, V, X] = lift * (c.p3_offset * sine - c.p3 * cosine - c.spring)
    braked = push * (c.viscous + 2.0 * c.drag * speed) + drive * c.back_emf
    stages[i, V, V] = -braked - rub * narrowing
    stages[i, V, BASIS + P1] = -push * rate[0]
    stages[i, V, BASIS + VISCOUS] = -push * v
    stages[i, V, BASIS + BACK_EMF] = -drive * v
    stages[i, V, BASIS + P3], stages[i, V, BASIS + P3_OFFSET] = -lift * sine, -lift * cosine
    slides = rub if c.coulomb_slope == 0.0 or coulomb_at(x, c) > 0.0 else 0.0
    stages[i, V, X] += slides * c.coulomb_slope
    stages[i, V, BASIS + COULOMB], stages[i, V, BASIS + COULOMB_SLOPE] = slides, slides * x
    stages[i, V, BASIS + STRIBECK] = rub * excess
    stages[i, V, BASIS + STRIBECK_VELOCITY] = rub * narrowing * share
    stages[i, V, BASIS + DRAG] = -push * speed * v
    stages[i, V, BASIS + BIAS] = lift
    stages[i, V, BASIS + SPRING] = -lift * x
    if ripples:
        wave, other = math.sin(c.cogging_periods * x), math.cos(c.cogging_periods * x)
        ripple = lift * (c.cogging * other - c.cogging_cosine * wave)
        stages[i, V, X] += c.cogging_periods * ripple
        stages[i, V, BASIS + COGGING] = lift * wave
        stages[i, V, BASIS + COGGING_COSINE] = lift * other
        stages[i, V, BASIS + PERIODS] = x * ripple
    if c.lag > 0.0:
        _linearise_lag(v, rate[1], drive, c, stages, i)
    if c.bristle_stiffness > 0.0:
        _linearise_bristles(v, z, rate[2], excess, push, c, stages, i)


@inner
def _linearise_lag(v, motor_rate, drive, c, stages, i):
    """Drive the joint by the motor torque, a state, instead of the input."""
    stages[i, V, V] += drive * c.back_emf
    stages[i, V, M], stages[i, V, GAIN] = drive, 0.0
    stages[i, M, GAIN] = 1.0 / c.lag
    stages[i, V, BASIS + BACK_EMF] = 0.0
    stages[i, M, V], stages[i, M, M] = -c.back_emf / c.lag, -1.0 / c.lag
    stages[i, M, BASIS + BACK_EMF] = -v / c.lag
    stages[i, M, BASIS + LAG] = -motor_rate / c.lag


@inner
def _linearise_bristles(v, z, bend_rate, excess, push, c, stages, i):
    """Brake by bristles instead of rigid friction, whose sign here is 0."""
    level = friction_level(0.0, v, 0.0, 0.0, 0.0, c)
    share = v / c.stribeck_velocity
    narrowing = 2.0 * c.stribeck * excess * share / c.stribeck_velocity
    slip = c.bristle_stiffness * abs(v) / level
    weaker = slip * z / level
    bend_by_v = 1.0 - np.sign(v) * c.bristle_stiffness * z / level - weaker * narrowing
    stages[i, Z, V], stages[i, Z, Z] = bend_by_v, -slip
    stages[i, Z, BASIS + COULOMB] = weaker
    stages[i, Z, BASIS + STRIBECK] = weaker * excess
    stages[i, Z, BASIS + STRIBECK_VELOCITY] = weaker * narrowing * share
    stages[i, Z, BASIS + STIFFNESS] = -abs(v) * z / level
    stages[i, V, V] -= push * c.bristle_damping * bend_by_v
    stages[i, V, Z] = push * (c.bristle_damping * slip - c.bristle_stiffness)
    for k in (COULOMB, STRIBECK, STRIBECK_VELOCITY, STIFFNESS):
        stages[i, V, BASIS + k] = -push * c.bristle_damping * stages[i, Z, BASIS + k]
    stages[i, V, BASIS + STIFFNESS] -= push * z
    stages[i, V, BASIS + DAMPING] = -push * bend_rate


_STEPS = 4  # least number of steps in the time in which the base swings by a radian


@inner
def least_base_steps(c, h):
    """Return the steps needed in h s for the base; 0 for impossible masses or `MOST_STEPS`."""
    least = c.swing - c.give * (c.moment**2 + c.moment_offset**2) / c.p1  # as the joint lets it
    if not least > 0.0:
        return 0
    fastest = max(1.0 / math.sqrt(least), c.slow / least)
    needed = _STEPS * h * fastest
    return max(1, math.ceil(needed)) if needed <= MOST_STEPS else 0


@inner
def moving_rates(state, drive, sign, c):
    """Return the rates of velocity, spring force and its rate, while the joint slides."""
    x, v, force, change = state
    still, _, _ = rates((x, v, 0.0, 0.0), drive, sign, c)
    torque, (moment, lever) = c.p1 * still, moments(x, c)
    push = moment * v * v - c.slow * change - force
    common = c.p1 * c.swing - c.give * lever * lever
    speeding = (c.swing * torque - c.give * lever * push) / common
    return speeding, change, (c.p1 * push - lever * torque) / common


@pasted
def moments(x, c):
    """Return h = -h'' and h' in kg m at an angle."""
    sine, cosine = math.sin(x), math.cos(x)
    return c.moment * sine + c.moment_offset * cosine, c.moment * cosine - c.moment_offset * sine


@inner
def stuck_rates(state, c):
    """Return the rates of `moving_rates` while friction holds the joint."""
    _, _, force, change = state
    return 0.0, change, -(c.slow * change + force) / c.swing


@inner
def held(state, drive, c):
    """Torque in N m that static friction must hold."""
    _, lever = moments(state[X], c)
    _, _, bend = stuck_rates(state, c)
    return drive + pull(state[X], c) - c.give * lever * bend


@inner
def linearise_moving(state, rate, shape, sign, c, carries, stages, i):
    """Write the derivatives of the rates at stage ``i``; see `equation.linearise`."""
    x, v, force, change = state
    sine, cosine = shape[0], shape[1]
    moment, lever = moments(x, c)
    torque = c.p1 * rate[0] + c.give * lever * rate[2]
    push = moment * v * v - c.slow * change - force
    common = c.p1 * c.swing - c.give * lever * lever
    still = (torque / c.p1, 0.0, 0.0)
    linearise((x, v, 0.0, 0.0), still, shape, sign, c, True, carries, stages, i)
    for n in (M, Z):
        stages[i, V, n] = 0.0
    for n in (GIVE, SWING, SLOW, MOMENT, MOMENT_OFFSET, P1):
        stages[i, V, BASIS + n] = 0.0
    for n in range(BASIS + DRIVES):
        by_torque = c.p1 * stages[i, V, n] / common
        stages[i, V, n], stages[i, Z, n] = c.swing * by_torque, -lever * by_torque
    gain = c.p1 * stages[i, V, GAIN] / common
    stages[i, V, GAIN], stages[i, Z, GAIN] = c.swing * gain, -lever * gain
    stages[i, M, Z] = 1.0
    turned = -c.give * lever / common  # of thdd by what pushes the base,
    pushed = c.p1 / common  # and of sdd
    by_angle, by_speed = lever * v * v, 2.0 * moment * v
    for n, by_push, by_lever in (
        (X, by_angle, -moment),
        (V, by_speed, 0.0),
        (M, -1.0, 0.0),
        (Z, -c.slow, 0.0),
        (BASIS + SLOW, -change, 0.0),
        (BASIS + MOMENT, sine * v * v, cosine),
        (BASIS + MOMENT_OFFSET, cosine * v * v, -sine),
    ):
        wider = 2.0 * c.give * lever * by_lever / common  # what that takes from `common`
        stages[i, V, n] += turned * by_push - c.give * by_lever * push / common + rate[0] * wider
        stages[i, Z, n] += pushed * by_push - by_lever * torque / common + rate[2] * wider
    stages[i, V, BASIS + P1] = -rate[0] * c.swing / common
    stages[i, Z, BASIS + P1] = (push - rate[2] * c.swing) / common
    stages[i, V, BASIS + SWING] = (torque - rate[0] * c.p1) / common
    stages[i, Z, BASIS + SWING] = -rate[2] * c.p1 / common
    stages[i, V, BASIS + GIVE] = (rate[0] * lever - push) * lever / common
    stages[i, Z, BASIS + GIVE] = rate[2] * lever * lever / common


@inner
def linearise_stuck(state, rate, c, stages, i):
    """Write the derivatives of the rates at stage ``i`` while friction holds the joint."""
    for n in range(WEIGHT):
        stages[i, V, n] = stages[i, Z, n] = 0.0
    stages[i, V, GAIN] = stages[i, Z, GAIN] = 0.0
    stages[i, M, Z] = 1.0
    stages[i, Z, M], stages[i, Z, Z] = -1.0 / c.swing, -c.slow / c.swing
    stages[i, Z, BASIS + SWING] = -rate[2] / c.swing
    stages[i, Z, BASIS + SLOW] = -state[Z] / c.swing
