"""Runge-Kutta steps, split where the velocity vanishes, and derivatives at such events."""

from __future__ import annotations

import math

import numpy as np

from butterfly.compiled import inner, pasted
from butterfly.model.kernel.equation import (
    BASIS,
    BY_BEGIN,
    BY_SHARE,
    DIRECT,
    DRIVES,
    GAIN,
    LAG,
    RATE,
    WEIGHT,
    M,
    V,
    X,
    Z,
    excess_at,
    holds_to,
    linearise,
    moving_rates,
    pull,
    rates,
    stuck_rates,
)

STEP, REVERSAL, REST, LOOSE, STUCK, FREED = 0.0, 1.0, 2.0, 3.0, 4.0, 5.0
KIND, BEGIN, SHARE, SIGN, INTERVAL, PART, PARTS = range(7)
COUNT, CURRENT = 0, 7
STAGE, PER_STAGE = 8, 11
TAPE_WIDTH = STAGE + 4 * PER_STAGE
"""The tape: kinds of events, and columns; row 0 counts."""

MAX_REVERSALS = 8
"""Reversals of the velocity allowed in one step."""

LOST = (math.nan, math.nan, math.nan, math.nan)
"""State of a diverged joint."""

_REFINEMENTS = 3  # chords to the instant at which the velocity vanishes
_BISECTIONS = 60  # where a velocity that grazes 0 leads chords astray
_ASTRAY = 0.1  # change by the last chord, as a share of what it changed
_ROUNDING = 1e-12  # share of an interval


@inner
def advance(state, drives, h, c, tape, splits):
    """Return the state at the end of one interval, split at each reversal of the velocity.

    ``splits`` splits it even without friction, for derivatives by friction.
    """
    if never_sticks(c, splits):
        after = runge_kutta(state, drives, 0.0, 1.0, h, 0.0, c, tape, None)
        if tape is not None:
            note(STEP, 0.0, 1.0, 0.0, tape)
        return after
    begin = 0.0
    onward = 1.0 if c.p1 > 0.0 else -1.0  # what has a negative inertia sets out against the torque
    for _ in range(MAX_REVERSALS):
        x, v, m, z = state
        sign, holds = np.sign(v), True
        loosened = False
        if v == 0.0:
            load = pull(x, c)
            motor = m if c.lag > 0.0 else drive_at(drives, begin)
            lower, upper = holds_to(x, -1.0, load, c), holds_to(x, 1.0, load, c)
            holds = lower < upper
            sign = np.sign(motor + load) * onward
            if holds and lower <= motor <= upper:
                rest = _rest(state, drives, begin, h, c, tape)
                later, final = 1.0, rest[M]
                if c.lag == 0.0:
                    later, sign = exceeds_at(drives, begin, lower, upper)
                elif not lower <= final <= upper:
                    sign, most = (1.0, upper) if final > upper else (-1.0, lower)
                    loose = (most - motor) / (final - motor)
                    later = begin + loose * (1.0 - begin)
                    state = (x, v, m + loose * (rest[M] - m), z)
                if later >= 1.0:
                    return rest
                if tape is not None:
                    row = np.int64(tape[0, COUNT]) + 1
                    tape[row, STAGE], tape[row, STAGE + 1], tape[row, STAGE + 2] = x, motor, final
                    tape[row, STAGE + 3] = later
                    note(LOOSE, begin, 0.0, sign, tape)
                begin = later
                sign *= onward
                loosened = True
        share = 1.0 - begin
        after = runge_kutta(state, drives, begin, share, h, sign, c, tape, None)
        unchecked = v == 0.0 and not holds  # nothing could hold the joint where it is
        if after[V] * sign >= 0.0 or unchecked:
            if tape is not None:
                note(STEP, begin, share, sign, tape)
            return after
        if loosened and c.lag > 0.0:
            break  # pushed back at once: friction holds the joint
        share, after = to_reversal(state, drives, begin, share, after[V], h, sign, c, tape, None)
        if tape is not None:
            note(REVERSAL, begin, share, sign, tape)
        state = (after[X], 0.0, after[M], after[Z])
        begin += share
    return _rest(state, drives, begin, h, c, tape)


