"""Simulate a joint: its states at instants, from its input or its servo loop."""

from __future__ import annotations

from butterfly.compiled import compiled, inlined, pasted
from butterfly.model.kernel.equation import MOST_STEPS, V, X, least_steps
from butterfly.model.kernel.moving_base import least_base_steps
from butterfly.model.kernel.moving_steps import advance_moving
from butterfly.model.kernel.servo_loop import at, torque
from butterfly.model.kernel.steps import LOST, advance, part_of


@compiled
def integrate(time, drives, state, c, moving, most, angle, velocity):
    """Write (n,) angles and velocities, with (n - 1, 3) torques of the drive in N m.

    ``moving`` is None for a fixed base. An interval that needs more than ``most`` steps diverges.
    Returns the number of steps taken.
    """
    angle[0], velocity[0] = state[X], state[V]
    steps = 0
    for k in range(time.size - 1):
        row, h = (drives[k, 0], drives[k, 1], drives[k, 2]), time[k + 1] - time[k]
        count = count_steps(state, h, c, moving, most)
        state = after_steps(state, row, h, count, c, moving)
        angle[k + 1], velocity[k + 1] = state[X], state[V]
        steps += max(count, 1)
    return steps


@compiled
def integrate_loop(
    time, state, c, without_drive, loop, memory, moving, most, angle, velocity,
):  # fmt: skip
    """Integrate a joint in its servo loop, whose ``memory`` is empty; see `integrate`."""
    angle[0], velocity[0] = state[X], state[V]
    held, steps = 0.0, 0
    for k in range(time.size - 1):
        held, h = torque(k, state, loop, memory, held, None), time[k + 1] - time[k]
        now = at(k, loop, c, without_drive)
        count = count_steps(state, h, now, moving, most)
        state = after_steps(state, (held, held, held), h, count, now, moving)
        angle[k + 1], velocity[k + 1] = state[X], state[V]
        steps += max(count, 1)
    return steps


@pasted
def count_steps(state, h, c, moving, most):
    """Return the number of steps of an interval; 0 for a joint that needs more than ``most``."""
    count = least_steps(c, state[V], h)
    if moving is not None:
        of_base = least_base_steps(c, h)
        count = max(count, of_base) if count * of_base > 0 else 0
    return count if count <= most else 0


@compiled
def steps_at(velocity, h, c, moving):
    """Return the number of steps of an interval of h s at a velocity in rad/s; 0 for too many."""
    return count_steps((0.0, velocity, 0.0, 0.0), h, c, moving, MOST_STEPS)


@inlined
def step(state, drives, h, c, tape, splits, moving):
    """Return the state at the end of one step."""
    if moving is None:
        return advance(state, drives, h, c, tape, splits)
    return advance_moving(state, drives, h, c, tape, splits)


@pasted
def interval(state, drives, h, c, moving):
    """Return the state at the end of one interval, after the necessary steps: a twin's."""
    return after_steps(state, drives, h, count_steps(state, h, c, moving, MOST_STEPS), c, moving)


@pasted
def after_steps(state, drives, h, count, c, moving):
    """Return the state at the end of one interval, after ``count`` steps; lost without any."""
    for k in range(count):
        own = drives if count == 1 else part_of(drives, k, count)
        state = step(state, own, h / count, c, None, False, moving)
    return state if count else LOST
