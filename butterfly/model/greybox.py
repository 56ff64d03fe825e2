"""Integrate the grey-box equation with set-valued Coulomb friction by compiled RK4."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numba
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from butterfly.model.parameters import LumpedParameters

State = tuple[float, float, float, float]
"""Angle in rad, velocity in rad/s, torque of the motor in N m (a state only with a lag), and
deflection of the bristles in rad (a state only with a stiffness of theirs)."""

_LAG_STEPS = 16  # least number of steps in one time constant of the armature
_BRISTLE_STEPS = 4  # the same in one time constant of the bristles
_VANISHED = 6.0  # Stribeck velocities, at which exp(-36) is lost in rounding
_MAX_REVERSALS = 8  # reversals of the velocity that one step may hold before it is cut short
_REFINEMENTS = 3  # secant corrections of the instant at which the velocity vanishes


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
        """Take them from the parameters of the hand with its added mass.

        An estimator may try friction that is negative under a load; it counts as none, since it
        would feed the motion. Bristles that no Coulomb friction bends are left out.
        """
        coulomb = max(p.coulomb, 0.0)
        own = {
            "viscous": p.p2 - p.back_emf,
            "lag": p.time_constant,
            "coulomb": coulomb,
            "stribeck": max(p.stribeck, -coulomb),
            "bristle_stiffness": p.bristle_stiffness if coulomb > 0 else 0.0,
        }
        return cls(*(float(own.get(name, getattr(p, name, 0.0))) for name in cls._fields))


def simulate(
    parameters: LumpedParameters,
    time: NDArray[np.float64],
    inputs: NDArray[np.float64],
    angle: float,
    velocity: float = 0.0,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Integrate the equation of `LumpedParameters` over ``time``, one RK4 step per interval.

    A step in which the velocity changes sign is split where it vanishes; the joint then sticks
    while the other torques stay within what friction holds, and slips on from the instant at which
    they do not, so no regularisation parameter enters. Fourth-order accurate between reversals.
    Each interval is divided into steps short enough for the armature's lag and for the bristles;
    current and bristles start at 0.

    Parameters
    ----------
    parameters
        Of the hand with its added mass; ``delay`` is not applied here (see ``inputs``).
    time
        (n,) strictly increasing instants in s.
    inputs
        (n - 1, 3) input at the start, middle and end of each interval, already delayed.
    angle, velocity
        Initial state in rad and rad/s.

    Returns
    -------
    angle, velocity
        (n,) each, in rad and rad/s.
    """
    start = (angle, velocity, 0.0, 0.0)
    return _integrate(time, parameters.p4 * inputs, start, Constants.of(parameters))


def step(constants: Constants, state: State, torque: float, duration: float) -> State:
    """Return the state after ``duration`` s as `simulate` finds it, p4 times the input held."""
    return interval(state, (torque, torque, torque), duration, constants)


@numba.njit(cache=True, nogil=True)
def _pull(x: float, c: Constants) -> float:
    """Torque in N m that depends on the angle alone: gravity, cogging and bias."""
    torque = c.bias - c.p3 * math.sin(x)
    if c.p3_offset != 0.0:
        torque -= c.p3_offset * math.cos(x)
    if c.cogging != 0.0 or c.cogging_cosine != 0.0:
        turned = c.cogging_periods * x
        torque += c.cogging * math.sin(turned) + c.cogging_cosine * math.cos(turned)
    return torque


@numba.njit(cache=True, nogil=True)
def _friction_level(v: float, c: Constants) -> float:
    """Coulomb and Stribeck friction g(v) in N m, without its sign."""
    if c.stribeck == 0.0 or abs(v) > _VANISHED * c.stribeck_velocity:
        return c.coulomb
    return c.coulomb + c.stribeck * math.exp(-((v / c.stribeck_velocity) ** 2))


@numba.njit(cache=True, nogil=True)
def rates(state: State, drive: float, sign: float, c: Constants) -> tuple[float, float, float]:
    """Return the rates of velocity, motor torque and bristles, sliding in the direction sign."""
    x, v, motor, bend = state
    torque = drive - c.back_emf * v
    motor_rate = 0.0
    if c.lag > 0.0:
        motor_rate = (torque - motor) / c.lag
        torque = motor
    bend_rate = 0.0
    level = _friction_level(v, c)
    if c.bristle_stiffness > 0.0:
        bend_rate = v - c.bristle_stiffness * abs(v) * bend / level
        torque -= c.bristle_stiffness * bend + c.bristle_damping * bend_rate
    else:
        torque -= sign * level
    torque += _pull(x, c) - (c.viscous + c.drag * abs(v)) * v
    return torque / c.p1, motor_rate, bend_rate


@numba.njit(cache=True, nogil=True)
def least_steps(c, v, h):
    """Count the steps that lag and bristles ask for in h s at a velocity of v rad/s."""
    count = 1
    if c.lag > 0.0:
        count = max(count, math.ceil(_LAG_STEPS * h / c.lag))
    if c.bristle_stiffness > 0.0:
        damping = (c.viscous + c.bristle_damping) / c.p1
        fastest = max(
            c.bristle_stiffness * abs(v) / _friction_level(v, c),
            damping,
            math.sqrt(c.bristle_stiffness / c.p1),
        )
        count = max(count, math.ceil(_BRISTLE_STEPS * h * fastest))
    return count


