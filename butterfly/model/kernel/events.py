"""Derivatives at reversals, at rest and at breaking loose.

The instant of each event depends on the parameters; `LATE` is its derivative. Angle and velocity
are continuous there, since the velocity is 0.
"""

from __future__ import annotations

import math

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
    holds_to,
    linearise,
    pull,
)
from butterfly.model.kernel.steps import BEGIN, SIGN, STAGE, drive_at, drive_slope

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
