"""The compiled kernel: the grey-box equation, its events in time, and the derivatives of both.

All of it is in one file, since numba's cache of a compiled function does not see changes in other
files that it calls. What stands here is for `butterfly.model.greybox`, which says what it means.
Functions that take ``t`` carry sensitivities along; with None in its place that costs nothing.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numba
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from butterfly.model.parameters import LumpedParameters

    Samples = NDArray[np.float64]

State = tuple[float, float, float, float]
"""Angle in rad, velocity in rad/s, torque of the motor in N m (a state only with a lag), and
deflection of the bristles in rad (a state only with a stiffness of theirs)."""

_X, _V, _M, _Z = range(4)
_LAG_STEPS = 16  # least number of steps in one time constant of the armature
_BRISTLE_STEPS = 4  # the same in one time constant of the bristles
_VANISHED = 6.0  # Stribeck velocities, at which exp(-36) is lost in rounding
_MAX_REVERSALS = 8  # reversals of the velocity that one step may hold before it is cut short
_REFINEMENTS = 3  # secant corrections of the instant at which the velocity vanishes
_REACH = (0.0, 0.5, 0.5, 1.0)  # share of a step at which its four stages stand
_GRAZING = 1e-9  # rad/s^2, slower than which a reversal has no instant to speak of


_compiled = numba.njit(cache=True, nogil=True, error_model="numpy")
_inlined = numba.njit(cache=True, nogil=True, error_model="numpy", forceinline=True)


class Constants(NamedTuple):
    """What the compiled equation needs to know, all numbers; see `LumpedParameters`."""

    p1: float
    viscous: float
    back_emf: float
    lag: float
    p3: float
    p3_offset: float
    coulomb: float
    stribeck: float
    stribeck_velocity: float
    bristle_stiffness: float
    bristle_damping: float
    drag: float
    bias: float
    cogging: float
    cogging_cosine: float
    cogging_periods: float

    @classmethod
    def of(cls, p: LumpedParameters) -> Constants:
        """Take them from the parameters of the hand with its added mass.

        An estimator may try friction that is negative under a load; it counts as none, since it
        would feed the motion. Bristles that no Coulomb friction bends are left out.
        """
        coulomb = max(p.coulomb, 0.0)
        own = {
            "viscous": p.p2 - p.back_emf,
            "lag": p.time_constant,
            "coulomb": coulomb,
            "stribeck": max(p.stribeck, -coulomb),
            "bristle_stiffness": p.bristle_stiffness if coulomb > 0 else 0.0,
        }
        return cls(*(float(own.get(name, getattr(p, name, 0.0))) for name in cls._fields))


COLUMNS = {name: number for number, name in enumerate(Constants._fields)}
"""Number of each constant's column; those of the drives follow."""

(
    _P1,
    _VISCOUS,
    _BACK_EMF,
    _LAG,
    _P3,
    _P3_OFFSET,
    _COULOMB,
    _STRIBECK,
    _STRIBECK_VELOCITY,
    _STIFFNESS,
    _DAMPING,
    _DRAG,
    _BIAS,
    _COGGING,
    _COGGING_COSINE,
    _PERIODS,
    _DRIVES,
) = range(len(Constants._fields) + 1)


# What happens is recorded on a tape, a row for each step, reversal and rest; the derivatives are
# carried over many rows at a time. Single arrays, since numba counts references to each that a
# function takes, which for every step would cost more than the step:
#
#   tape     (n, 48)   [kind, begin, share, sign, interval, part, parts, -], and from _STAGE on
#                      x v m z v' m' z' at each of four stages of a step, sin x, cos x and the
#                      excess of Stribeck friction, which cost more than all the rest; or for a rest
#                      x, the motor's torque; or where it breaks loose x, net torque, final torque.
#                      Its first row: [how many rows follow, -, -, -, interval, part, parts, interval
#                      of which the derivatives are]
#   column   (k,)      numbers of the constants (see `COLUMNS`), or of the drives after them, by
#                      which a column is the derivative; -1 for what acts by the initial state alone
#   s        (6, k)    derivatives of the four states, of the instant, as a share of the interval,
#                      from which the state is left, and of the motor's torque before a rest
#   t        (4, 4, _) at each of four stages, for each state's rate r
#                      t[i, r, :4]           its derivatives by the states
#                      t[i, r, _BASIS:]      its derivatives by each constant and drive
#                      t[i, r, _WEIGHT:]     weights of the stage's rates in the step's end r
#                      t[i, r, _RATE]        itself
#   own      (3, 3)    derivatives of the interval's drives, or those of its part, by p4 and others
_STEP, _REVERSAL, _REST, _LOOSE = 0.0, 1.0, 2.0, 3.0
_INTERVAL, _PART, _PARTS, _STAGE, _PER_STAGE = 4, 5, 6, 8, 10
_BASIS, MOST_DRIVES = 4, 3
_WEIGHT = _BASIS + _DRIVES + MOST_DRIVES
_RATE = _WEIGHT + 4
_LATE, _BEFORE = 4, 5
_ROWS = 128
_MOST = 2 * _MAX_REVERSALS + 4  # rows of one part of an interval


