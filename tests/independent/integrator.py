"""A joint that shares no code with the program: RK4 between events, stick and slip found exactly.

    inertia thdd + (viscous + drag |thd|) thd + gravity sin th + gravity_beside cos th + friction
        = gain u(t - delay) + bias

Friction is coulomb + excess exp(-(thd/excess_velocity)^2) against the motion; at rest it holds up
to coulomb + excess. The input is held from stamp to stamp, 0 before the first. A step ends where a
stamp, a change of the input or a zero of the velocity is: the torque is constant within it, so that
a joint at rest slips at the beginning of a step or not at all. The input is given, or a law makes
it at every stamp of what an encoder reads there.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

STEP = 0.25e-3
"""Longest step in s."""

_HALVINGS = 60  # of a step, to find where the velocity vanishes


class Joint(NamedTuple):
    """In SI units; what the equation above names."""

    inertia: float
    viscous: float
    gravity: float
    gain: float
    coulomb: float = 0.0
    drag: float = 0.0
    bias: float = 0.0
    gravity_beside: float = 0.0
    excess: float = 0.0
    excess_velocity: float = 1.0
    delay: float = 0.0


class Law(NamedTuple):
    """What makes the input of an encoder's readings: kp e + kd (rate wanted - slope) +- pump.

    The readings are multiples of ``count`` rad; their slope is filtered, each new one of weight
    ``share``. The input stays within ``limit``; gains are per unit of input.
    """

    stiffness: float
    damping: float
    limit: float
    count: float
    share: float = 1.0


def motion(joint, stamps, inputs, angle=0.0, velocity=0.0, *, step=STEP):
    """Return (n,) angles in rad and velocities in rad/s at (n,) stamps in s, for (n,) inputs."""
    return _motion(joint, np.asarray(stamps), np.asarray(inputs), (angle, velocity), step)


def tracking(joint, law, plan, angle=0.0, velocity=0.0, *, step=STEP):
    """Return (n,) angles, velocities, inputs and readings of a joint under a law.

    ``plan`` is (n,) stamps in s, angles in rad and rates in rad/s that are wanted, pumps in units
    of input that act along the readings' slope, and what the encoder adds to the angle in rad.
    """
    columns = tuple(np.asarray(column, dtype=np.float64) for column in plan)
    return _tracking(joint, law, columns, (angle, velocity), step)


@numba.njit(cache=True)
def _motion(joint, stamps, inputs, start, step):
    state, latest = start, -1
    angles, velocities = np.empty(stamps.size), np.empty(stamps.size)
    angles[0], velocities[0] = state
    for k in range(stamps.size - 1):
        state, latest = _to_next_stamp(joint, (stamps, inputs, k), (state, latest), step)
        angles[k + 1], velocities[k + 1] = state
    return angles, velocities


@numba.njit(cache=True)
def _to_next_stamp(joint, driven, now_and_latest, step):
    """Return the state at stamp k + 1, and the number of the input that acts there."""
    (stamps, inputs, k), (state, latest) = driven, now_and_latest
    now, end = stamps[k], stamps[k + 1]
    while now < end:
        while latest + 1 < stamps.size and stamps[latest + 1] + joint.delay <= now:
            latest += 1
        stop = end
        if latest + 1 < stamps.size:
            stop = min(end, stamps[latest + 1] + joint.delay)
        torque = joint.bias + (joint.gain * inputs[latest] if latest >= 0 else 0.0)
        count = math.ceil((stop - now) / step)
        for _ in range(count):
            state = _advance(joint, state, torque, (stop - now) / count)
        now = stop
    return state, latest


@numba.njit(cache=True)
def _tracking(joint, law, plan, start, step):
    stamps, wanted, rates, pumps, offsets = plan
    state, latest, slope = start, -1, 0.0
    angles, velocities = np.empty(stamps.size), np.empty(stamps.size)
    inputs, readings = np.empty(stamps.size), np.empty(stamps.size)
    for k in range(stamps.size):
        angles[k], velocities[k] = state
        readings[k] = law.count * np.rint((state[0] + offsets[k]) / law.count)
        if k > 0:
            raw = (readings[k] - readings[k - 1]) / (stamps[k] - stamps[k - 1])
            slope += law.share * (raw - slope)
        command = law.stiffness * (wanted[k] - readings[k]) + law.damping * (rates[k] - slope)
        command += pumps[k] * (1.0 if slope >= 0.0 else -1.0)
        inputs[k] = min(max(command, -law.limit), law.limit)
        if k + 1 < stamps.size:
            state, latest = _to_next_stamp(joint, (stamps, inputs, k), (state, latest), step)
    return angles, velocities, inputs, readings


@numba.njit(cache=True)
def _advance(joint, state, torque, h):
    """Return angle and velocity h s later, under a constant torque."""
    x, v = state
    while True:
        direction = np.sign(v)
        if v == 0.0:
            free = torque + _gravity(joint, x)
            if abs(free) <= joint.coulomb + joint.excess:
                return x, 0.0
            direction = np.sign(free)
        there, speed = _runge_kutta(joint, (x, v), (direction, torque), h)
        if speed * direction >= 0.0:
            return there, speed
        if v == 0.0:
            return x, 0.0  # it would have turned back before it moved
        early, late = 0.0, h
        for _ in range(_HALVINGS):
            middle = 0.5 * (early + late)
            _, speed = _runge_kutta(joint, (x, v), (direction, torque), middle)
            if speed * direction > 0.0:
                early = middle
            else:
                late = middle
        x, _ = _runge_kutta(joint, (x, v), (direction, torque), late)
        v = 0.0
        h -= late
        if h <= 0.0:
            return x, v


@numba.njit(cache=True)
def _runge_kutta(joint, state, load, h):
    (x, v), (direction, torque) = state, load
    a1 = _acceleration(joint, x, v, direction, torque)
    v2 = v + 0.5 * h * a1
    a2 = _acceleration(joint, x + 0.5 * h * v, v2, direction, torque)
    v3 = v + 0.5 * h * a2
    a3 = _acceleration(joint, x + 0.5 * h * v2, v3, direction, torque)
    v4 = v + h * a3
    a4 = _acceleration(joint, x + h * v3, v4, direction, torque)
    return (
        x + h * (v + 2.0 * v2 + 2.0 * v3 + v4) / 6.0,
        v + h * (a1 + 2.0 * a2 + 2.0 * a3 + a4) / 6.0,
    )


@numba.njit(cache=True)
def _acceleration(joint, x, v, direction, torque):
    friction = joint.coulomb
    if joint.excess > 0.0:
        friction += joint.excess * math.exp(-((v / joint.excess_velocity) ** 2))
    braking = (joint.viscous + joint.drag * abs(v)) * v + direction * friction
    return (torque + _gravity(joint, x) - braking) / joint.inertia


@numba.njit(cache=True)
def _gravity(joint, x):
    torque = -joint.gravity * math.sin(x)
    if joint.gravity_beside != 0.0:
        torque -= joint.gravity_beside * math.cos(x)
    return torque
