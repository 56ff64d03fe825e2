"""Simulate with derivatives, by replaying a tape of many steps at a time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from butterfly.arrays import Samples
from butterfly.compiled import compiled, inlined, inner
from butterfly.model.kernel.equation import (
    BACK_EMF,
    BASIS,
    COGGING,
    COULOMB,
    COULOMB_SLOPE,
    DRIVES,
    GAIN,
    LOWERING_STRIBECK,
    MOST_DRIVES,
    MOTOR_FRICTION,
    MOVE,
    PERIODS,
    PRODUCT,
    RATE,
    STAGE_WIDTH,
    START,
    STRIBECK,
    WEIGHT,
    M,
    V,
    X,
    Z,
    linearise,
    linearise_moving,
    linearise_stuck,
)
from butterfly.model.kernel.integrate import break_free, count_steps, hold_still, step
from butterfly.model.kernel.servo_loop import (
    MEMORY,
    TORQUE,
    WIDTH,
    at,
    differentiate_torque,
    torque,
)
from butterfly.model.kernel.steps import (
    BEGIN,
    COUNT,
    CURRENT,
    FREED,
    HELD,
    INTERVAL,
    KIND,
    LATE,
    LOOSE,
    LOST,
    MAX_REVERSALS,
    PART,
    PARTS,
    PER_STAGE,
    REST,
    REVERSAL,
    SHARE,
    SIGN,
    STAGE,
    STEP,
    STUCK,
    TAPE_WIDTH,
    break_loose,
    come_to_rest,
    end,
    part_of,
    piece_of,
    reverse,
    states_of,
)

_ROWS = 128
_MOST = 3 * MAX_REVERSALS + 4  # rows that one part of an interval may take


class Work(NamedTuple):
    """Arrays that `differentiate` works with; it allocates none."""

    tape: Samples
    stages: Samples  # (4, 4, w) derivatives at the stages of a step
    tangents: Samples  # (7, k) derivatives of the states, and the rows of `events`
    slopes: Samples  # (q, 3) derivatives of the drive in a part of an interval
    memory: Samples  # of a servo's firmware,
    record: Samples  # what its derivatives need of each interval,
    remembered: Samples  # and (3, k) derivatives of its memory

    @classmethod
    def of(cls, initial: Samples, looped: int) -> Work:
        """Return arrays for (4, k) ``initial`` derivatives and ``looped`` intervals in a loop."""
        columns = initial.shape[1]
        stages = np.zeros((4, 4, STAGE_WIDTH))
        stages[:, X, V] = 1.0
        return cls(
            tape=np.zeros((_ROWS, TAPE_WIDTH)),
            stages=stages,
            tangents=np.empty((7, columns)),
            slopes=np.zeros((MOST_DRIVES, 3)),
            memory=np.zeros(MEMORY),
            record=np.zeros((looped, WIDTH)),
            remembered=np.zeros((3, columns)),
        )


@compiled
def differentiate(
    pieces, starts, time, drives, c, into, weights, values, column, initial, moved, rows,
    loop, without_drive, moving, most, work,
):  # fmt: skip
    """Write (2, m) sums of angle and velocity at both ends of intervals, and (m, k) derivatives.

    The second sums are by the second four of ``weights``, if these are eight; they have no
    derivatives. Interval k writes the sums ``into[k]``, unless that is negative. Each of (s, 2)
    ``pieces``, from one instant to another, begins anew at its row of (s, 2) ``starts``.
    ``initial`` is (4, k) derivatives of the state; `butterfly.model.greybox.differentiate` has the
    other arrays. The ``loop`` of a servo, unless None, drives the joint instead of ``drives``, with
    the constants ``without_drive`` while it is off. ``moving`` is None for a fixed base; ``work``
    is fresh. An interval that needs more than ``most`` steps diverges. Returns the number of steps
    taken.
    """
    tape, tangents, record, splits, steps = work.tape, work.tangents, work.record, False, 0
    for k in column:
        splits |= (
            k in (COULOMB, STRIBECK, COULOMB_SLOPE) or MOTOR_FRICTION <= k <= LOWERING_STRIBECK
        )
    for piece in range(pieces.shape[0]):
        state = starts[piece, 0], starts[piece, 1], 0.0, 0.0
        held, now = 0.0, c
        _renew(work, initial)
        for k in range(pieces[piece, 0], pieces[piece, 1]):
            row, h = into[k], time[k + 1] - time[k]
            if row >= 0:
                for i in range(weights.shape[0] // 4):
                    x, v = weights[4 * i, row], weights[4 * i + 1, row]
                    values[i, row] = x * state[X] + v * state[V]
            if loop is None:
                drive = (drives[k, 0], drives[k, 1], drives[k, 2])
            else:
                held = torque(k, state, loop, work.memory, held, record)
                record[k, TORQUE] = held
                drive, now = (held, held, held), at(k, loop, c, without_drive)
            count = count_steps(state, h, now, moving, most)
            steps += max(count, 1)
            if count == 0:
                state = LOST
            for part in range(count):
                tape[0, INTERVAL], tape[0, PART], tape[0, PARTS] = k, part, count
                part_drive = drive if count == 1 else part_of(drive, part, count)
                state = step(state, part_drive, h / count, now, tape, splits, moving)
                if tape[0, COUNT] > _ROWS - 1 - _MOST:
                    _play(
                        time, drives, c, into, weights, column, initial, moved, rows,
                        loop, without_drive, moving, work,
                    )  # fmt: skip
            if row >= 0:
                for i in range(weights.shape[0] // 4):
                    x, v = weights[4 * i + 2, row], weights[4 * i + 3, row]
                    values[i, row] += x * state[X] + v * state[V]
        _play(
            time, drives, c, into, weights, column, initial, moved, rows,
            loop, without_drive, moving, work,
        )  # fmt: skip
        _close(pieces[piece, 1] - 1, into, weights, tangents, rows)
    return steps


@inlined
def _renew(work, initial):
    """Make the work ready for another piece."""
    tape, tangents, memory, remembered = work.tape, work.tangents, work.memory, work.remembered
    tape[0, CURRENT], tape[0, COUNT] = -1.0, 0.0
    for r in range(tangents.shape[0]):
        for j in range(tangents.shape[1]):
            tangents[r, j] = initial[r, j] if r < initial.shape[0] else 0.0
    for i in range(memory.size):
        memory[i] = 0.0
    for r in range(remembered.shape[0]):
        for j in range(remembered.shape[1]):
            remembered[r, j] = 0.0


@inner
def _play(  # noqa: PLR0915 - a tape, row by row
    time, drives, c, into, weights, column, initial, moved, rows, loop, without_drive, moving, work,
):  # fmt: skip
    """Propagate the derivatives through the tape and clear it."""
    tape, stages, tangents, slopes = work.tape, work.stages, work.tangents, work.slopes
    states, record, remembered = states_of(c), work.record, work.remembered
    ripples, carries = c.cogging != 0.0 or c.cogging_cosine != 0.0, c.geared != 0.0
    for k in column:
        ripples |= COGGING <= k <= PERIODS
        carries |= MOTOR_FRICTION <= k <= LOWERING_STRIBECK
    current, latest, now, drive = np.int64(tape[0, CURRENT]), np.int64(-1), c, (0.0, 0.0, 0.0)
    if loop is not None and current >= 0:
        now, drive = at(current, loop, c, without_drive), _held_drive(current, record)
    for row in range(1, np.int64(tape[0, COUNT]) + 1):
        kind, begin, share = tape[row, KIND], tape[row, BEGIN], tape[row, SHARE]
        k, part = np.int64(tape[row, INTERVAL]), np.int64(tape[row, PART])
        parts = np.int64(tape[row, PARTS])
        h = (time[k + 1] - time[k]) / parts
        if k != current:
            _close(current, into, weights, tangents, rows)
            _open(k, into, weights, tangents, rows)
            current, latest = k, np.int64(-1)
            if loop is not None:
                now, drive = at(k, loop, c, without_drive), _held_drive(k, record)
                differentiate_torque(
                    k, loop, record, tangents, column, initial, remembered, tangents[HELD]
                )
        if part != latest:
            latest = part
            _begin_part(k, part, parts, tangents, moved, slopes)
        if kind not in (LOOSE, REST):
            _linearise_step(
                tape, row, now, ripples, carries, slopes, moved.shape[0], stages, moving
            )
            if loop is not None:
                _open_circuit(k, loop, stages)
            if moving is not None and kind in (STUCK, FREED):
                hold_still(tangents)
            if states == 2:
                carry_two(share * h, stages, tangents, column)
            else:
                carry_all(share * h, states, stages, tangents, column)
            if loop is not None:
                _carry_held(states, stages, tangents)
        if kind == STEP and begin == 0.0:
            continue
        if loop is None:
            drive = (drives[k, 0], drives[k, 1], drives[k, 2])
        if parts > 1:
            drive = part_of(drive, part, parts)
        if kind in (STEP, STUCK):
            end(drive, begin, share, h, now, stages, tangents, column)
        elif kind == REVERSAL:
            reverse(drive, begin, share, h, now, stages, tangents, column)
        elif moving is not None:  # freed
            break_free(drive, tape, row, h, now, slopes, stages, tangents, column)
        elif kind == LOOSE:
            break_loose(drive, tape, row, now, slopes, stages, tangents, column)
        else:
            come_to_rest(drive, begin, tape[row, STAGE + 1], h, now, slopes, tangents, column)
    tape[0, COUNT], tape[0, CURRENT] = 0.0, current


@inner
def _held_drive(k, record):
    """Return the torque held during interval k as drives."""
    return record[k, TORQUE], record[k, TORQUE], record[k, TORQUE]


@inner
def _open_circuit(k, loop, stages):
    """Ignore the back EMF while nothing drives."""
    if loop.on[k] == 0.0:
        for i in range(4):
            stages[i, V, BASIS + BACK_EMF] = stages[i, M, BASIS + BACK_EMF] = 0.0


@inner
def _carry_held(states, stages, tangents):
    """Add the effect of the derivatives of the held torque over a step."""
    for r in range(states):
        push = 0.0
        for i in range(4):
            for m in range(V, states):
                push += stages[i, m, GAIN] * stages[i, r, WEIGHT + m]
        for j in range(tangents.shape[1]):
            tangents[r, j] += push * tangents[HELD, j]


@inlined
def _begin_part(k, part, parts, tangents, moved, slopes):
    """Begin a part of interval k, with its own drives, at an instant that no parameter moves."""
    for j in range(tangents.shape[1]):
        tangents[LATE, j] = 0.0
    for q in range(moved.shape[0]):
        whole = (moved[q, k, 0], moved[q, k, 1], moved[q, k, 2])
        if parts > 1:
            whole = part_of(whole, part, parts)
        slopes[q, 0], slopes[q, 1], slopes[q, 2] = whole


@inlined
def _linearise_step(tape, row, c, ripples, carries, slopes, count, stages, moving):
    """Write the derivatives at the four stages of a step, including ``count`` drives."""
    begin, share, sign = tape[row, BEGIN], tape[row, SHARE], tape[row, SIGN]
    for i in range(4):
        at = STAGE + PER_STAGE * i
        state = (tape[row, at], tape[row, at + 1], tape[row, at + 2], tape[row, at + 3])
        rate = (tape[row, at + 4], tape[row, at + 5], tape[row, at + 6])
        shape = (tape[row, at + 7], tape[row, at + 8], tape[row, at + 9], tape[row, at + 10])
        if moving is None:
            linearise(state, rate, shape, sign, c, ripples, carries, stages, i)
        elif tape[row, KIND] in (STUCK, FREED):
            linearise_stuck(state, rate, c, stages, i)
        else:
            linearise_moving(state, rate, shape, sign, c, carries, stages, i)
        stages[i, X, RATE], stages[i, V, RATE] = state[V], rate[0]
        stages[i, M, RATE], stages[i, Z, RATE] = rate[1], rate[2]
    for q in range(count):
        n, three = BASIS + DRIVES + q, (slopes[q, 0], slopes[q, 1], slopes[q, 2])
        if share < 1.0:
            three = piece_of(three, begin, share)
        for i in range(4):
            for m in range(V, states_of(c)):
                stages[i, m, n] = stages[i, m, GAIN] * three[(i + 1) // 2]


@inlined
def _open(k, into, weights, tangents, rows):
    """Begin the sums of interval k with the derivatives at its start."""
    row = into[k]
    if row >= 0:
        for j in range(tangents.shape[1]):
            rows[row, j] = weights[0, row] * tangents[X, j] + weights[1, row] * tangents[V, j]


@inlined
def _close(k, into, weights, tangents, rows):
    """End the sums of interval k with the derivatives at its end."""
    row = into[k] if k >= 0 else -1
    if row >= 0:
        for j in range(tangents.shape[1]):
            rows[row, j] += weights[2, row] * tangents[X, j] + weights[3, row] * tangents[V, j]


@inlined
def carry_two(dt, stages, tangents, column):
    """Propagate derivatives through a step of angle and velocity, with matrices written out."""
    sixth, half = dt / 6.0, 0.5 * dt
    a1, a2, a3, a4 = stages[0, V, X], stages[1, V, X], stages[2, V, X], stages[3, V, X]
    b1, b2, b3, b4 = stages[0, V, V], stages[1, V, V], stages[2, V, V], stages[3, V, V]
    vx4, vv4 = sixth * a4, sixth * b4  # W_4 A_4, whose first row is (0, dt/6)
    xx3, xv3 = 2.0 * sixth, dt * sixth
    vx3, vv3 = dt * vx4, 2.0 * sixth + dt * vv4
    xx2, xv2 = 2.0 * sixth + half * xv3 * a3, half * (xx3 + xv3 * b3)
    vx2, vv2 = half * vv3 * a3, 2.0 * sixth + half * (vx3 + vv3 * b3)
    xx1, xv1 = sixth + half * xv2 * a2, half * (xx2 + xv2 * b2)
    vx1, vv1 = half * vv2 * a2, sixth + half * (vx2 + vv2 * b2)
    _weigh(xx1, xv1, vx1, vv1, stages, 0)
    _weigh(xx2, xv2, vx2, vv2, stages, 1)
    _weigh(xx3, xv3, vx3, vv3, stages, 2)
    _weigh(sixth, 0.0, 0.0, sixth, stages, 3)
    pxx = 1.0 + xv1 * a1 + xv2 * a2 + xv3 * a3
    pxv = xx1 + xv1 * b1 + xx2 + xv2 * b2 + xx3 + xv3 * b3 + sixth
    pvx = vv1 * a1 + vv2 * a2 + vv3 * a3 + vx4
    pvv = 1.0 + vx1 + vv1 * b1 + vx2 + vv2 * b2 + vx3 + vv3 * b3 + vv4
    for j in range(column.size):
        x, v, k = tangents[X, j], tangents[V, j], column[j]
        x, v = pxx * x + pxv * v, pvx * x + pvv * v
        if k >= 0:
            n = BASIS + k
            k1, k2, k3 = stages[0, V, n], stages[1, V, n], stages[2, V, n]
            x += xv1 * k1 + xv2 * k2 + xv3 * k3
            v += vv1 * k1 + vv2 * k2 + vv3 * k3 + sixth * stages[3, V, n]
        tangents[X, j], tangents[V, j] = x, v


@inlined
def _weigh(xx, xv, vx, vv, stages, i):
    """Write the weights W of stage ``i``."""
    stages[i, X, WEIGHT + X], stages[i, X, WEIGHT + V] = xx, xv
    stages[i, V, WEIGHT + X], stages[i, V, WEIGHT + V] = vx, vv


@inner
def carry_all(dt, n, stages, tangents, column):
    """Propagate derivatives through a step of n states."""
    for r in range(n):
        for m in range(n):
            stages[0, r, PRODUCT + m], stages[0, r, MOVE + m] = 0.0, 1.0 if r == m else 0.0
    for i in range(3, -1, -1):
        reach = 0.0 if i == 3 else (dt if i == 2 else 0.5 * dt)
        for r in range(n):
            for m in range(n):
                stages[i, r, WEIGHT + m] = reach * stages[0, r, PRODUCT + m]
            stages[i, r, WEIGHT + r] += dt / 3.0 if 0 < i < 3 else dt / 6.0
        for r in range(n):
            for m in range(n):
                product = 0.0
                for q in range(n):
                    product += stages[i, r, WEIGHT + q] * stages[i, q, m]
                stages[0, r, PRODUCT + m] = product
                stages[0, r, MOVE + m] += product
    for j in range(column.size):
        k = column[j]
        for r in range(n):
            stages[0, r, START] = tangents[r, j]
        for r in range(n):
            total = 0.0
            for m in range(n):
                total += stages[0, r, MOVE + m] * stages[0, m, START]
                if k >= 0:
                    for i in range(4):
                        total += stages[i, r, WEIGHT + m] * stages[i, m, BASIS + k]
            tangents[r, j] = total