@_compiled
def integrate(time, drives, state, c):
    """Return (n,) angles and velocities, with (n - 1, 3) torques of the drive in N m."""
    n = time.size
    angle = np.empty(n)
    velocity = np.empty(n)
    angle[0], velocity[0] = state[_X], state[_V]
    for k in range(n - 1):
        row = (drives[k, 0], drives[k, 1], drives[k, 2])
        state = interval(state, row, time[k + 1] - time[k], c)
        angle[k + 1], velocity[k + 1] = state[_X], state[_V]
    return angle, velocity


@_compiled
def interval(state, drives, h, c):
    """Return the state at the end of one interval, in steps that lag and bristles allow."""
    count = least_steps(c, state[_V], h)
    if count == 1:
        return _advance(state, drives, h, c, None, None)
    for k in range(count):
        state = _advance(state, _part(drives, k, count), h / count, c, None, None)
    return state


@_compiled
def follow(time, drives, state, c, into, weights, values):
    """Write (m,) sums of angle and velocity at both ends of intervals, by (4, m) weights.

    Interval k writes the sum ``into[k]``, unless that is negative.
    """
    for k in range(time.size - 1):
        row = into[k]
        if row >= 0:
            values[row] = weights[0, row] * state[_X] + weights[1, row] * state[_V]
        drive = (drives[k, 0], drives[k, 1], drives[k, 2])
        state = interval(state, drive, time[k + 1] - time[k], c)
        if row >= 0:
            values[row] += weights[2, row] * state[_X] + weights[3, row] * state[_V]


@_compiled
def differentiate(time, drives, state, c, into, weights, values, column, initial, moved, rows):
    """As `follow`; and write (m, k) derivatives of the sums by the columns.

    ``initial`` is (4, k) derivatives of the state, ``moved`` (n - 1, q, 3) those of the drives by
    p4, delay and compression, as many as are needed.
    """
    tape = np.zeros((_ROWS, _STAGE + 4 * _PER_STAGE))
    t = np.zeros((4, 4, _RATE + 1))
    t[:, _X, _V] = 1.0
    s = np.zeros((6, column.size))
    s[:4] = initial
    tape[0, 7] = -1.0
    for k in range(time.size - 1):
        row, h = into[k], time[k + 1] - time[k]
        if row >= 0:
            values[row] = weights[0, row] * state[_X] + weights[1, row] * state[_V]
        drive = (drives[k, 0], drives[k, 1], drives[k, 2])
        count = least_steps(c, state[_V], h)
        for part in range(count):
            tape[0, _INTERVAL], tape[0, _PART], tape[0, _PARTS] = k, part, count
            own = drive if count == 1 else _part(drive, part, count)
            state = _advance(state, own, h / count, c, tape, column)
            if int(tape[0, 0]) > _ROWS - 1 - _MOST:
                _play(time, drives, c, into, weights, tape, t, s, column, moved, rows)
        if row >= 0:
            values[row] += weights[2, row] * state[_X] + weights[3, row] * state[_V]
    _play(time, drives, c, into, weights, tape, t, s, column, moved, rows)
    _close(time.size - 2, into, weights, s, rows)


@_compiled
def least_steps(c, v, h):
    """Count the steps that lag and bristles ask for in h s at a velocity of v rad/s."""
    count = 1
    if c.lag > 0.0:
        count = max(count, math.ceil(_LAG_STEPS * h / c.lag))
    if c.bristle_stiffness > 0.0:
        damping = (c.viscous + c.bristle_damping) / c.p1
        fastest = max(
            c.bristle_stiffness * abs(v) / _friction_level(v, c),
            damping,
            math.sqrt(c.bristle_stiffness / c.p1),
        )
        count = max(count, math.ceil(_BRISTLE_STEPS * h * fastest))
    return count


