"""Steps of a joint on a moving base, whose push friction also holds while it sticks."""

from __future__ import annotations

import math

import numpy as np

from butterfly.compiled import inner, pasted
from butterfly.model.kernel.equation import (
    BASIS,
    BY_BEGIN,
    BY_SHARE,
    DRIVES,
    GAIN,
    RATE,
    M,
    V,
    X,
    Z,
    friction_level,
)
from butterfly.model.kernel.events import LATE, by_begin, by_share, states_of
from butterfly.model.kernel.moving_base import held, linearise_moving
from butterfly.model.kernel.steps import (
    BEGIN,
    FREED,
    MAX_REVERSALS,
    REVERSAL,
    SHARE,
    SIGN,
    STAGE,
    STEP,
    STUCK,
    drive_at,
    drive_slope,
    exceeds_at,
    never_sticks,
    note,
    runge_kutta,
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
