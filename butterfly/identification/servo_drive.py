"""Servos in their loops: the kernel's model of one, and the drive rebuilt where it is not recorded.

A log's stamps are not the firmware's: the rebuilt drive is that of the control law at the stamps,
by the recorded set-point and angle. Closed-loop simulation does not use it.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from butterfly.arrays import Samples
from butterfly.identification.test_functions import HALF_WIDTH, VELOCITY_SHARE
from butterfly.logs.log import InputKind, Intersample, Log
from butterfly.model.kernel import servo_loop as kernel
from butterfly.model.kernel.servo_loop import Loop
from butterfly.model.parameters import LumpedParameters
from butterfly.model.prior import Known
from butterfly.model.servo import LawStructure, Output, ServoLoop
from butterfly.signals import hold, polynomials
from butterfly.signals.spectrum import resample, uniform_grid

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
    """Whether a log is simulated in a servo's loop whose clock was assumed, as nobody gave it."""
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
    slopes = polynomials.slope(resample(log.time, log.angle, grid), half, 2, step)
    return np.interp(log.time, grid, slopes)