@_compiled
def rates(state, drive, sign, c):
    """Return the rates of velocity, motor torque and bristles, sliding in the direction sign."""
    x, v, motor, bend = state
    torque = drive - c.back_emf * v
    motor_rate = 0.0
    if c.lag > 0.0:
        motor_rate = (torque - motor) / c.lag
        torque = motor
    bend_rate = 0.0
    level = _friction_level(v, c)
    if c.bristle_stiffness > 0.0:
        bend_rate = v - c.bristle_stiffness * abs(v) * bend / level
        torque -= c.bristle_stiffness * bend + c.bristle_damping * bend_rate
    else:
        torque -= sign * level
    torque += _pull(x, c) - (c.viscous + c.drag * abs(v)) * v
    return torque / c.p1, motor_rate, bend_rate


@_compiled
def _pull(x, c):
    """Torque in N m that depends on the angle alone: gravity, cogging and bias."""
    torque = c.bias - c.p3 * math.sin(x)
    if c.p3_offset != 0.0:
        torque -= c.p3_offset * math.cos(x)
    if c.cogging != 0.0 or c.cogging_cosine != 0.0:
        turned = c.cogging_periods * x
        torque += c.cogging * math.sin(turned) + c.cogging_cosine * math.cos(turned)
    return torque


@_compiled
def _friction_level(v, c):
    """Coulomb and Stribeck friction g(v) in N m, without its sign."""
    return c.coulomb if c.stribeck == 0.0 else c.coulomb + c.stribeck * _excess(v, c)


@_compiled
def _excess(v, c):
    """Share of the Stribeck friction that is left at a velocity."""
    if abs(v) > _VANISHED * c.stribeck_velocity:
        return 0.0
    return math.exp(-((v / c.stribeck_velocity) ** 2))


@_compiled
def _drive_at(drives, fraction):
    """Evaluate the quadratic through the drives at fractions 0, 1/2 and 1 of the interval."""
    start, middle, end = drives
    bend = 2.0 * (start - 2.0 * middle + end)
    return start + fraction * (end - start - bend + bend * fraction)


@_compiled
def _part(drives, k, count):
    """Return the drives of the k-th of ``count`` equal parts of the interval."""
    return (
        _drive_at(drives, k / count),
        _drive_at(drives, (k + 0.5) / count),
        _drive_at(drives, (k + 1) / count),
    )


@_compiled
def _rk4(state, drives, begin, share, h, sign, c, tape):
    """Take one RK4 step over ``share`` of the interval h, sliding in the direction ``sign``."""
    x, v, m, z = state
    dt = share * h
    half = 0.5 * dt
    d0 = _drive_at(drives, begin)
    d1 = _drive_at(drives, begin + 0.5 * share)
    d2 = _drive_at(drives, begin + share)
    first = rates(state, d0, sign, c)
    a1, m1, z1 = first
    v2 = v + half * a1
    state2 = (x + half * v, v2, m + half * m1, z + half * z1)
    second = rates(state2, d1, sign, c)
    a2, m2, z2 = second
    v3 = v + half * a2
    state3 = (x + half * v2, v3, m + half * m2, z + half * z2)
    third = rates(state3, d1, sign, c)
    a3, m3, z3 = third
    v4 = v + dt * a3
    state4 = (x + dt * v3, v4, m + dt * m3, z + dt * z3)
    fourth = rates(state4, d2, sign, c)
    a4, m4, z4 = fourth
    if tape is not None:
        row = int(tape[0, 0]) + 1
        _record(tape, row, 0, state, first, c)
        _record(tape, row, 1, state2, second, c)
        _record(tape, row, 2, state3, third, c)
        _record(tape, row, 3, state4, fourth, c)
    sixth = dt / 6.0
    return (
        x + sixth * (v + 2.0 * v2 + 2.0 * v3 + v4),
        v + sixth * (a1 + 2.0 * a2 + 2.0 * a3 + a4),
        m + sixth * (m1 + 2.0 * m2 + 2.0 * m3 + m4),
        z + sixth * (z1 + 2.0 * z2 + 2.0 * z3 + z4),
    )


@_compiled
def _record(tape, row, stage, state, rate, c):
    """Write one stage of a step on the tape's next row, which another trial may write again."""
    at = _STAGE + _PER_STAGE * stage
    for i in range(4):
        tape[row, at + i] = state[i]
    for i in range(3):
        tape[row, at + 4 + i] = rate[i]
    tape[row, at + 7], tape[row, at + 8] = math.sin(state[_X]), math.cos(state[_X])
    tape[row, at + 9] = _excess(state[_V], c)


