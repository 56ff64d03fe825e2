"""Simulate a joint at instants; steps of one on a moving base."""

from __future__ import annotations

import math

import numpy as np

from butterfly.compiled import compiled, inlined, inner, pasted
from butterfly.model.kernel.equation import (
    BASIS,
    BY_BEGIN,
    BY_SHARE,
    DRIVES,
    GAIN,
    MOST_STEPS,
    RATE,
    M,
    V,
    X,
    Z,
    friction_level,
    held,
    least_base_steps,
    least_steps,
    linearise_moving,
    moments,
)
from butterfly.model.kernel.servo_loop import at, torque
from butterfly.model.kernel.steps import (
    BEGIN,
    FREED,
    LATE,
    LOST,
    MAX_REVERSALS,
    REVERSAL,
    SHARE,
    SIGN,
    STAGE,
    STEP,
    STUCK,
    advance,
    by_begin,
    by_share,
    drive_at,
    drive_slope,
    exceeds_at,
    never_sticks,
    note,
    part_of,
    runge_kutta,
    states_of,
    to_reversal,
)

_REFINEMENTS = 3  # tangents to the instant at which a joint breaks loose


@inner
def advance_moving(state, drives, h, c, tape, splits):
    """Return the state at the end of one interval; see `steps.advance` for a fixed base."""
    if never_sticks(c, splits):
        after = runge_kutta(state, drives, 0.0, 1.0, h, 0.0, c, tape, True)
        if tape is not None:
            note(STEP, 0.0, 1.0, 0.0, tape)
        return after
    begin = 0.0
    for _ in range(MAX_REVERSALS):
        sign, loosened = np.sign(state[V]), False
        if state[V] == 0.0:
            push = held(state, drive_at(drives, begin), c)
            most = friction_level(state[X], 0.0, 0.0, 0.0, 0.0, c)
            sign = np.sign(push)
            if abs(push) <= most:
                share, sign = _to_loose(state, drives, begin, h, most, c)
                state = runge_kutta(state, drives, begin, share, h, 0.0, c, tape, False)
                if tape is not None:
                    note(FREED if sign != 0.0 else STUCK, begin, share, sign, tape)
                if sign == 0.0:
                    return state
                begin += share
                loosened = True
        share = 1.0 - begin
        after = runge_kutta(state, drives, begin, share, h, sign, c, tape, True)
        if after[V] * sign >= 0.0:
            if tape is not None:
                note(STEP, begin, share, sign, tape)
            return after
        if loosened:
            break  # pushed back at once: friction holds the joint
        share, after = to_reversal(state, drives, begin, share, after[V], h, sign, c, tape, True)
        if tape is not None:
            note(REVERSAL, begin, share, sign, tape)
        state = (after[X], 0.0, after[M], after[Z])
        begin += share
    after = runge_kutta(state, drives, begin, 1.0 - begin, h, 0.0, c, tape, False)
    if tape is not None:
        note(STUCK, begin, 1.0 - begin, 0.0, tape)
    return after


@inner
def _to_loose(state, drives, begin, h, most, c):
    """Return the fraction of the interval during which friction holds, and the sliding direction.

    The direction is 0 if friction holds to the end.
    """
    rest = 1.0 - begin
    middle = runge_kutta(state, drives, begin, 0.5 * rest, h, 0.0, c, None, False)
    final = runge_kutta(state, drives, begin, rest, h, 0.0, c, None, False)
    three = (
        held(state, drive_at(drives, begin), c),
        held(middle, drive_at(drives, begin + 0.5 * rest), c),
        held(final, drive_at(drives, 1.0), c),
    )
    at, sign = exceeds_at(three, 0.0, -most, most)
    if at >= 1.0:
        return rest, 0.0
    share, slope = at * rest, sign * drive_slope(three, at) / rest
    for _ in range(_REFINEMENTS if slope > 0.0 else 0):
        after = runge_kutta(state, drives, begin, share, h, 0.0, c, None, False)
        lacking = most - sign * held(after, drive_at(drives, begin + share), c)
        share = min(max(share + lacking / slope, 0.0), rest)
    return share, sign


@inner
def hold_still(tangents):
    """Zero the derivatives of the velocity at rest."""
    for j in range(tangents.shape[1]):
        tangents[V, j] = 0.0


@pasted
def break_free(drives, tape, row, h, c, slopes, stages, tangents, column):
    """Correct the derivatives where the held torque exceeds friction, at the end of a step.

    A sliding joint would not accelerate there either.
    """
    begin, share, sign = tape[row, BEGIN], tape[row, SHARE], tape[row, SIGN]
    by_begin(drives, begin, share, c, stages)
    by_share(drives, begin, share, h, c, stages)
    x, sixth = tape[row, STAGE], share * h / 6.0
    force, change = tape[row, STAGE + M], tape[row, STAGE + Z]
    for i in range(4):
        weight = 2.0 * sixth if 0 < i < 3 else sixth
        force += weight * stages[i, M, RATE]
        change += weight * stages[i, Z, RATE]
    state = (x, 0.0, force, change)
    bend = -(c.slow * change + force) / c.swing
    shape = (math.sin(x), math.cos(x), 1.0, drive_at(drives, begin + share))
    linearise_moving(state, (0.0, change, bend), shape, sign, c, True, stages, 0)
    rise = stages[0, V, GAIN] * drive_slope(drives, begin + share)
    for r in (M, Z):
        rise += stages[0, V, r] * stages[0, r, BY_SHARE]
    for j in range(column.size):
        for r in range(states_of(c)):
            tangents[r, j] += stages[0, r, BY_BEGIN] * tangents[LATE, j]
        k, more = column[j], 0.0
        for r in (X, M, Z):
            more += stages[0, V, r] * tangents[r, j]
        if k >= DRIVES:
            q = k - DRIVES
            three = (slopes[q, 0], slopes[q, 1], slopes[q, 2])
            more += stages[0, V, GAIN] * drive_at(three, begin + share)
        elif k >= 0:
            more += stages[0, V, BASIS + k]
        later = -more / rise if rise != 0.0 else 0.0
        for r in (M, Z):
            tangents[r, j] += stages[0, r, BY_SHARE] * later
        tangents[LATE, j] += later


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
