"""Simulate a joint: its states at instants, from its input or its servo loop."""

from __future__ import annotations

import numpy as np

from butterfly.compiled import compiled, inlined
from butterfly.model.kernel.equation import V, X, least_steps
from butterfly.model.kernel.moving_base import least_base_steps
from butterfly.model.kernel.moving_steps import advance_moving
from butterfly.model.kernel.servo_loop import MEMORY, at, torque
from butterfly.model.kernel.steps import LOST, advance, part_of


@compiled
def integrate(time, drives, state, c, moving):
    """Return (n,) angles and velocities, with (n - 1, 3) torques of the drive in N m.

    ``moving`` is None for a fixed base.
    """
    n = time.size
    angle, velocity = np.empty(n), np.empty(n)
    angle[0], velocity[0] = state[X], state[V]
    for k in range(n - 1):
        row = (drives[k, 0], drives[k, 1], drives[k, 2])
        state = interval(state, row, time[k + 1] - time[k], c, moving)
        angle[k + 1], velocity[k + 1] = state[X], state[V]
    return angle, velocity


@compiled
def integrate_loop(time, state, c, without_drive, loop, moving):
    """Integrate a joint in its servo loop; see `integrate`."""
    n = time.size
    angle, velocity = np.empty(n), np.empty(n)
    angle[0], velocity[0] = state[X], state[V]
    memory, held = np.zeros(MEMORY), 0.0
    for k in range(n - 1):
        held = torque(k, state, loop, memory, held, None)
        now = at(k, loop, c, without_drive)
        state = interval(state, (held, held, held), time[k + 1] - time[k], now, moving)
        angle[k + 1], velocity[k + 1] = state[X], state[V]
    return angle, velocity


@inlined
def count_steps(state, h, c, moving):
    """Return the number of steps of an interval; 0 for a joint too fast for any."""
    count = least_steps(c, state[V], h)
    if moving is None:
        return count
    of_base = least_base_steps(c, h)
    return max(count, of_base) if count * of_base > 0 else 0


@inlined
def step(state, drives, h, c, tape, splits, moving):
    """Return the state at the end of one step."""
    if moving is None:
        return advance(state, drives, h, c, tape, splits)
    return advance_moving(state, drives, h, c, tape, splits)


@inlined
def interval(state, drives, h, c, moving):
    """Return the state at the end of one interval, after the necessary steps."""
    count = count_steps(state, h, c, moving)
    for k in range(count):
        own = drives if count == 1 else part_of(drives, k, count)
        state = step(state, own, h / count, c, None, False, moving)
    return state if count else LOST