@_compiled
def _note(tape, kind, begin, share, sign):
    """Keep the tape's next row: it becomes what happened."""
    row = int(tape[0, 0]) + 1
    tape[row, 0], tape[row, 1], tape[row, 2], tape[row, 3] = kind, begin, share, sign
    for i in (_INTERVAL, _PART, _PARTS):
        tape[row, i] = tape[0, i]
    tape[0, 0] = row


@_compiled
def _rest(state, drives, begin, h, c, tape):
    """Return the state at the interval's end when the joint sticks from fraction ``begin`` on."""
    x, _, m, z = state
    if tape is not None:
        row = int(tape[0, 0]) + 1
        tape[row, _STAGE], tape[row, _STAGE + 1] = x, m
        _note(tape, _REST, begin, 0.0, 0.0)
    if c.lag > 0.0:
        target = _drive_at(drives, 0.5 * (1.0 + begin))
        m = target + (m - target) * math.exp(-(1.0 - begin) * h / c.lag)
    return x, 0.0, m, z


@_compiled
def _by_friction(column):
    """Tell whether a derivative by friction is wanted, for which a reversal is an event."""
    if column is not None:
        for k in column:
            if k == _COULOMB or k == _STRIBECK:
                return True
    return False


@_compiled
def _advance(state, drives, h, c, tape, column):
    """Return the state at the end of one interval, split at each reversal of the velocity."""
    holding = c.coulomb + c.stribeck
    if c.bristle_stiffness > 0.0 or (holding == 0.0 and not _by_friction(column)):
        after = _rk4(state, drives, 0.0, 1.0, h, 0.0, c, tape)
        if tape is not None:
            _note(tape, _STEP, 0.0, 1.0, 0.0)
        return after
    begin = 0.0
    for _ in range(_MAX_REVERSALS):
        x, v, m, z = state
        sign = np.sign(v)
        if v == 0.0:
            load = _pull(x, c)
            net = (m if c.lag > 0.0 else _drive_at(drives, begin)) + load
            if abs(net) <= holding and holding > 0.0:
                rest = _rest(state, drives, begin, h, c, tape)
                final = (rest[_M] if c.lag > 0.0 else _drive_at(drives, 1.0)) + load
                if abs(final) <= holding:
                    return rest
                if tape is not None:
                    row = int(tape[0, 0]) + 1
                    tape[row, _STAGE], tape[row, _STAGE + 1], tape[row, _STAGE + 2] = x, net, final
                    _note(tape, _LOOSE, begin, 0.0, np.sign(final))
                loose = (holding * np.sign(final) - net) / (final - net)
                begin += loose * (1.0 - begin)
                state = (x, v, m + loose * (rest[_M] - m), z)
                net = final
            sign = np.sign(net)
        share = 1.0 - begin
        after = _rk4(state, drives, begin, share, h, sign, c, tape)
        unchecked = v == 0.0 and holding == 0.0  # nothing could hold the joint where it is
        if after[_V] * sign >= 0.0 or unchecked:
            if tape is not None:
                _note(tape, _STEP, begin, share, sign)
            return after
        if v == 0.0:
            break  # pushed back at once: friction holds the joint
        upper = share
        share *= v / (v - after[_V])
        for _ in range(_REFINEMENTS):
            after = _rk4(state, drives, begin, share, h, sign, c, tape)
            share = min(share * v / (v - after[_V]), upper)
        if tape is not None:
            _note(tape, _REVERSAL, begin, share, sign)
        state = (after[_X], 0.0, after[_M], after[_Z])
        begin += share
    return _rest(state, drives, begin, h, c, tape)