@inner
def to_reversal(state, drives, begin, whole, final, h, sign, c, tape, moving):
    """Return the fraction of the interval until the velocity is 0, and the state then.

    After the fraction ``whole`` the state would be ``final``, with the other sign. A joint that
    starts from rest returns to rest.
    """
    v = state[V]
    share, after = whole * (v / (v - final)), state
    tried = share
    for _ in range(_REFINEMENTS if v != 0.0 else 0):
        tried = share
        after = runge_kutta(state, drives, begin, share, h, sign, c, tape, moving)
        share = min(share * v / (v - after[V]), whole)
    if v != 0.0 and abs(share - tried) <= _ASTRAY * tried:
        return share, after
    lower, upper = 0.0, whole
    for _ in range(_BISECTIONS):
        share = 0.5 * (lower + upper)
        after = runge_kutta(state, drives, begin, share, h, sign, c, tape, moving)
        if after[V] * sign < 0.0:
            upper = share
        else:
            lower = share
    return share, after


@pasted
def never_sticks(c, splits):
    """Whether a joint has no rigid friction, and needs no derivative by it."""
    smooth = c.coulomb == c.stribeck == c.geared == c.coulomb_slope == 0.0
    return (smooth and not splits) or c.bristle_stiffness > 0.0


@pasted
def _rest(state, drives, begin, h, c, tape):
    """Return the state at the interval's end when the joint sticks from fraction ``begin`` on."""
    x, _, m, z = state
    if tape is not None:
        row = np.int64(tape[0, COUNT]) + 1
        tape[row, STAGE], tape[row, STAGE + 1] = x, m
        note(REST, begin, 0.0, 0.0, tape)
    if c.lag > 0.0:
        target = drive_at(drives, 0.5 * (1.0 + begin))
        m = target + (m - target) * math.exp(-(1.0 - begin) * h / c.lag)
    return x, 0.0, m, z


@inner
def runge_kutta(state, drives, begin, share, h, sign, c, tape, moving):
    """Take one step over the fraction ``share`` of the interval h, sliding in direction ``sign``.

    On a ``moving`` base, if that is not None, it slides, or friction holds it (False).
    """
    x, v, m, z = state
    dt = share * h
    half = 0.5 * dt
    d1, d2, d3 = piece_of(drives, begin, share)
    first = _motion(state, d1, sign, c, moving)
    a1, m1, z1 = first
    v2 = v + half * a1
    state2 = (x + half * v, v2, m + half * m1, z + half * z1)
    second = _motion(state2, d2, sign, c, moving)
    a2, m2, z2 = second
    v3 = v + half * a2
    state3 = (x + half * v2, v3, m + half * m2, z + half * z2)
    third = _motion(state3, d2, sign, c, moving)
    a3, m3, z3 = third
    v4 = v + dt * a3
    state4 = (x + dt * v3, v4, m + dt * m3, z + dt * z3)
    fourth = _motion(state4, d3, sign, c, moving)
    a4, m4, z4 = fourth
    if tape is not None:
        record(state, first, d1, 0, c, tape)
        record(state2, second, d2, 1, c, tape)
        record(state3, third, d2, 2, c, tape)
        record(state4, fourth, d3, 3, c, tape)
    sixth = dt / 6.0
    return (
        x + sixth * (v + 2.0 * v2 + 2.0 * v3 + v4),
        v + sixth * (a1 + 2.0 * a2 + 2.0 * a3 + a4),
        m + sixth * (m1 + 2.0 * m2 + 2.0 * m3 + m4),
        z + sixth * (z1 + 2.0 * z2 + 2.0 * z3 + z4),
    )


@pasted
def _motion(state, drive, sign, c, moving):
    """Return the rates of a state."""
    if moving is None:
        return rates(state, drive, sign, c)
    return moving_rates(state, drive, sign, c) if moving else stuck_rates(state, c)


@inner
def record(state, rate, drive, stage, c, tape):
    """Write one stage of a step to the next row of the tape, which a retry may overwrite."""
    row, at = np.int64(tape[0, COUNT]) + 1, STAGE + PER_STAGE * stage
    for i in range(4):
        tape[row, at + i] = state[i]
    for i in range(3):
        tape[row, at + 4 + i] = rate[i]
    tape[row, at + 7], tape[row, at + 8] = math.sin(state[X]), math.cos(state[X])
    tape[row, at + 9] = excess_at(state[V], c)
    tape[row, at + 10] = state[M] if c.lag > 0.0 else drive - c.back_emf * state[V]


