"""A joint that shares no code with the program: RK4 between events, stick and slip found exactly.

    inertia thdd + (viscous + drag |thd|) thd + gravity sin th + gravity_beside cos th + friction
        + spring (th - spring_rest) + imbalance cos th xdd = motor
    base xdd + base_viscous xd + base_spring x + imbalance (cos th thdd - sin th thd^2) = 0

The motor gives gain u(t - delay) + bias - back_emf thd. Friction is coulomb + excess
exp(-(thd/excess_velocity)^2) + |motor_friction motor + load_friction gravity sin th|, times
1 + uneven sin th, against the motion; at rest it holds up to that. All that damps the joint changes
by a share ``wear`` a second. The base is one that moves sideways by x where it has a mass, at rest
in the beginning; ``imbalance`` is the joint's first moment in kg m. The input is held from stamp to
stamp, 0 before the first. A step ends where a stamp, a change of the input or a zero of the
velocity is: the torque is constant within it, so that a joint at rest slips at the beginning of a
step or not at all. The input is given, or a law makes it at every stamp of what an encoder reads
there.
"""

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
    wear: float = 0.0
    spring: float = 0.0
    spring_rest: float = 0.0
    base: float = 0.0
    base_viscous: float = 0.0
    base_spring: float = 0.0
    imbalance: float = 0.0
    back_emf: float = 0.0
    motor_friction: float = 0.0
    load_friction: float = 0.0
    uneven: float = 0.0


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


def motion(joint, stamps, inputs, angle=0.0, velocity=0.0, *, late=0.0, step=STEP):
    """Return (n,) angles in rad and velocities in rad/s at (n,) stamps in s, for (n,) inputs.

    An input is ``late`` by so many s beside the delay, none before the one that was sent first.
    """
    start, stamps = (angle, velocity, 0.0, 0.0), np.asarray(stamps)
    arrivals = np.maximum.accumulate(stamps + joint.delay + late)
    return _motion(_floats(joint), (stamps, np.asarray(inputs), arrivals), start, step)


def tracking(joint, law, plan, angle=0.0, velocity=0.0, *, step=STEP):
    """Return (n,) angles, velocities, inputs and readings of a joint under a law.

    ``plan`` is (n,) stamps in s, angles in rad and rates in rad/s that are wanted, pumps in units
    of input that act along the readings' slope, and what the encoder adds to the angle in rad.
    """
    columns = tuple(np.asarray(column, dtype=np.float64) for column in plan)
    return _tracking(_floats(joint), law, columns, (angle, velocity, 0.0, 0.0), step)


def _floats(joint):
    """Return a joint of floats alone, so that all are of one compilation."""
    return Joint(*map(float, joint))


@numba.njit(cache=True)
def _motion(joint, columns, start, step):
    (stamps, inputs, arrivals), state, latest = columns, start, np.int64(-1)
    angles, velocities = np.empty(stamps.size), np.empty(stamps.size)
    angles[0], velocities[0] = state[:2]
    for k in range(stamps.size - 1):
        driven = stamps, inputs, arrivals, k
        state, latest = _to_next_stamp(joint, driven, (state, latest), step)
        angles[k + 1], velocities[k + 1] = state[:2]
    return angles, velocities


@numba.njit(cache=True)
def _to_next_stamp(joint, driven, now_and_latest, step):
    """Return the state at stamp k + 1, and the number of the input that acts there."""
    (stamps, inputs, arrivals, k), (state, latest) = driven, now_and_latest
    now, end = stamps[k], stamps[k + 1]
    while now < end:
        while latest + 1 < stamps.size and arrivals[latest + 1] <= now:
            latest += 1
        stop = end
        if latest + 1 < stamps.size:
            stop = min(end, arrivals[latest + 1])
        torque = joint.bias + (joint.gain * inputs[latest] if latest >= 0 else 0.0)
        load = torque, 1.0 + joint.wear * (0.5 * (now + stop) - stamps[0])
        count = math.ceil((stop - now) / step)
        for _ in range(count):
            state = advance(joint, state, load, (stop - now) / count)
        now = stop
    return state, latest


@numba.njit(cache=True)
def _tracking(joint, law, plan, start, step):
    stamps, wanted, rates, pumps, offsets = plan
    state, latest, slope = start, -1, 0.0
    arrivals = stamps + joint.delay
    angles, velocities = np.empty(stamps.size), np.empty(stamps.size)
    inputs, readings = np.empty(stamps.size), np.empty(stamps.size)
    for k in range(stamps.size):
        angles[k], velocities[k] = state[:2]
        readings[k] = law.count * np.rint((state[0] + offsets[k]) / law.count)
        if k > 0:
            raw = (readings[k] - readings[k - 1]) / (stamps[k] - stamps[k - 1])
            slope += law.share * (raw - slope)
        command = law.stiffness * (wanted[k] - readings[k]) + law.damping * (rates[k] - slope)
        command += pumps[k] * (1.0 if slope >= 0.0 else -1.0)
        inputs[k] = min(max(command, -law.limit), law.limit)
        if k + 1 < stamps.size:
            driven = stamps, inputs, arrivals, k
            state, latest = _to_next_stamp(joint, driven, (state, latest), step)
    return angles, velocities, inputs, readings


