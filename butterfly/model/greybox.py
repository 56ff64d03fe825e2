"""Integrate the grey-box equation with set-valued Coulomb friction by compiled RK4."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numba
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from butterfly.model.parameters import LumpedParameters

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
    while the other torques stay within +-T_c and slips on otherwise, so no regularisation
    parameter enters. Fourth-order accurate between reversals.

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
    p = parameters
    return _integrate(time, p.p4 * inputs, angle, velocity, p.p1, p.p2, p.p3, p.coulomb)


def step(
    parameters: LumpedParameters, angle: float, velocity: float, held: float, duration: float
) -> tuple[float, float]:
    """Take one step of ``duration`` s with the input held, as `simulate` does in each interval."""
    p = parameters
    torque = p.p4 * held
    torques = (torque, torque, torque)
    return _advance(angle, velocity, torques, duration, p.p1, p.p2, p.p3, p.coulomb)


@numba.njit(cache=True)
def _acceleration(x, v, torque, sign, p1, p2, p3, coulomb):
    return (torque - p2 * v - p3 * np.sin(x) - sign * coulomb) / p1


@numba.njit(cache=True)
def _torque_at(torques, fraction):
    """Evaluate the quadratic through the torques at fractions 0, 1/2 and 1 of the interval."""
    start, middle, end = torques
    bend = 2.0 * (start - 2.0 * middle + end)
    return start + fraction * (end - start - bend + bend * fraction)


@numba.njit(cache=True)
def _rk4(x, v, torques, begin, share, h, sign, p1, p2, p3, coulomb):
    """Take one RK4 step over ``share`` of the interval h, sliding in the direction ``sign``."""
    dt = share * h
    t0 = _torque_at(torques, begin)
    t1 = _torque_at(torques, begin + 0.5 * share)
    t2 = _torque_at(torques, begin + share)
    a1 = _acceleration(x, v, t0, sign, p1, p2, p3, coulomb)
    v2 = v + 0.5 * dt * a1
    a2 = _acceleration(x + 0.5 * dt * v, v2, t1, sign, p1, p2, p3, coulomb)
    v3 = v + 0.5 * dt * a2
    a3 = _acceleration(x + 0.5 * dt * v2, v3, t1, sign, p1, p2, p3, coulomb)
    v4 = v + dt * a3
    a4 = _acceleration(x + dt * v3, v4, t2, sign, p1, p2, p3, coulomb)
    x_new = x + dt / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4)
    v_new = v + dt / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
    return x_new, v_new


@numba.njit(cache=True)
def _advance(x, v, torques, h, p1, p2, p3, coulomb):
    """Return the state at the end of one interval, split at each reversal of the velocity."""
    begin = 0.0
    for _ in range(_MAX_REVERSALS):
        share = 1.0 - begin
        sign = np.sign(v)
        if v == 0.0:
            net = _torque_at(torques, begin) - p3 * np.sin(x)
            if abs(net) <= coulomb:
                return x, 0.0  # stuck until the interval ends
            sign = np.sign(net)
        x_new, v_new = _rk4(x, v, torques, begin, share, h, sign, p1, p2, p3, coulomb)
        if coulomb == 0.0 or v_new * sign >= 0.0:
            return x_new, v_new
        if v == 0.0:
            return x, 0.0  # pushed back at once: friction holds the joint
        upper = share
        share *= v / (v - v_new)
        for _ in range(_REFINEMENTS):
            x_new, v_new = _rk4(x, v, torques, begin, share, h, sign, p1, p2, p3, coulomb)
            share = min(share * v / (v - v_new), upper)
        x, v = x_new, 0.0
        begin += share
    return x, 0.0


@numba.njit(cache=True)
def _integrate(time, torques, x, v, p1, p2, p3, coulomb):
    n = time.size
    angle = np.empty(n)
    velocity = np.empty(n)
    angle[0] = x
    velocity[0] = v
    for k in range(n - 1):
        step = (torques[k, 0], torques[k, 1], torques[k, 2])
        x, v = _advance(x, v, step, time[k + 1] - time[k], p1, p2, p3, coulomb)
        angle[k + 1] = x
        velocity[k + 1] = v
    return angle, velocity