@_compiled
def _play(time, drives, c, into, weights, tape, t, s, column, moved, rows):
    """Carry the derivatives over what the tape tells; then it is empty.

    The end of a step is linear in the derivatives S at its start and in those of the rates at its
    four stages, K_i = A_i (S + c_i h K_(i-1)) + B_i: it is P S + sum_i W_i B_i, where P and W_i,
    found from the last stage backwards, are the same for all columns.
    """
    states, own = _states(c), np.zeros((MOST_DRIVES, 3))
    torque, gain = (_M, 1.0 / c.lag) if c.lag > 0.0 else (_V, 1.0 / c.p1)
    ripples = c.cogging != 0.0 or c.cogging_cosine != 0.0
    for k in column:
        ripples |= _COGGING <= k <= _PERIODS
    current, latest = int(tape[0, 7]), -1
    for row in range(1, int(tape[0, 0]) + 1):
        kind, begin, share, sign = tape[row, 0], tape[row, 1], tape[row, 2], tape[row, 3]
        k, part, parts = int(tape[row, _INTERVAL]), int(tape[row, _PART]), int(tape[row, _PARTS])
        h = (time[k + 1] - time[k]) / parts
        if k != current:
            _close(current, into, weights, s, rows)
            _open(k, into, weights, s, rows)
            current, latest = k, -1
        if part != latest:
            latest = part
            for j in range(column.size):
                s[_LATE, j] = 0.0
            for q in range(moved.shape[1]):
                whole = (moved[k, q, 0], moved[k, q, 1], moved[k, q, 2])
                if parts > 1:
                    whole = _part(whole, part, parts)
                own[q, 0], own[q, 1], own[q, 2] = whole
        if kind == _STEP or kind == _REVERSAL:
            for i in range(4):
                at = _STAGE + _PER_STAGE * i
                state = (tape[row, at], tape[row, at + 1], tape[row, at + 2], tape[row, at + 3])
                rate = (tape[row, at + 4], tape[row, at + 5], tape[row, at + 6])
                shape = (tape[row, at + 7], tape[row, at + 8], tape[row, at + 9])
                _linearise(t, i, state, rate, shape, sign, c, ripples)
                t[i, _X, _RATE], t[i, _V, _RATE] = state[_V], rate[0]
                t[i, _M, _RATE], t[i, _Z, _RATE] = rate[1], rate[2]
            for q in range(moved.shape[1]):
                n, three = _BASIS + _DRIVES + q, (own[q, 0], own[q, 1], own[q, 2])
                if share < 1.0:
                    three = (
                        _drive_at(three, begin),
                        _drive_at(three, begin + 0.5 * share),
                        _drive_at(three, begin + share),
                    )
                t[0, torque, n], t[1, torque, n] = gain * three[0], gain * three[1]
                t[2, torque, n], t[3, torque, n] = t[1, torque, n], gain * three[2]
            if states == 2:
                _carry_two(share * h, t, s, column)
            else:
                _carry_all(share * h, states, t, s, column)
        if kind == _STEP and begin == 0.0:
            continue
        drive = (drives[k, 0], drives[k, 1], drives[k, 2])
        if parts > 1:
            drive = _part(drive, part, parts)
        if kind == _STEP:
            _end(drive, begin, share, h, c, t, s, column)
        elif kind == _REVERSAL:
            _reverse(drive, begin, share, h, c, t, s, column)
        elif kind == _LOOSE:
            _break_loose(drive, tape, row, c, own, t, s, column)
        else:
            _come_to_rest(drive, begin, tape[row, _STAGE + 1], h, c, own, s, column)
    tape[0, 0], tape[0, 7] = 0.0, current


@_inlined
def _open(k, into, weights, s, rows):
    """Begin the sums of interval k with the derivatives at its start."""
    row = into[k]
    if row >= 0:
        for j in range(s.shape[1]):
            rows[row, j] = weights[0, row] * s[_X, j] + weights[1, row] * s[_V, j]


@_inlined
def _close(k, into, weights, s, rows):
    """End the sums of interval k with the derivatives at its end."""
    row = into[k] if k >= 0 else -1
    if row >= 0:
        for j in range(s.shape[1]):
            rows[row, j] += weights[2, row] * s[_X, j] + weights[3, row] * s[_V, j]


@_compiled
def _states(c):
    """Count the states that the derivatives need."""
    return 4 if c.lag > 0.0 or c.bristle_stiffness > 0.0 else 2


