"""A log on its grid: simulated with the recorded input from its start, or anew in each segment.

Between two instants of the grid the input is the parabola that has the mean and the first two
moments of the recorded one, so that no impulse is lost or gained where steps fall between them.
That does not say when friction lets go of a joint or catches it. So a recorded input is simulated
on its own clock: the stamps at which it jumps are on the grid, and a delay moves what is read.
Whether it is held or goes straight on, the same readings are averaged: errors of both compare.

Servos in their loops: the kernel's model of one, and the drive rebuilt where it is not recorded.

A log's stamps are not the firmware's: the rebuilt drive is that of the control law at the stamps,
by the recorded set-point and angle. Closed-loop simulation does not use it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from butterfly.arrays import ROUNDING, Samples, joined
from butterfly.errors import InputError
from butterfly.identification.test_functions import HALF_WIDTH, VELOCITY_SHARE
from butterfly.logs.log import InputKind, Intersample, Log
from butterfly.model.greybox import (
    Columns,
    Readings,
    differentiate,
    simulate_counted,
    steps_of_interval,
)
from butterfly.model.kernel import servo_loop as kernel
from butterfly.model.kernel.servo_loop import Loop
from butterfly.model.linear import resonance_frequency
from butterfly.model.parameters import LumpedParameters
from butterfly.model.prior import Known
from butterfly.model.servo import LawStructure, Output, ServoLoop
from butterfly.model.terms import DRIVE, DriveTerms
from butterfly.signals import hold
from butterfly.signals.frequency_response import resample, uniform_grid

_DRIVES = {
    Output.DUTY: InputKind.DUTY,
    Output.VOLTAGE: InputKind.VOLTAGE,
    Output.CURRENT: InputKind.CURRENT,
    Output.TORQUE: InputKind.TORQUE,
}
_HALF = VELOCITY_SHARE * HALF_WIDTH  # half-width in s of the window of a velocity


def loop_on_grid(  # noqa: PLR0917 - a servo, and where it is looked at
    log: Log, parameters: LumpedParameters, zero: float, grid: Samples, inputs: Samples, every: int
) -> Loop:
    """Return the kernel's model of a servo, whose firmware samples at each ``every``-th instant.

    ``inputs`` are (2, n - 1, 3) parabolas of set-point, or drive, and of its derivative by the
    delay; ``zero`` is the encoder's in rad.
    """
    step = float(grid[1] - grid[0])
    setpoint, late = inputs[0] @ hold.SIMPSON, inputs[1] @ hold.SIMPSON
    servo = log.servo if log.closed else None
    slews = servo is not None and _slews(servo)
    if servo is not None and slews:
        setpoint, late = kernel.slewed(setpoint, late, servo.speed_limit * step)
    late_grid, limited = grid - parameters.delay, None  # torque off and on is delayed as set-points
    if servo is not None and servo.kick < math.inf and not slews:
        time, goals = log.goal
        moved = hold.parabolas(time, _limited(goals, servo.kick), late_grid, log.between_samples)
        limited = moved[0] @ hold.SIMPSON, moved[1] @ hold.SIMPSON
    enabled = None if log.enabled is None else _on_grid(log, "enabled", late_grid)
    return Loop.of(
        servo,
        parameters,
        zero=zero,
        period=every * step,
        every=every,
        columns=(setpoint, late, _supply(log, servo, grid), enabled),
        kicked=limited,
    )


def _on_grid(log: Log, name: str, grid: Samples) -> Samples:
    """(n - 1,) means of a column that is held from stamp to stamp."""
    return hold.mean(*log.held(name), grid, log.between_samples)


def _supply(log: Log, servo: ServoLoop | None, grid: Samples | None) -> Samples | None:
    """(n,) recorded volts by which a duty is multiplied, if any."""
    if log.supply is None or servo is None or servo.rule.output is not Output.DUTY:
        return None
    return log.supply if grid is None else _on_grid(log, "supply", grid)


def drive_kind(servo: ServoLoop, *, supplied: bool = False) -> InputKind:
    """Return the kind of a servo's output, V where the supply of a duty is known."""
    kind, known = _DRIVES[servo.rule.output], supplied or servo.supply is not None
    return InputKind.VOLTAGE if kind is InputKind.DUTY and known else kind