@inner
def note(kind, begin, share, sign, tape):
    """Keep the next row of the tape."""
    row = np.int64(tape[0, COUNT]) + 1
    tape[row, KIND], tape[row, BEGIN] = kind, begin
    tape[row, SHARE], tape[row, SIGN] = share, sign
    for i in (INTERVAL, PART, PARTS):
        tape[row, i] = tape[0, i]
    tape[0, COUNT] = row


@inner
def drive_at(drives, fraction):
    """Evaluate the parabola through drives at fractions 0, 1/2 and 1 of the interval."""
    start, middle, end = drives
    bend = 2.0 * (start - 2.0 * middle + end)
    return start + fraction * (end - start - bend + bend * fraction)


@pasted
def drive_slope(drives, fraction):
    """Differentiate `drive_at` by the fraction."""
    start, middle, end = drives
    bend = 2.0 * (start - 2.0 * middle + end)
    return end - start - bend + 2.0 * bend * fraction


@inner
def exceeds_at(drives, begin, lower, upper):
    """Return where after ``begin`` a parabola leaves a range (1 if not), and on which side."""
    start, middle, end = drives
    bend = 2.0 * (start - 2.0 * middle + end)
    slope = end - start - bend
    first, side = 1.0, 0.0
    for sign in (-1.0, 1.0):
        offset = start - (upper if sign > 0.0 else lower)
        if not abs(offset) < math.inf:
            continue
        square = slope**2 - 4.0 * bend * offset
        if square <= 0.0:
            continue
        outward = sign * math.sqrt(square)  # the slope where it is exceeded
        if slope * outward >= 0.0:
            at = -2.0 * offset / (slope + outward)
        elif bend != 0.0:
            at = (outward - slope) / (2.0 * bend)
        else:
            continue
        if begin - _ROUNDING <= at < first:
            first, side = max(at, begin), sign
    return first, side


@inner
def part_of(drives, part, parts):
    """Return the drives of one of ``parts`` equal parts of the interval, counted from 0."""
    return (
        drive_at(drives, part / parts),
        drive_at(drives, (part + 0.5) / parts),
        drive_at(drives, (part + 1) / parts),
    )


@pasted
def piece_of(drives, begin, share):
    """Return the drives of ``share`` of the interval from fraction ``begin`` on."""
    return (
        drive_at(drives, begin),
        drive_at(drives, begin + 0.5 * share),
        drive_at(drives, begin + share),
    )


LATE, BEFORE, HELD = 4, 5, 6
"""Rows of the derivatives after those of the states: of the instant of an event, of the motor
torque before a rest, and of the torque held by a servo loop (0 without one)."""

_REACH = (0.0, 0.5, 0.5, 1.0)  # share of a step at which each of its four stages is
_GRAZING = 1e-9  # rad/s^2, slower than which a reversal has no instant to speak of


@pasted
def states_of(c):
    """Return the number of states with derivatives."""
    return 4 if c.lag > 0.0 or c.bristle_stiffness > 0.0 or c.swing > 0.0 else 2


@pasted
def end(drives, begin, share, h, c, stages, tangents, column):
    """Correct the derivatives at the end of the interval, which is fixed while ``begin`` moves."""
    by_begin(drives, begin, share, c, stages)
    by_share(drives, begin, share, h, c, stages)
    for j in range(column.size):
        for r in range(states_of(c)):
            tangents[r, j] += (stages[0, r, BY_BEGIN] - stages[0, r, BY_SHARE]) * tangents[LATE, j]


@pasted
def reverse(drives, begin, share, h, c, stages, tangents, column):
    """Correct the derivatives where the velocity vanishes: F_v(share) = 0 at the step's end F."""
    by_begin(drives, begin, share, c, stages)
    by_share(drives, begin, share, h, c, stages)
    slowing = stages[0, V, BY_SHARE]
    for j in range(column.size):
        for r in range(states_of(c)):
            tangents[r, j] += stages[0, r, BY_BEGIN] * tangents[LATE, j]
        later = 0.0 if abs(slowing) < _GRAZING * h else -tangents[V, j] / slowing
        for r in range(states_of(c)):
            tangents[r, j] += stages[0, r, BY_SHARE] * later
        tangents[V, j] = 0.0
        tangents[LATE, j] += later