@_inlined
def _linearise(t, i, state, rate, shape, sign, c, ripples):
    """Write the derivatives of the rates at stage ``i`` by the states and by all constants."""
    x, v, _, z = state
    sine, cosine, excess = shape
    push, speed, width = 1.0 / c.p1, abs(v), 1.0 / c.stribeck_velocity
    share = v * width
    narrowing = 2.0 * c.stribeck * excess * share * width  # -dg/dv
    rub = -sign * push
    t[i, _V, _X] = push * (c.p3_offset * sine - c.p3 * cosine)
    t[i, _V, _V] = -push * (c.viscous + c.back_emf + 2.0 * c.drag * speed) - rub * narrowing
    t[i, _V, _BASIS + _P1] = -push * rate[0]
    t[i, _V, _BASIS + _VISCOUS] = t[i, _V, _BASIS + _BACK_EMF] = -push * v
    t[i, _V, _BASIS + _P3] = -push * sine
    t[i, _V, _BASIS + _P3_OFFSET] = -push * cosine
    t[i, _V, _BASIS + _COULOMB] = rub
    t[i, _V, _BASIS + _STRIBECK] = rub * excess
    t[i, _V, _BASIS + _STRIBECK_VELOCITY] = rub * narrowing * share
    t[i, _V, _BASIS + _DRAG] = -push * speed * v
    t[i, _V, _BASIS + _BIAS] = push
    if ripples:
        wave, other = math.sin(c.cogging_periods * x), math.cos(c.cogging_periods * x)
        ripple = push * (c.cogging * other - c.cogging_cosine * wave)
        t[i, _V, _X] += c.cogging_periods * ripple
        t[i, _V, _BASIS + _COGGING] = push * wave
        t[i, _V, _BASIS + _COGGING_COSINE] = push * other
        t[i, _V, _BASIS + _PERIODS] = x * ripple
    if c.lag > 0.0:
        _linearise_lag(t, i, v, rate[1], push, c)
    if c.bristle_stiffness > 0.0:
        _linearise_bristles(t, i, v, z, rate[2], excess, push, c)


@_compiled
def _linearise_lag(t, i, v, motor_rate, push, c):
    """Let the motor's torque, a state, drive the joint in the place of its input."""
    t[i, _V, _V] += push * c.back_emf
    t[i, _V, _M] = push
    t[i, _V, _BASIS + _BACK_EMF] = 0.0
    t[i, _M, _V], t[i, _M, _M] = -c.back_emf / c.lag, -1.0 / c.lag
    t[i, _M, _BASIS + _BACK_EMF], t[i, _M, _BASIS + _LAG] = -v / c.lag, -motor_rate / c.lag


@_compiled
def _linearise_bristles(t, i, v, z, bend_rate, excess, push, c):
    """Let the bristles brake in the place of rigid friction, whose sign here is 0."""
    level = _friction_level(v, c)
    share = v / c.stribeck_velocity
    narrowing = 2.0 * c.stribeck * excess * share / c.stribeck_velocity
    slip = c.bristle_stiffness * abs(v) / level
    weaker = slip * z / level
    t[i, _Z, _V] = 1.0 - np.sign(v) * c.bristle_stiffness * z / level - weaker * narrowing
    t[i, _Z, _Z] = -slip
    t[i, _Z, _BASIS + _COULOMB] = weaker
    t[i, _Z, _BASIS + _STRIBECK] = weaker * excess
    t[i, _Z, _BASIS + _STRIBECK_VELOCITY] = weaker * narrowing * share
    t[i, _Z, _BASIS + _STIFFNESS] = -abs(v) * z / level
    t[i, _V, _V] -= push * c.bristle_damping * t[i, _Z, _V]
    t[i, _V, _Z] = push * (c.bristle_damping * slip - c.bristle_stiffness)
    for k in (_COULOMB, _STRIBECK, _STRIBECK_VELOCITY, _STIFFNESS):
        t[i, _V, _BASIS + k] = -push * c.bristle_damping * t[i, _Z, _BASIS + k]
    t[i, _V, _BASIS + _STIFFNESS] -= push * z
    t[i, _V, _BASIS + _DAMPING] = -push * bend_rate


