"""Integrate the grey-box equation with set-valued Coulomb friction by compiled RK4."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numba
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from butterfly.model.parameters import LumpedParameters

State = tuple[float, float, float]
"""Angle in rad, velocity in rad/s, and torque of the motor in N m (a state only with a lag)."""

LAG_STEPS = 16
"""Least number of steps in one time constant of the armature."""

_MAX_REVERSALS = 8  # reversals of the velocity that one step may hold before it is cut short
_REFINEMENTS = 3  # secant corrections of the instant at which the velocity vanishes


def simulate(
    parameters: LumpedParameters,
    time: NDArray[np.float64],
    inputs: NDArray[np.float64],
    angle: float,
    velocity: float = 0.0,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Integrate (5) with Coulomb friction over ``time``, one RK4 step per interval.

    A step in which the velocity changes sign is split where it vanishes; the joint then sticks
    while the other torques stay within +-T_c and slips on from the instant at which they do not,
    so no regularisation parameter enters. Fourth-order accurate between reversals. With an
    armature's time constant, each interval is divided into steps of at most a sixteenth of it, and
    the current starts at 0.

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
    return _integrate(time, parameters.p4 * inputs, (angle, velocity, 0.0), _constants(parameters))


def step(parameters: LumpedParameters, state: State, held: float, duration: float) -> State:
    """Return the state after ``duration`` s with the input held, as `simulate` finds it."""
    torque = parameters.p4 * held
    return _interval(state, (torque, torque, torque), duration, _constants(parameters))


def _constants(p: LumpedParameters) -> tuple[float, float, float, float, float, float]:
    """Return p1, friction alone, back EMF, time constant, p3, T_c."""
    return (p.p1, p.p2 - p.back_emf, p.back_emf, p.time_constant, p.p3, p.coulomb)


@numba.njit(cache=True)
def _rates(x, v, motor, drive, sign, constants):
    """Return acceleration, and rate of the motor's torque, when sliding in the direction sign."""
    p1, friction, back_emf, lag, p3, coulomb = constants
    torque = drive - back_emf * v
    rate = 0.0
    if lag > 0.0:
        rate = (torque - motor) / lag
        torque = motor
    return (torque - friction * v - p3 * np.sin(x) - sign * coulomb) / p1, rate


@numba.njit(cache=True)
def _drive_at(drives, fraction):
    """Evaluate the quadratic through the drives at fractions 0, 1/2 and 1 of the interval."""
    start, middle, end = drives
    bend = 2.0 * (start - 2.0 * middle + end)
    return start + fraction * (end - start - bend + bend * fraction)


@numba.njit(cache=True)
def _rk4(state, drives, begin, share, h, sign, constants):
    """Take one RK4 step over ``share`` of the interval h, sliding in the direction ``sign``."""
    x, v, m = state
    dt = share * h
    d0 = _drive_at(drives, begin)
    d1 = _drive_at(drives, begin + 0.5 * share)
    d2 = _drive_at(drives, begin + share)
    a1, r1 = _rates(x, v, m, d0, sign, constants)
    v2 = v + 0.5 * dt * a1
    a2, r2 = _rates(x + 0.5 * dt * v, v2, m + 0.5 * dt * r1, d1, sign, constants)
    v3 = v + 0.5 * dt * a2
    a3, r3 = _rates(x + 0.5 * dt * v2, v3, m + 0.5 * dt * r2, d1, sign, constants)
    v4 = v + dt * a3
    a4, r4 = _rates(x + dt * v3, v4, m + dt * r3, d2, sign, constants)
    return (
        x + dt / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4),
        v + dt / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4),
        m + dt / 6.0 * (r1 + 2.0 * r2 + 2.0 * r3 + r4),
    )


@numba.njit(cache=True)
def _rest(state, drives, begin, h, constants):
    """Return the state at the interval's end when the joint sticks from fraction ``begin`` on."""
    x, _, m = state
    lag = constants[3]
    if lag > 0.0:
        target = _drive_at(drives, 0.5 * (1.0 + begin))
        m = target + (m - target) * math.exp(-(1.0 - begin) * h / lag)
    return x, 0.0, m


@numba.njit(cache=True)
def _advance(state, drives, h, constants):
    """Return the state at the end of one interval, split at each reversal of the velocity."""
    lag, p3, coulomb = constants[3], constants[4], constants[5]
    begin = 0.0
    for _ in range(_MAX_REVERSALS):
        x, v, m = state
        sign = np.sign(v)
        if v == 0.0 and coulomb > 0.0:
            load = p3 * np.sin(x)
            net = (m if lag > 0.0 else _drive_at(drives, begin)) - load
            if abs(net) <= coulomb:
                rest = _rest(state, drives, begin, h, constants)
                final = (rest[2] if lag > 0.0 else _drive_at(drives, 1.0)) - load
                if abs(final) <= coulomb:
                    return rest
                loose = (coulomb * np.sign(final) - net) / (final - net)
                begin += loose * (1.0 - begin)
                state = (x, v, m + loose * (rest[2] - m))
                net = final
            sign = np.sign(net)
        share = 1.0 - begin
        after = _rk4(state, drives, begin, share, h, sign, constants)
        if coulomb == 0.0 or after[1] * sign >= 0.0:
            return after
        if v == 0.0:
            break  # pushed back at once: friction holds the joint
        upper = share
        share *= v / (v - after[1])
        for _ in range(_REFINEMENTS):
            after = _rk4(state, drives, begin, share, h, sign, constants)
            share = min(share * v / (v - after[1]), upper)
        state = (after[0], 0.0, after[2])
        begin += share
    return _rest(state, drives, begin, h, constants)


@numba.njit(cache=True)
def _interval(state, drives, h, constants):
    """Return the state at the end of one interval, in steps that the armature's lag allows."""
    lag = constants[3]
    count = 1
    if lag > 0.0:
        count = max(1, math.ceil(LAG_STEPS * h / lag))
    for k in range(count):
        part = (
            _drive_at(drives, k / count),
            _drive_at(drives, (k + 0.5) / count),
            _drive_at(drives, (k + 1) / count),
        )
        state = _advance(state, part, h / count, constants)
    return state


@numba.njit(cache=True)
def _integrate(time, drives, state, constants):
    n = time.size
    angle = np.empty(n)
    velocity = np.empty(n)
    angle[0], velocity[0] = state[0], state[1]
    for k in range(n - 1):
        row = (drives[k, 0], drives[k, 1], drives[k, 2])
        state = _interval(state, row, time[k + 1] - time[k], constants)
        angle[k + 1], velocity[k + 1] = state[0], state[1]
    return angle, velocity
