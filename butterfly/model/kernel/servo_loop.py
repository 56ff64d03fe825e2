"""The servo loop in the simulation: commands of its firmware, and their derivatives.

The firmware samples the joint at its own clock and holds its command in between: saturation, dead
band and switching off happen at instants that no parameter moves.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from butterfly.arrays import Samples
from butterfly.compiled import compiled, inner
from butterfly.model.kernel.equation import COLUMNS, V, X
from butterfly.model.parameters import LumpedParameters
from butterfly.model.servo import LawStructure, Output, ServoLoop
from butterfly.model.terms import LOOP_TERMS

PID, CASCADE, SPEED, RECORDED = 0.0, 1.0, 2.0, 3.0
"""Structure of the loop: PID of the angle error, cascade, speed loop, or the setpoint itself."""

_STRUCTURES = {LawStructure.PID: PID, LawStructure.CASCADE: CASCADE, LawStructure.SPEED: SPEED}

INTEGRAL, OUTPUT, SPEED_BEFORE, GOAL_BEFORE, LOOKED = range(5)
MEMORY = 5
"""Memory of the firmware: integral of the error, last output, velocity and setpoint at the last
sample, and whether there was one. The first three have derivatives."""

BY_SETPOINT, BY_ANGLE, BY_VELOCITY, BY_INTEGRAL, BY_LAST, BY_P, BY_I, BY_D = range(8)
SLOPE, BY_SPEED, DELIVERED, BY_DEAD_ZONE, BY_COMPRESSION = range(8, 13)
GATE, RISE_BY_SETPOINT, RISE_BY_ANGLE, RISE_BY_VELOCITY, RISE_BY_P = range(13, 18)
TORQUE, BY_PACE, SEEN_SPEED, SEEN_RATE, LOOKS_BACK = range(18, 23)
WIDTH = 23
"""Columns kept of each interval: derivatives of the output, its gain to the joint, derivatives of
the integral's increment, the held torque, the output's derivative by the setpoint step, and the
measured motion."""

_P4, _DELAY, _DEAD_ZONE, _COMPRESSION = (
    COLUMNS[name] for name in ("p4", "delay", "dead_zone", "compression")
)
_LOOP_P, _LOOP_I, _LOOP_D, _LATENCY = (COLUMNS[name] for name in LOOP_TERMS)


class Loop(NamedTuple):
    """All numbers of a loop: in units of its output, per rad, rad s and rad/s."""

    structure: float
    kp: float  # as simulated,
    ki: float
    kd: float
    told_kp: float  # and as told
    told_ki: float
    told_kd: float
    limit: float  # of the output
    speed_limit: float  # in rad/s, of a cascade
    dead_band: float  # of the error
    slew: float  # most change of the output from update to update
    period: float  # in s, of the updates
    every: int  # intervals of the grid in one
    ahead: float  # in s, of the joint as it is seen: half a period of a faster clock, less latency
    rate_ahead: float  # and of its velocity, which a filter may show later
    emf: float  # V per rad/s,
    drop: float  # and V, the most that the current's limit allows over the resistance
    on_error: float  # whether kd acts on the error's rate, or on that of the joint alone
    zero: float  # the encoder's, in rad
    p4: float
    dead_zone: float
    compression: float
    setpoint: Samples  # (n - 1,) mean over each interval, delayed
    late: Samples  # (n - 1,) its derivative by the delay
    kicked: Samples  # (n - 1,) and both where D acts on the error, whose steps the output limits
    late_kicked: Samples
    supply: Samples  # (n - 1,) by which the output is multiplied
    on: Samples  # (n - 1,) whether the joint is driven

    @classmethod
    def of(
        cls,
        servo: ServoLoop | None,
        parameters: LumpedParameters | None,
        *,
        period: float,
        columns: tuple[Samples, Samples, Samples | None, Samples | None],
        kicked: tuple[Samples, Samples] | None = None,
        every: int = 1,
        zero: float = 0.0,
    ) -> Loop:
        """Return the loop of a servo and its joint; without a servo the setpoint is the command.

        The ``columns`` are setpoint, its derivative, supply (the loop's if None) and enabled; the
        first two are computed by ``kicked`` if None.
        Without ``parameters`` the torque is the output of the firmware.
        """
        setpoint, late, supply, enabled = columns
        p = LumpedParameters(p1=1.0, p2=0.0, p3=0.0, p4=1.0) if parameters is None else parameters
        known = servo or ServoLoop(law="pid-torque")
        nominal, reach, rule = known.gains_si, known.reach, known.rule
        structure = _STRUCTURES[rule.structure]
        gains = nominal[0] * p.loop_kp, nominal[1] * p.loop_ki, nominal[2] * p.loop_kd
        if servo is None:
            structure, gains, nominal = RECORDED, (1.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        ahead = 0.0 if servo is None else max(period - known.period, 0.0) / 2 - p.latency
        volts = (rule.output is Output.DUTY and known.supply) or 1.0
        return cls(
            structure,
            *gains,
            *nominal,
            limit=rule.limit if known.limit is None else float(known.limit),
            speed_limit=float(known.speed_limit),
            dead_band=float(known.dead_band),
            slew=float(known.slew) * period,
            period=period,
            every=every,
            ahead=ahead,
            rate_ahead=ahead - rule.rate_lag,
            emf=float(reach[0]),
            drop=float(reach[1]),
            on_error=float(rule.on_error),
            zero=zero,
            p4=p.p4,
            dead_zone=p.dead_zone,
            compression=p.compression,
            setpoint=setpoint,
            late=late,
            kicked=kicked[0] if kicked else setpoint,
            late_kicked=kicked[1] if kicked else late,
            supply=np.full(setpoint.size, volts) if supply is None else supply.copy(),
            on=np.ones(setpoint.size) if enabled is None else np.rint(enabled),
        )


@inner
def at(k, loop, c, without_drive):
    """Return the constants of interval k."""
    return c if loop.on[k] > 0.0 else without_drive


@inner
def torque(k, state, loop, memory, held, record):  # noqa: PLR0915 - a law, step by step
    """Return the torque of the drive in N m during interval k, ``held`` before.

    ``record``, unless None, receives the values for the derivatives.
    """
    if loop.on[k] == 0.0:
        memory[INTEGRAL] = memory[OUTPUT] = memory[LOOKED] = 0.0
        return 0.0
    if k % loop.every != 0:
        return held
    x, v, rate = _seen(state, loop, memory)
    z, looks_back = memory[INTEGRAL], memory[LOOKED]
    error = loop.setpoint[k]
    if loop.structure != RECORDED:
        error -= v if loop.structure == SPEED else x
    seen = 1.0 if abs(error) > loop.dead_band else 0.0
    error *= seen
    pace = loop.on_error * looks_back * (loop.kicked[k] - memory[GOAL_BEFORE]) / loop.period
    memory[SPEED_BEFORE], memory[GOAL_BEFORE], memory[LOOKED] = state[V], loop.kicked[k], 1.0
    rise, steep, damping, of_p = error, loop.kp, loop.kd, 1.0
    if loop.structure == CASCADE:
        wanted = max(-loop.speed_limit, min(loop.speed_limit, loop.kp * error))
        of_p = 1.0 if wanted == loop.kp * error else 0.0
        rise, steep, damping = wanted - v, loop.kd, 0.0
    raw = steep * rise + loop.ki * z + damping * (pace - v)
    output = max(-loop.limit, min(loop.limit, raw))
    free = 1.0 if output == raw else 0.0
    gate = loop.period if free > 0.0 or rise * raw <= 0.0 else 0.0
    last = memory[OUTPUT]
    slow = max(last - loop.slew, min(last + loop.slew, output))
    of_last, free = (0.0, free) if slow == output else (1.0, 0.0)
    memory[OUTPUT], memory[INTEGRAL] = slow, z + gate * rise
    supplied = slow * loop.supply[k]
    most, least = loop.emf * state[V] + loop.drop, loop.emf * state[V] - loop.drop
    command = max(least, min(most, supplied))
    past = command - max(-loop.dead_zone, min(loop.dead_zone, command))
    weaker = 1.0 / (1.0 + loop.compression * abs(past))
    delivered = past * weaker
    if record is not None:
        slope = weaker * weaker if past != 0.0 or loop.dead_zone == 0.0 else 0.0
        limited = 0.0 if command == supplied else 1.0
        record[k, SLOPE] = (1.0 - limited) * slope * loop.supply[k]
        record[k, BY_SPEED], record[k, DELIVERED] = limited * slope * loop.emf, delivered
        record[k, BY_DEAD_ZONE] = -np.sign(past) * weaker * weaker
        record[k, BY_COMPRESSION] = -past * abs(past) * weaker * weaker
        _rise(k, seen, of_p, error, loop, record)
        record[k, GATE], record[k, LOOKS_BACK] = gate, looks_back
        record[k, SEEN_SPEED], record[k, SEEN_RATE] = state[V] + loop.ahead * rate, rate
        for of_output, of_rise in (
            (BY_SETPOINT, RISE_BY_SETPOINT),
            (BY_ANGLE, RISE_BY_ANGLE),
            (BY_VELOCITY, RISE_BY_VELOCITY),
            (BY_P, RISE_BY_P),
        ):
            record[k, of_output] = free * steep * record[k, of_rise]
        record[k, BY_VELOCITY] -= free * damping
        record[k, BY_INTEGRAL], record[k, BY_LAST] = free * loop.ki, of_last
        record[k, BY_I] = free * loop.told_ki * z
        if loop.structure == CASCADE:
            record[k, BY_D] = free * loop.told_kd * rise
        else:
            record[k, BY_P] = free * loop.told_kp * rise
            record[k, BY_D] = free * loop.told_kd * (pace - v)
            record[k, BY_PACE] = looks_back * free * damping * loop.on_error / loop.period
    return loop.p4 * delivered


@inner
def _seen(state, loop, memory):
    """Return angle and velocity as measured by the firmware, and the rate of the velocity."""
    rate = memory[LOOKED] * (state[V] - memory[SPEED_BEFORE]) / loop.period
    x = state[X] + loop.zero + loop.ahead * (state[V] + 0.5 * loop.ahead * rate)
    return x, state[V] + loop.rate_ahead * rate, rate


@inner
def _rise(k, seen, of_p, error, loop, record):
    """Keep the derivatives of the integral's increment in interval k."""
    by_setpoint, by_angle, by_velocity, by_p = seen, -seen, 0.0, 0.0
    if loop.structure >= SPEED:
        by_angle, by_velocity = 0.0, -seen if loop.structure == SPEED else 0.0
    if loop.structure == CASCADE:
        share = of_p * loop.kp
        by_setpoint, by_angle, by_velocity = share * by_setpoint, share * by_angle, -1.0
        by_p = of_p * loop.told_kp * error
    record[k, RISE_BY_SETPOINT], record[k, RISE_BY_ANGLE] = by_setpoint, by_angle
    record[k, RISE_BY_VELOCITY], record[k, RISE_BY_P] = by_velocity, by_p


@inner
def differentiate_torque(k, loop, record, tangents, column, initial, remembered, held):
    """Write the (k,) derivatives of the ``held`` torque of interval k.

    ``remembered`` has the (3, k) derivatives of the firmware's memory.
    """
    if loop.on[k] == 0.0:
        for j in range(column.size):
            held[j] = remembered[INTEGRAL, j] = remembered[OUTPUT, j] = 0.0
        return
    if k % loop.every != 0:
        return
    for j in range(column.size):
        number, speed = column[j], tangents[V, j]
        rate = record[k, LOOKS_BACK] * (speed - remembered[SPEED_BEFORE, j]) / loop.period
        x = tangents[X, j] + loop.ahead * (speed + 0.5 * loop.ahead * rate)
        v, setpoint = speed + loop.rate_ahead * rate, 0.0
        if number == _LATENCY:
            x -= record[k, SEEN_SPEED]
            v -= record[k, SEEN_RATE]
        if number == _DELAY:
            setpoint = loop.late[k] / loop.p4
        elif number < 0 and initial[X, j] < 0.0 and loop.structure < SPEED:
            setpoint = -1.0  # the encoder's zero
        pace = 0.0
        if number == _DELAY:
            pace = loop.late_kicked[k] - loop.late_kicked[max(k - loop.every, 0)]
        output = record[k, BY_PACE] * pace / loop.p4
        output += (
            record[k, BY_SETPOINT] * setpoint + record[k, BY_ANGLE] * x + record[k, BY_VELOCITY] * v
        )
        output += record[k, BY_INTEGRAL] * remembered[INTEGRAL, j]
        output += record[k, BY_LAST] * remembered[OUTPUT, j]
        rise = record[k, RISE_BY_SETPOINT] * setpoint
        rise += record[k, RISE_BY_ANGLE] * x + record[k, RISE_BY_VELOCITY] * v
        direct = 0.0
        if number == _LOOP_P:
            output += record[k, BY_P]
            rise += record[k, RISE_BY_P]
        elif number == _LOOP_I:
            output += record[k, BY_I]
        elif number == _LOOP_D:
            output += record[k, BY_D]
        elif number == _P4:
            direct = record[k, DELIVERED]
        elif number == _DEAD_ZONE:
            direct = record[k, BY_DEAD_ZONE]
        elif number == _COMPRESSION:
            direct = record[k, BY_COMPRESSION]
        remembered[INTEGRAL, j] += record[k, GATE] * rise
        remembered[OUTPUT, j], remembered[SPEED_BEFORE, j] = output, speed
        held[j] = direct + loop.p4 * (record[k, SLOPE] * output + record[k, BY_SPEED] * speed)


def outputs(angle: Samples, velocity: Samples, loop: Loop) -> Samples:
    """Return (n,) outputs of the firmware at samples of the joint, times the supply."""
    values = np.empty(angle.size)
    _outputs(angle, velocity, loop, np.zeros(MEMORY), values)
    return values


@compiled
def _outputs(angle, velocity, loop, memory, values):
    """Write `outputs`."""
    held = 0.0
    for k in range(angle.size):
        held = torque(k, (angle[k], velocity[k], 0.0, 0.0), loop, memory, held, None)
        values[k] = held


def slewed(setpoint: Samples, late: Samples, most: float) -> tuple[Samples, Samples]:
    """Return (n,) setpoints with limited changes, and their derivatives."""
    reached, by_delay = setpoint.copy(), late.copy()
    _slew(setpoint, most, reached, by_delay)
    return reached, by_delay


@compiled
def _slew(setpoint, most, reached, by_delay):
    """Limit the changes of setpoints in place."""
    for k in range(1, setpoint.size):
        step = setpoint[k] - reached[k - 1]
        if abs(step) > most:
            reached[k] = reached[k - 1] + np.sign(step) * most
            by_delay[k] = by_delay[k - 1]