@numba.njit(cache=True, nogil=True)
def _drive_at(drives, fraction):
    """Evaluate the quadratic through the drives at fractions 0, 1/2 and 1 of the interval."""
    start, middle, end = drives
    bend = 2.0 * (start - 2.0 * middle + end)
    return start + fraction * (end - start - bend + bend * fraction)


@numba.njit(cache=True, nogil=True)
def _rk4(state, drives, begin, share, h, sign, c):
    """Take one RK4 step over ``share`` of the interval h, sliding in the direction ``sign``."""
    x, v, m, z = state
    dt = share * h
    half = 0.5 * dt
    d0 = _drive_at(drives, begin)
    d1 = _drive_at(drives, begin + 0.5 * share)
    d2 = _drive_at(drives, begin + share)
    a1, m1, z1 = rates(state, d0, sign, c)
    v2 = v + half * a1
    a2, m2, z2 = rates((x + half * v, v2, m + half * m1, z + half * z1), d1, sign, c)
    v3 = v + half * a2
    a3, m3, z3 = rates((x + half * v2, v3, m + half * m2, z + half * z2), d1, sign, c)
    v4 = v + dt * a3
    a4, m4, z4 = rates((x + dt * v3, v4, m + dt * m3, z + dt * z3), d2, sign, c)
    sixth = dt / 6.0
    return (
        x + sixth * (v + 2.0 * v2 + 2.0 * v3 + v4),
        v + sixth * (a1 + 2.0 * a2 + 2.0 * a3 + a4),
        m + sixth * (m1 + 2.0 * m2 + 2.0 * m3 + m4),
        z + sixth * (z1 + 2.0 * z2 + 2.0 * z3 + z4),
    )


@numba.njit(cache=True, nogil=True)
def _rest(state, drives, begin, h, c):
    """Return the state at the interval's end when the joint sticks from fraction ``begin`` on."""
    x, _, m, z = state
    if c.lag > 0.0:
        target = _drive_at(drives, 0.5 * (1.0 + begin))
        m = target + (m - target) * math.exp(-(1.0 - begin) * h / c.lag)
    return x, 0.0, m, z


@numba.njit(cache=True, nogil=True)
def _advance(state, drives, h, c):
    """Return the state at the end of one interval, split at each reversal of the velocity."""
    holding = c.coulomb + c.stribeck
    if c.bristle_stiffness > 0.0 or holding == 0.0:
        return _rk4(state, drives, 0.0, 1.0, h, 0.0, c)
    begin = 0.0
    for _ in range(_MAX_REVERSALS):
        x, v, m, z = state
        sign = np.sign(v)
        if v == 0.0:
            load = _pull(x, c)
            net = (m if c.lag > 0.0 else _drive_at(drives, begin)) + load
            if abs(net) <= holding:
                rest = _rest(state, drives, begin, h, c)
                final = (rest[2] if c.lag > 0.0 else _drive_at(drives, 1.0)) + load
                if abs(final) <= holding:
                    return rest
                loose = (holding * np.sign(final) - net) / (final - net)
                begin += loose * (1.0 - begin)
                state = (x, v, m + loose * (rest[2] - m), z)
                net = final
            sign = np.sign(net)
        share = 1.0 - begin
        after = _rk4(state, drives, begin, share, h, sign, c)
        if after[1] * sign >= 0.0:
            return after
        if v == 0.0:
            break  # pushed back at once: friction holds the joint
        upper = share
        share *= v / (v - after[1])
        for _ in range(_REFINEMENTS):
            after = _rk4(state, drives, begin, share, h, sign, c)
            share = min(share * v / (v - after[1]), upper)
        state = (after[0], 0.0, after[2], after[3])
        begin += share
    return _rest(state, drives, begin, h, c)


@numba.njit(cache=True, nogil=True)
def interval(state, drives, h, c):
    """Return the state at the end of one interval, in steps that lag and bristles allow."""
    count = least_steps(c, state[1], h)
    if count == 1:
        return _advance(state, drives, h, c)
    for k in range(count):
        part = (
            _drive_at(drives, k / count),
            _drive_at(drives, (k + 0.5) / count),
            _drive_at(drives, (k + 1) / count),
        )
        state = _advance(state, part, h / count, c)
    return state


@numba.njit(cache=True, nogil=True)
def _integrate(time, drives, state, c):
    n = time.size
    angle = np.empty(n)
    velocity = np.empty(n)
    angle[0], velocity[0] = state[0], state[1]
    for k in range(n - 1):
        row = (drives[k, 0], drives[k, 1], drives[k, 2])
        state = interval(state, row, time[k + 1] - time[k], c)
        angle[k + 1], velocity[k + 1] = state[0], state[1]
    return angle, velocity