def driven(log: Log, delay: float = 0.0) -> Log:
    """Return the log of a servo with its drive as input, rebuilt if it was not recorded.

    It is the output of the control law by motion and set-point, ``delay`` in s later: means over
    each step where the input is held, V where the supply of a duty is known.
    """
    servo = log.servo
    if log.input_kind is InputKind.DUTY and log.supply is not None:
        return replace(log, input=log.input * log.supply, input_kind=InputKind.VOLTAGE)
    if log.input_kind is not InputKind.SETPOINT or servo is None:
        return log
    kind = drive_kind(servo, supplied=log.supply is not None)
    known = replace(log, setpoint=log.input)
    nothing = np.zeros(log.time.size)
    setpoint, enabled = _late(known, "setpoint", delay), log.enabled
    if enabled is not None:
        enabled = np.rint(_late(known, "enabled", delay))
    limited = None
    if _slews(servo):
        setpoint, _ = kernel.slewed(setpoint, nothing, servo.speed_limit * log.mean_step)
    elif servo.kick < math.inf:
        slower = replace(known, setpoint=_limited(log.input, servo.kick))
        limited = _late(slower, "setpoint", delay), nothing
    loop = Loop.of(
        replace(servo, clock=log.mean_step),
        None,
        period=log.mean_step,
        columns=(setpoint, nothing, _supply(log, servo, None), enabled),
        kicked=limited,
    )
    angle, velocity = _sampled(log, servo, log.angle), _sampled(log, servo, _rate(log))
    drive = kernel.outputs(angle, velocity, loop)
    lead = log.lead
    if lead is not None:
        lead = replace(lead, input=np.full(lead.time.size, drive[0]), setpoint=lead.input)
    made: dict[str, Any] = {"input": drive, "enabled": enabled, "input_kind": kind, "rebuilt": True}
    return replace(known, **made, excitation=None, lead=lead)


def undriven(log: Log) -> Log:
    """Return the log of a rebuilt drive as it was recorded, with its set-point as input."""
    lead = log.lead
    if lead is not None and lead.setpoint is not None:
        lead = replace(lead, input=lead.setpoint, setpoint=None)
    raw: dict[str, Any] = {"input": log.setpoint, "input_kind": InputKind.SETPOINT, "lead": lead}
    return replace(log, **raw, setpoint=None, rebuilt=False)


def assumes_clock(log: Log) -> bool:
    """Whether a log is simulated in a servo's loop whose clock was not given, but assumed."""
    return log.closed and log.servo is not None and log.servo.clock_assumed


def driven_alone(log: Log, parameters: LumpedParameters) -> Log:
    """Return the open-loop log of a drive, rebuilt with estimated gains and delay if needed."""
    servo = log.servo
    if servo is None or not log.rebuilt:
        return log.opened
    gains: dict[str, Any] = {
        name: Known(value=getattr(parameters, f"loop_{name}") * getattr(servo, name).value)
        for name in ("kp", "ki", "kd")
    }
    return driven(replace(undriven(log), servo=replace(servo, **gains)), parameters.delay).opened


def _slews(servo: ServoLoop) -> bool:
    """Whether its firmware follows a set-point at a limited speed."""
    return servo.rule.structure is LawStructure.PID and math.isfinite(servo.speed_limit)


def _limited(goals: Samples, most: float) -> Samples:
    """(n,) set-points with steps limited to ``most``."""
    return np.asarray(goals[0] + np.cumsum(np.clip(np.diff(goals, prepend=goals[0]), -most, most)))


