"""Integrate the equation in Runge-Kutta steps, split where the velocity vanishes.

Functions with a ``tape`` record there what the derivatives need; None costs nothing.
"""

from __future__ import annotations

import math

import numpy as np

from butterfly.compiled import inner, pasted
from butterfly.model.kernel.equation import M, V, X, Z, excess_at, holds_to, pull, rates
from butterfly.model.kernel.moving_base import moving_rates, stuck_rates

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