@_inlined
def _carry_two(dt, t, s, column):
    """Do so where angle and velocity are all: their 2 x 2 matrices written out."""
    sixth, half = dt / 6.0, 0.5 * dt
    a1, a2, a3, a4 = t[0, _V, _X], t[1, _V, _X], t[2, _V, _X], t[3, _V, _X]
    b1, b2, b3, b4 = t[0, _V, _V], t[1, _V, _V], t[2, _V, _V], t[3, _V, _V]
    vx4, vv4 = sixth * a4, sixth * b4  # W_4 A_4, whose first row is (0, dt/6)
    xx3, xv3 = 2.0 * sixth, dt * sixth
    vx3, vv3 = dt * vx4, 2.0 * sixth + dt * vv4
    xx2, xv2 = 2.0 * sixth + half * xv3 * a3, half * (xx3 + xv3 * b3)
    vx2, vv2 = half * vv3 * a3, 2.0 * sixth + half * (vx3 + vv3 * b3)
    xx1, xv1 = sixth + half * xv2 * a2, half * (xx2 + xv2 * b2)
    vx1, vv1 = half * vv2 * a2, sixth + half * (vx2 + vv2 * b2)
    t[0, _X, _WEIGHT], t[0, _X, _WEIGHT + 1], t[0, _V, _WEIGHT], t[0, _V, _WEIGHT + 1] = (
        xx1,
        xv1,
        vx1,
        vv1,
    )
    t[1, _X, _WEIGHT], t[1, _X, _WEIGHT + 1], t[1, _V, _WEIGHT], t[1, _V, _WEIGHT + 1] = (
        xx2,
        xv2,
        vx2,
        vv2,
    )
    t[2, _X, _WEIGHT], t[2, _X, _WEIGHT + 1], t[2, _V, _WEIGHT], t[2, _V, _WEIGHT + 1] = (
        xx3,
        xv3,
        vx3,
        vv3,
    )
    t[3, _X, _WEIGHT], t[3, _X, _WEIGHT + 1], t[3, _V, _WEIGHT], t[3, _V, _WEIGHT + 1] = (
        sixth,
        0.0,
        0.0,
        sixth,
    )
    pxx = 1.0 + xv1 * a1 + xv2 * a2 + xv3 * a3
    pxv = xx1 + xv1 * b1 + xx2 + xv2 * b2 + xx3 + xv3 * b3 + sixth
    pvx = vv1 * a1 + vv2 * a2 + vv3 * a3 + vx4
    pvv = 1.0 + vx1 + vv1 * b1 + vx2 + vv2 * b2 + vx3 + vv3 * b3 + vv4
    for j in range(column.size):
        x, v, k = s[_X, j], s[_V, j], column[j]
        x, v = pxx * x + pxv * v, pvx * x + pvv * v
        if k >= 0:
            k1, k2, k3 = t[0, _V, _BASIS + k], t[1, _V, _BASIS + k], t[2, _V, _BASIS + k]
            x += xv1 * k1 + xv2 * k2 + xv3 * k3
            v += vv1 * k1 + vv2 * k2 + vv3 * k3 + sixth * t[3, _V, _BASIS + k]
        s[_X, j], s[_V, j] = x, v


@_compiled
def _carry_all(dt, n, t, s, column):
    """Do so for any number n of states."""
    product, move, start = np.zeros((n, n)), np.eye(n), np.empty(n)
    for stage in range(3, -1, -1):
        reach = 0.0 if stage == 3 else (dt if stage == 2 else 0.5 * dt)
        for r in range(n):
            for i in range(n):
                t[stage, r, _WEIGHT + i] = reach * product[r, i]
            t[stage, r, _WEIGHT + r] += dt / 3.0 if 0 < stage < 3 else dt / 6.0
        for r in range(n):
            for i in range(n):
                product[r, i] = 0.0
                for m in range(n):
                    product[r, i] += t[stage, r, _WEIGHT + m] * t[stage, m, i]
                move[r, i] += product[r, i]
    for j in range(column.size):
        k = column[j]
        for r in range(n):
            start[r] = s[r, j]
        for r in range(n):
            total = 0.0
            for i in range(n):
                total += move[r, i] * start[i]
                if k >= 0:
                    for stage in range(4):
                        total += t[stage, r, _WEIGHT + i] * t[stage, i, _BASIS + k]
            s[r, j] = total


@_compiled
def _drive_slope(drives, fraction):
    """Differentiate `_drive_at` by the fraction."""
    start, middle, end = drives
    bend = 2.0 * (start - 2.0 * middle + end)
    return end - start - bend + 2.0 * bend * fraction


@_compiled
def _by_begin(drives, begin, share, c, t):
    """(4,) derivatives of the end of a step by the fraction of the interval where it begins."""
    row, gain = (_M, 1.0 / c.lag) if c.lag > 0.0 else (_V, 1.0 / c.p1)
    end = np.zeros(4)
    for stage in range(4):
        slope = gain * _drive_slope(drives, begin + _REACH[stage] * share)
        for r in range(_states(c)):
            end[r] += t[stage, r, _WEIGHT + row] * slope
    return end


@_compiled
def _by_share(drives, begin, share, h, c, t):
    """(4,) derivatives of the end of a step by the share of the interval that it takes."""
    row, gain = (_M, 1.0 / c.lag) if c.lag > 0.0 else (_V, 1.0 / c.p1)
    n = _states(c)
    end, direct = np.zeros(4), np.zeros(4)
    for stage in range(4):
        reach = _REACH[stage]
        for r in range(n):
            end[r] += h / (3.0 if 0 < stage < 3 else 6.0) * t[stage, r, _RATE]
            direct[r] = 0.0
            if stage > 0:
                for i in range(n):
                    direct[r] += reach * h * t[stage, r, i] * t[stage - 1, i, _RATE]
        direct[row] += reach * gain * _drive_slope(drives, begin + reach * share)
        for r in range(n):
            for i in range(n):
                end[r] += t[stage, r, _WEIGHT + i] * direct[i]
    return end