def _late(log: Log, name: str, delay: float) -> Samples:
    """(n,) values of a column delayed in s: means over the steps of a hold."""
    time, column = log.held(name)
    if log.between_samples is Intersample.FIRST_ORDER_HOLD:
        return np.interp(log.time - delay, time, column)
    edges = np.append(log.time, log.time[-1] + log.mean_step)
    return hold.mean(time, column, edges - delay, log.between_samples)


def _sampled(log: Log, servo: ServoLoop, column: Samples) -> Samples:
    """(n,) means, over the step after each sample, of a column as the firmware samples it."""
    if log.between_samples is Intersample.FIRST_ORDER_HOLD:
        return column
    share = max(1.0 - servo.period / log.mean_step, 0.0) / 2  # it holds a sample for a period
    return column + share * np.append(np.diff(column), 0.0)


def _rate(log: Log) -> Samples:
    """(n,) velocities in rad/s: as recorded, or slopes of local parabolas."""
    if log.velocity is not None:
        return log.velocity
    grid = uniform_grid(log.time)
    step = float(grid[1] - grid[0])
    half = min(max(round(_HALF / step), 1), (grid.size - 1) // 2)
    slopes = hold.slope(resample(log.time, log.angle, grid), half, 2, step)
    return np.interp(log.time, grid, slopes)


LONGEST_STEP = 0.01
"""Longest integration step in s; RK4's error is then 1.5e-7 rad over 70 s of small swings."""

FINEST = 100
"""Largest number of steps per sample: logs have no information on faster motions. A trial of a fit
may take as many for an interval of its grid."""
_JUMP = 0.01  # of the rms command, above which it jumps
_SHIFT = 0.1  # of a sampling interval, by which a delay shifts readings at once
_STIFF = 10  # times the steps of a sound joint, which an impossible one takes
_LONGEST_GRID = 20_000_000  # steps of a log: two days of slow motion
_DELAYS = 3  # drives before those of the terms of the drive: p4's, and those by both delays
_STEPS_PER_RADIAN = 10  # of the drive or of the resonance, whichever is faster


Starts = Samples
"""(s, 2) angles in rad, from the encoder's zero, and velocities in rad/s at s segments' begins."""


class _Read(NamedTuple):
    """What is read of a simulation, and m averages of what was measured."""

    readings: Readings
    measured: Samples  # (m,)
    counts: NDArray[np.int64]  # (m,) of averaged samples
    bounds: NDArray[np.int64]  # (s + 1,) numbers of the first of each segment, and of all


class Segments:
    """Simulates a log on a fixed grid, from an initial state in each of s segments.

    The step follows the resonance of the ``parameters`` of the bare hand and the log's drive, but
    is at most ``longest`` s. Segments begin at the samples numbered ``edges``, which are on the
    grid. Errors count from the sample numbered ``first`` on. The grid of a recorded input is on its
    clock, and begins before the log by the delay of the ``parameters``.
    """

    def __init__(
        self,
        log: Log,
        parameters: LumpedParameters,
        *,
        edges: Sequence[int] = (0,),
        first: int = 0,
        longest: float = LONGEST_STEP,
    ) -> None:
        self.log, self._first = log, first
        self._looped = needs_loop(log)
        step, self._every = min(grid_step(log, parameters), longest), 1
        if log.closed and log.servo is not None:
            step, self._every = log.servo.updates(step)
        _require_short(log, step)
        # whether a recorded input alone drives the joint, at any time
        self._driven, self._begun = not self._looped and bool(log.command[1].any()), 0.0
        begins, end = log.time[[*edges]], log.time[-1:]
        if self._driven:
            self._begun = parameters.delay
            begins = begins - self._begun
            self.grid = _between_jumps(log, np.append(begins, end), step)
        else:
            ends = pairwise([*begins.tolist(), float(end[0])])
            self.grid = np.append(joined([_grid(*pair, step) for pair in ends]), end)
        firsts = np.searchsorted(self.grid, begins)
        self.pieces = np.column_stack([firsts, np.append(firsts[1:], self.grid.size - 1)])
        """(s, 2) first and last instant of each segment on the grid, as numbers."""
        self._steps = 0  # since `spend`
        self._most = most_steps(log, parameters, step)
        self._latest: tuple[tuple[float, float, float, DriveTerms], Samples] | None = None
        self._latest_read: tuple[float, _Read] | None = None

    def spend(self) -> int:
        """Return the number of steps of all simulations since the last call."""
        steps, self._steps = self._steps, 0
        return steps

    @property
    def moved(self) -> float:
        """Derivative of the instants at which segments begin by a delay: 1 of a recorded input."""
        return float(self._driven)

    def bounds(self, joint: LumpedParameters) -> NDArray[np.int64]:
        """(s + 1,) numbers of the first error of each segment, and of all errors."""
        return self._read(joint).bounds

    def roots(self, joint: LumpedParameters) -> Samples:
        """(m,) weights of errors, by samples averaged: then white noise is alike in all."""
        counts = self._read(joint).counts
        return np.asarray(np.sqrt(counts / counts.mean()))

    def run(
        self, joint: LumpedParameters, zero: float, begins: Starts
    ) -> tuple[tuple[Samples, Samples, Samples], ...]:
        """Return of each segment (n,) instants in s, and at them angle in rad, velocity in rad/s.

        The ``joint`` has its added mass; ``zero`` is the encoder's in rad.
        """
        inputs, loop, motions = self._inputs(joint)[0], self.loop(joint, zero), []
        starts = self._starts(joint, zero, begins).tolist()
        for (first, last), (angle, velocity) in zip(self.pieces.tolist(), starts, strict=True):
            grid = self.grid[first : last + 1]
            motion = simulate_counted(joint, grid, inputs[first:last], angle, velocity, loop)
            self._steps += motion.steps
            motions.append((grid + self._late(joint), zero + motion.angle, motion.velocity))
        motions[0][0][0] = min(motions[0][0][0], self.log.time[0])
        return tuple(motions)

    def linearised(
        self,
        columns: Columns,
        zero: float,
        begins: Starts,
        chosen: ArrayLike = (),
    ) -> tuple[Samples, Samples]:
        """Return (m,) errors in rad or rad/s, and (m, n) derivatives by the ``columns``.

        Errors are simulated less measured, averaged over the samples of each grid interval, and
        both are weighted by `roots`: that keeps their information at a fraction of their number.
        They are NaN where a trial is stiffer than any joint of such logs (see `most_steps`). With
        ``chosen`` numbers of segments, increasing, they are those of these segments alone, whose
        starts are ``begins``.
        """
        joint, starts = columns.joint, self._starts(columns.joint, zero, begins)
        inputs, read = self._inputs(joint, columns.drives), self._read(joint)
        readings, measured, roots = read.readings, read.measured, self.roots(joint)
        pieces, loop = self.pieces, self.loop(joint, zero)
        if len(begins) < len(pieces):
            mask = self.errors_of(chosen, joint)
            numbers = np.append(np.where(mask, np.cumsum(mask) - 1, -1), -1)
            weights = np.compress(mask, readings.weights, axis=1)  # in C's order, as compiled for
            readings = Readings(into=numbers[readings.into], weights=weights)
            pieces, measured, roots = pieces[np.asarray(chosen)], measured[mask], roots[mask]
        values, rows, steps, later = differentiate(
            self.grid, inputs, starts, readings, columns, pieces=pieces, loop=loop, most=self._most
        )
        self._steps += steps
        if self._driven and "delay" in columns.names:
            rows[:, columns.names.index("delay")] = later
        rise = 0 if self.log.integrated else 1  # no velocity depends on the zero
        if "zero" in columns.names:  # it moves the start back, and all readings on
            rows[:, columns.names.index("zero")] += rise
        rows *= roots[:, np.newaxis]
        return roots * (values + (rise * zero - measured)), rows

    def errors_of(self, chosen: ArrayLike, joint: LumpedParameters) -> NDArray[np.bool_]:
        """(m,) whether each error is of one of some segments, by number."""
        return np.repeat(np.isin(np.arange(len(self.pieces)), chosen), np.diff(self.bounds(joint)))

    def averages(self, joint: LumpedParameters) -> tuple[NDArray[np.int64], Samples, Samples]:
        """Return for (m,) errors samples averaged, middles of steps in s, and mean inputs."""
        read = self._read(joint)
        averaged = read.readings.into >= 0
        middles = (self.grid[:-1] + self.grid[1:])[averaged] / 2 + self._late(joint)
        delivered = hold.parabolas(
            *self._delivered(joint), self._edges(joint), self.log.between_samples
        )
        inputs = np.asarray((delivered[0] @ hold.SIMPSON)[averaged])
        return read.counts, np.asarray(middles), inputs

    def loop(self, joint: LumpedParameters, zero: float) -> Loop | None:
        """Return the loop of a servo that drives the joint; None where the input is open-loop."""
        if not self._looped:
            return None
        return loop_on_grid(self.log, joint, zero, self.grid, self._inputs(joint), self._every)

    def _starts(self, joint: LumpedParameters, zero: float, begins: Starts) -> Samples:
        """(s, 2) states where segments begin on the grid, which no other delay moves."""
        starts = begins - [zero, 0.0]
        starts[:, 0] += (self._late(joint) - self._begun) * starts[:, 1]
        return starts

    def _late(self, joint: LumpedParameters) -> float:
        """Return the delay in s that moves readings; 0 where it moves the input."""
        return joint.delay if self._driven else 0.0

    def _read(self, joint: LumpedParameters) -> _Read:
        """Return the readings of the simulation and the averages of the measured signal.

        A delay shifts the readings on the grid by whole tenths of a sampling interval, and by the
        remainder along the polynomial of each step: so the same samples are averaged while it
        hardly changes. The latest result is cached.
        """
        late, log = joint.delay if self._driven else 0.0, self.log
        if self._latest_read is None or self._latest_read[0] != late:
            unit = _SHIFT * log.mean_step
            moved = round(late / unit) * unit
            samples = log.time[self._first :] - moved, log.measured[self._first :]
            into, weights, measured, counts = hold.averages(
                self.grid, *samples, log.integrated, late - moved
            )
            before = np.append(0, np.cumsum(into >= 0))
            bounds = before[[*self.pieces[:, 0], self.pieces[-1, 1]]]
            readings = Readings(into=into, weights=weights if self._driven else weights[:4])
            self._latest_read = late, _Read(readings, measured, counts, bounds)
        return self._latest_read[1]

    def _inputs(self, joint: LumpedParameters, drives: int = 2) -> Samples:
        """(2 or more, n - 1, 3) input and its derivatives (see `Columns.drives`); keeps the last.

        Searches simulate many times with one delay. Of a servo they are those of its set-point.
        """
        count, log = 2 if self._looped else max(drives, 2), self.log
        key = joint.delay, joint.slow_delay, joint.slow_interval, joint.drive
        latest = self._latest
        if latest is not None and latest[0] == key and len(latest[1]) >= count:
            return latest[1][:count]
        if self._looped:  # the kernel's loop computes the drive
            time, inputs = log.goal if log.closed else log.command
        else:
            time, inputs = self._delivered(joint)
        edges, kind = self._edges(joint), log.between_samples
        parts = [hold.parabolas(time, inputs, edges, kind)]
        if count >= _DELAYS:
            held = kind is Intersample.ZERO_ORDER_HOLD
            steps = np.diff(inputs, prepend=0.0 if held else inputs[0])
            slow = steps * log.is_slow(joint.slow_interval)  # while the clock is slow
            parts.append(hold.parabolas(time, np.cumsum(slow), edges, kind)[1:])
            for name in DRIVE[: count - _DELAYS]:
                by_term = joint.slope(name, log.command[1])
                parts.append(hold.parabolas(time, by_term, edges, kind)[:1])
        self._latest = key, joined(parts)
        return self._latest[1]

    def _delivered(self, joint: LumpedParameters) -> tuple[Samples, Samples]:
        """Return stamps at which commands arrive, and what the drive's model makes of them."""
        time, commands = self.log.command
        if joint.slow_delay:
            time = self.log.arrivals(joint.slow_delay, joint.slow_interval)
        return time, joint.drive.delivered(commands)

    def _edges(self, joint: LumpedParameters) -> Samples:
        """Return the instants between which the input, as recorded, acts."""
        return self.grid if self._driven else self.grid - joint.delay


def needs_loop(log: Log) -> bool:
    """Whether a log's drive depends on its motion, or its torque is off at times."""
    return log.closed or (log.enabled is not None and bool(np.any(np.rint(log.enabled) == 0)))


def _require_short(log: Log, step: float) -> None:
    """Raise InputError for a log that takes more steps, of ``step`` s, than any memory holds."""
    span = float(log.time[-1] - log.time[0])
    if span > _LONGEST_GRID * step:
        taken = f"{span:.3g} s, which takes {span / step:.1g} steps of {step:.2g} s"
        raise InputError(log.source, "time", taken, "stamps in seconds, or a shorter log")


def _between_jumps(log: Log, bounds: Samples, longest: float) -> Samples:
    """Return the grid of an input between increasing bounds in s: its jumps, and steps between.

    At a jump the input bends by more than is negligible: where the joint turns back or sticks, the
    effect of a rough input is not that of its mean.
    """
    time, commands = log.command
    jumps = np.diff(commands, prepend=0.0)
    bends = np.abs(np.diff(jumps, prepend=0.0, append=0.0))
    least = _JUMP * float(np.sqrt(np.mean(commands**2)))
    bent = (np.abs(jumps) > least) & (np.maximum(bends[:-1], bends[1:]) > least)
    jumped = time[bent & (time > bounds[0]) & (time < bounds[-1])]
    after = np.searchsorted(bounds, jumped)
    nearest = np.minimum(jumped - bounds[after - 1], bounds[after] - jumped)
    edges = np.union1d(bounds, jumped[nearest > ROUNDING * log.mean_step])
    counts = np.maximum(np.ceil(np.diff(edges) / longest * (1 - 1e-9)), 1)
    ends = np.concatenate([[0.0], np.cumsum(counts)])
    return np.asarray(np.interp(np.arange(ends[-1] + 1), ends, edges))


def _grid(begin: float, end: float, step: float) -> Samples:
    """Return uniform instants from a segment's begin to before its end."""
    grid = uniform_grid(np.array([begin, end]), step)
    return grid[:-1] if grid[-1] >= end else grid


def most_steps(log: Log, parameters: LumpedParameters, step: float) -> int:
    """Return the steps that a trial of a fit may take for an interval of a grid.

    A sound joint takes one to four, and those that a stiff one needs follow from the first guess:
    ten times as many are a motion that a log does not show, and an impossible trial.
    """
    sound = steps_of_interval(parameters.with_added_mass(log.added_mass), log.rms_speed, step)
    return max(FINEST, round(_STIFF * sound))


def grid_step(log: Log, parameters: LumpedParameters) -> float:
    """Return the longest step in s of a grid, but at least 1/`FINEST` of a sampling interval."""
    drive = log.excitation.omega if log.excitation else 0.0
    loaded = parameters.with_added_mass(log.added_mass)
    fastest = max(resonance_frequency(loaded), drive)
    longest = LONGEST_STEP
    if loaded.p2 * longest > loaded.p1:
        longest = min(longest, log.mean_step)
    if not fastest:
        return longest
    return max(min(longest, 1 / (_STEPS_PER_RADIAN * fastest)), log.mean_step / FINEST)
