"""A joint on a moving base: a mass on a horizontal spring and damper, pushed by the swinging mass.

With h(th) the horizontal first moment of the swinging mass in kg m, and T the torque on a joint
with a fixed base, Lagrange's equations of a base at x are

    p1 thdd + h' xdd = T,   M xdd + c xd + k x = -(h' thdd + h'' thd^2).

The states are the force k x of the spring and its rate, so a fixed base, 1/k = 0, is no special
case: with ``give`` 1/k, ``swing`` M/k and ``slow`` c/k

    p1 thdd + give h' sdd = T,   swing sdd + slow sd + s = -(h' thdd + h'' thd^2).
"""

from __future__ import annotations

import math

from butterfly.compiled import inner, pasted
from butterfly.model.kernel.equation import (
    BASIS,
    DRIVES,
    GAIN,
    GIVE,
    MOMENT,
    MOMENT_OFFSET,
    MOST_STEPS,
    P1,
    SLOW,
    SWING,
    WEIGHT,
    M,
    V,
    X,
    Z,
    linearise,
    pull,
    rates,
)

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