@inner
def by_begin(drives, begin, share, c, stages):
    """Write the derivatives of a step's end by the fraction of the interval where it begins."""
    n = states_of(c)
    for r in range(n):
        stages[0, r, BY_BEGIN] = 0.0
    for i in range(4):
        slope = drive_slope(drives, begin + _REACH[i] * share)
        for r in range(n):
            for m in range(V, n):
                stages[0, r, BY_BEGIN] += stages[i, r, WEIGHT + m] * stages[i, m, GAIN] * slope


@inner
def by_share(drives, begin, share, h, c, stages):
    """Write the derivatives of a step's end by its fraction of the interval."""
    n = states_of(c)
    for r in range(n):
        stages[0, r, BY_SHARE] = 0.0
    for i in range(4):
        reach = _REACH[i]
        slope = drive_slope(drives, begin + reach * share)
        for r in range(n):
            stages[0, r, BY_SHARE] += h / (3.0 if 0 < i < 3 else 6.0) * stages[i, r, RATE]
            direct = 0.0
            if i > 0:
                for m in range(n):
                    direct += reach * h * stages[i, r, m] * stages[i - 1, m, RATE]
            stages[0, r, DIRECT] = direct + reach * stages[i, r, GAIN] * slope
        for r in range(n):
            for m in range(n):
                stages[0, r, BY_SHARE] += stages[i, r, WEIGHT + m] * stages[0, m, DIRECT]


@pasted
def come_to_rest(drives, begin, motor, h, c, slopes, tangents, column):
    """Differentiate a rest to the interval's end; the motor torque, first ``motor``, evolves."""
    for j in range(column.size):
        tangents[V, j] = 0.0
    if c.lag == 0.0:
        return
    middle = 0.5 * (1.0 + begin)
    excess, slope = motor - drive_at(drives, middle), 0.5 * drive_slope(drives, middle)
    keep = math.exp(-(1.0 - begin) * h / c.lag)
    for j in range(column.size):
        k, late, before = column[j], tangents[LATE, j], tangents[M, j]
        target = slope * late + tangents[HELD, j]
        if k >= DRIVES:
            q = k - DRIVES
            target += drive_at((slopes[q, 0], slopes[q, 1], slopes[q, 2]), middle)
        exponent = h / c.lag * late
        if k == LAG:
            exponent += (1.0 - begin) * h / c.lag**2
        tangents[M, j] = target + keep * (before - target + excess * exponent)
        tangents[BEFORE, j] = before


@pasted
def break_loose(drives, tape, row, c, slopes, stages, tangents, column):
    """Propagate the derivatives from the beginning of a rest to breaking loose.

    There the motor torque leaves the range in which friction holds the joint. With a lag it is
    linear, and leaves at the fraction ``loose`` of the remaining interval.
    """
    begin, sign = tape[row, BEGIN], tape[row, SIGN]
    x, motor = tape[row, STAGE], tape[row, STAGE + 1]
    final, at = tape[row, STAGE + 2], tape[row, STAGE + 3]
    load, still, none = pull(x, c), (x, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    most = holds_to(x, sign, load, c)
    shape = (math.sin(x), math.cos(x), 1.0, most)
    linearise(still, none, shape, sign, c, True, True, stages, 0)
    loose = (most - motor) / (final - motor) if c.lag > 0.0 else 0.0
    for j in range(column.size):
        k, late = column[j], tangents[LATE, j]
        hold = -stages[0, V, X] * tangents[X, j]
        if 0 <= k < DRIVES:
            hold -= stages[0, V, BASIS + k]
        hold /= stages[0, V, M] if c.lag > 0.0 else stages[0, V, GAIN]
        if c.lag == 0.0:
            if k >= DRIVES:
                q = k - DRIVES
                hold -= drive_at((slopes[q, 0], slopes[q, 1], slopes[q, 2]), at)
            slope = drive_slope(drives, at)
            tangents[LATE, j] = hold / slope if slope != 0.0 else 0.0
            continue
        by_motor, by_final = tangents[BEFORE, j], tangents[M, j]
        by_loose = (hold - by_motor - loose * (by_final - by_motor)) / (final - motor)
        tangents[LATE, j] = late * (1.0 - loose) + (1.0 - begin) * by_loose
        risen = by_motor + loose * (by_final - by_motor)
        tangents[M, j] = risen + by_loose * (final - motor)