@_compiled
def _end(drives, begin, share, h, c, t, s, column):
    """Correct the derivatives at the interval's end, which does not move when ``begin`` does."""
    moved = _by_begin(drives, begin, share, c, t) - _by_share(drives, begin, share, h, c, t)
    for j in range(column.size):
        for r in range(_states(c)):
            s[r, j] += moved[r] * s[_LATE, j]


@_compiled
def _reverse(drives, begin, share, h, c, t, s, column):
    """Correct the derivatives where the velocity vanishes, at an instant that they move.

    With F the end of the step, F_v(share) = 0 defines the share: d share = -S_v/(dF_v/d share).
    """
    by_begin = _by_begin(drives, begin, share, c, t)
    by_share = _by_share(drives, begin, share, h, c, t)
    grazes = abs(by_share[_V]) < _GRAZING * h
    for j in range(column.size):
        for r in range(_states(c)):
            s[r, j] += by_begin[r] * s[_LATE, j]
        later = 0.0 if grazes else -s[_V, j] / by_share[_V]
        for r in range(_states(c)):
            s[r, j] += by_share[r] * later
        s[_V, j] = 0.0
        s[_LATE, j] += later


@_compiled
def _come_to_rest(drives, begin, m, h, c, own, s, column):
    """Differentiate a rest to the interval's end; the motor's torque, ``m`` at first, goes on."""
    for j in range(column.size):
        s[_V, j] = 0.0
    if c.lag == 0.0:
        return
    middle = 0.5 * (1.0 + begin)
    excess, slope = m - _drive_at(drives, middle), 0.5 * _drive_slope(drives, middle)
    keep = math.exp(-(1.0 - begin) * h / c.lag)
    for j in range(column.size):
        k, late, before = column[j], s[_LATE, j], s[_M, j]
        target = slope * late
        if k >= _DRIVES:
            q = k - _DRIVES
            target += _drive_at((own[q, 0], own[q, 1], own[q, 2]), middle)
        exponent = h / c.lag * late
        if k == _LAG:
            exponent += 2.0 * (1.0 - middle) * h / c.lag**2
        s[_M, j] = target + keep * (before - target + excess * exponent)
        s[_BEFORE, j] = before


@_compiled
def _break_loose(drives, tape, row, c, own, t, s, column):
    """Move the derivatives from where a joint came to rest on to where it breaks loose.

    It does so at the share ``loose`` = (hold - net)/(final - net) of the rest of the interval.
    """
    begin, sign = tape[row, 1], tape[row, 3]
    x, net, final = tape[row, _STAGE], tape[row, _STAGE + 1], tape[row, _STAGE + 2]
    loose = ((c.coulomb + c.stribeck) * sign - net) / (final - net)
    still, shape = (x, 0.0, 0.0, 0.0), (math.sin(x), math.cos(x), 1.0)
    _linearise(t, 0, still, (0.0, 0.0, 0.0), shape, 0.0, c, True)
    for j in range(column.size):
        k, late = column[j], s[_LATE, j]
        pull = c.p1 * t[0, _V, _X] * s[_X, j]
        if k == _P3 or k == _P3_OFFSET or k == _BIAS or _COGGING <= k <= _PERIODS:
            pull += c.p1 * t[0, _V, _BASIS + k]
        hold = sign if k == _COULOMB or k == _STRIBECK else 0.0
        if c.lag > 0.0:
            by_net, by_final = pull + s[_BEFORE, j], pull + s[_M, j]
        else:
            by_net, by_final = pull + _drive_slope(drives, begin) * late, pull
            if k >= _DRIVES:
                q = k - _DRIVES
                by_net += _drive_at((own[q, 0], own[q, 1], own[q, 2]), begin)
                by_final += own[q, 2]
        by_loose = (hold - by_net - loose * (by_final - by_net)) / (final - net)
        s[_LATE, j] = late * (1.0 - loose) + (1.0 - begin) * by_loose
        if c.lag > 0.0:
            risen = s[_BEFORE, j] + loose * (s[_M, j] - s[_BEFORE, j])
            s[_M, j] = risen + by_loose * (final - net)
