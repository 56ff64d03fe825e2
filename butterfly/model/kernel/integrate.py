"""Simulate a joint: its states at instants, and what a base adds that only begins to give."""

from __future__ import annotations

from butterfly.compiled import compiled, inlined, inner, pasted
from butterfly.model.kernel.equation import MOST_STEPS, V, X, least_steps
from butterfly.model.kernel.moving_base import least_base_steps, moments
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
        part_drives = drives if count == 1 else part_of(drives, k, count)
        state = step(state, part_drives, h / count, c, None, False, moving)
    return state if count else LOST


@compiled
def begin_to_give(time, angle, velocity, c, torques):
    """Write (n - 1, 3) derivatives of the torque by a base's compliance ``give`` at 0, on a motion.

    With the momentum h' thd of the motion on (n,) instants, and rests = swing sd + slow s + h' thd,

        sd = (rests - slow s - h' thd) / swing,  d rests/dt = -s;

    the torque is -h' sdd, sdd its mean over an interval. Returns the number of steps taken.
    """
    force, rests, rate, steps = 0.0, moments(angle[0], c)[1] * velocity[0], 0.0, 0
    for k in range(time.size - 1):
        h, ends = time[k + 1] - time[k], (angle[k], velocity[k], angle[k + 1], velocity[k + 1])
        count = max(least_base_steps(c, h), 1)
        dt, begun = h / count, rate
        steps += count
        for part in range(count):
            first = _between(part / count, h, ends, c)[1]
            second = _between((part + 0.5) / count, h, ends, c)[1]
            third = _between((part + 1.0) / count, h, ends, c)[1]
            a1, b1 = (rests - c.slow * force - first) / c.swing, -force
            s, r = force + 0.5 * dt * a1, rests + 0.5 * dt * b1
            a2, b2 = (r - c.slow * s - second) / c.swing, -s
            s, r = force + 0.5 * dt * a2, rests + 0.5 * dt * b2
            a3, b3 = (r - c.slow * s - second) / c.swing, -s
            s, r = force + dt * a3, rests + dt * b3
            a4, b4 = (r - c.slow * s - third) / c.swing, -s
            force += dt / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
            rests += dt / 6.0 * (b1 + 2.0 * b2 + 2.0 * b3 + b4)
        rate = (rests - c.slow * force - _between(1.0, h, ends, c)[1]) / c.swing
        for i in range(3):
            torques[k, i] = -_between(0.5 * i, h, ends, c)[0] * (rate - begun) / h
    return steps


@inner
def _between(share, h, ends, c):
    """Return h' and h' thd at a share of an interval, by the cubic through both its ends."""
    (x, v, y, w), rest = ends, 1.0 - share
    at = (
        x
        + share * share * (3.0 - 2.0 * share) * (y - x)
        + h * share * rest * (rest * v - share * w)
    )
    _, lever = moments(at, c)
    speed = 6.0 * share * rest * (y - x) / h
    speed += rest * (1.0 - 3.0 * share) * v + share * (3.0 * share - 2.0) * w
    return lever, lever * speed