@numba.njit(cache=True)
def advance(joint, state, load, h):
    """Return the state h s later, under a torque and a share of friction that are constant."""
    while h > 0.0:
        direction = np.sign(state[1])
        if direction == 0.0:
            free = _free_torque(joint, state, load)
            if abs(free) > load[1] * _level(joint, state, load[0]):
                direction = np.sign(free)
        later = _runge_kutta(joint, state, (direction, load), h)
        if direction == 0.0 or later[1] * direction >= 0.0:
            return later
        if state[1] == 0.0:  # it would have turned back before it moved
            return _runge_kutta(joint, state, (0.0, load), h)
        early, late = 0.0, h
        for _ in range(_HALVINGS):
            middle = 0.5 * (early + late)
            speed = _runge_kutta(joint, state, (direction, load), middle)[1]
            if speed * direction > 0.0:
                early = middle
            else:
                late = middle
        x, _, b, w = _runge_kutta(joint, state, (direction, load), late)
        state = (x, 0.0, b, w)
        h -= late
    return state


@numba.njit(cache=True)
def _runge_kutta(joint, state, acting, h):
    k1 = _rates(joint, state, acting)
    k2 = _rates(joint, _along(state, k1, 0.5 * h), acting)
    k3 = _rates(joint, _along(state, k2, 0.5 * h), acting)
    k4 = _rates(joint, _along(state, k3, h), acting)
    mean = _along(_along(_along(k1, k2, 2.0), k3, 2.0), k4, 1.0)
    return _along(state, mean, h / 6.0)


@numba.njit(cache=True)
def _along(state, rates, h):
    return (
        state[0] + h * rates[0],
        state[1] + h * rates[1],
        state[2] + h * rates[2],
        state[3] + h * rates[3],
    )


@numba.njit(cache=True)
def _rates(joint, state, acting):
    """Return the derivative of angle, velocity, and the base's place and velocity."""
    (x, v, _, w), (direction, load) = state, acting
    if direction == 0.0:  # friction holds it
        return 0.0, 0.0, w, _base_force(joint, state) / max(joint.base, 1e-300)
    motor = load[0] - joint.back_emf * v
    level = _level(joint, state, motor)
    braking = (joint.viscous + joint.drag * abs(v)) * v + direction * level
    torque = motor + _gravity(joint, x) - load[1] * braking
    if joint.base == 0.0:
        return v, torque / joint.inertia, 0.0, 0.0
    arm, force = joint.imbalance * math.cos(x), _base_force(joint, state)
    whole = joint.inertia * joint.base - arm**2
    return (
        v,
        (joint.base * torque - arm * force) / whole,
        w,
        (joint.inertia * force - arm * torque) / whole,
    )


@numba.njit(cache=True)
def _level(joint, state, motor):
    """Return the friction in N m under a motor's torque."""
    level, by_load = joint.coulomb, joint.load_friction * joint.gravity
    if by_load > 0.0 or joint.motor_friction > 0.0:
        level += abs(joint.motor_friction * motor + by_load * math.sin(state[0]))
    if joint.excess > 0.0:
        level += joint.excess * math.exp(-((state[1] / joint.excess_velocity) ** 2))
    if joint.uneven != 0.0:
        level *= 1.0 + joint.uneven * math.sin(state[0])
    return level


@numba.njit(cache=True)
def _free_torque(joint, state, load):
    """Return what friction has to hold of a joint at rest, on a base that moves."""
    torque = load[0] + _gravity(joint, state[0])
    if joint.base == 0.0:
        return torque
    push = _base_force(joint, state) / joint.base
    return torque - joint.imbalance * math.cos(state[0]) * push


@numba.njit(cache=True)
def _base_force(joint, state):
    x, v, b, w = state
    turning = joint.imbalance * math.sin(x) * v**2
    return turning - joint.base_viscous * w - joint.base_spring * b


@numba.njit(cache=True)
def _gravity(joint, x):
    torque = -joint.gravity * math.sin(x) - joint.spring * (x - joint.spring_rest)
    if joint.gravity_beside != 0.0:
        torque -= joint.gravity_beside * math.cos(x)
    return torque
