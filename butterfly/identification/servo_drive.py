"""Servos in their loops: what the kernel is told of one, and the drive that its log does not hold.

A log's stamps are not the firmware's: the drive that is rebuilt at them is what the law says of the
recorded set-point and angle. Closed-loop simulation needs none of it.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from butterfly.arrays import Samples
from butterfly.identification.test_functions import HALF_WIDTH, VELOCITY_SHARE
from butterfly.logs.log import InputKind, Log
from butterfly.model.kernel import loop as kernel
from butterfly.model.kernel.loop import Loop
from butterfly.model.parameters import LumpedParameters
from butterfly.model.servo import LawStructure, Output, ServoLoop
from butterfly.signals import hold, polynomials
from butterfly.signals.spectrum import resample, uniform_grid

_STRUCTURES = {
    LawStructure.PID: kernel.PID,
    LawStructure.CASCADE: kernel.CASCADE,
    LawStructure.SPEED: kernel.SPEED,
}
_DRIVES = {
    Output.DUTY: InputKind.DUTY,
    Output.VOLTAGE: InputKind.VOLTAGE,
    Output.CURRENT: InputKind.CURRENT,
    Output.TORQUE: InputKind.TORQUE,
}
_REACH = VELOCITY_SHARE * HALF_WIDTH  # s to either side, over which a rate is taken
_SIMPSON = np.array([1.0, 4.0, 1.0]) / 6  # the mean of a parabola


def needs_loop(log: Log) -> bool:
    """Whether a log's input alone does not say what drives it throughout."""
    return log.closed or (log.enabled is not None and bool(np.any(np.rint(log.enabled) == 0)))


def loop_on_grid(  # noqa: PLR0917 - a servo, and where it is looked at
    log: Log,
    parameters: LumpedParameters,
    zero: float,
    grid: Samples,
    inputs: Samples,
    every: int,
) -> Loop:
    """Return what the kernel is told of a servo, whose firmware looks at ``every`` instant.

    ``inputs`` are (2, n - 1, 3) parabolas of set-point, or drive, and of its derivative by the
    delay; ``zero`` is the encoder's in rad.
    """
    step = float(grid[1] - grid[0])
    setpoint, late = inputs[0] @ _SIMPSON, inputs[1] @ _SIMPSON
    servo = log.servo if log.closed else None
    slews = servo is not None and servo.rule.structure is LawStructure.PID
    if servo is not None and slews and math.isfinite(servo.speed_limit):
        setpoint, late = kernel.slewed(setpoint, late, servo.speed_limit * step)
    enabled = None if log.enabled is None else _on_grid(log, log.enabled, grid)
    return _told(
        servo,
        parameters,
        zero=zero,
        period=every * step,
        every=every,
        columns=(setpoint, late, _supply(log, servo, grid), enabled),
    )


def _on_grid(log: Log, column: Samples, grid: Samples) -> Samples:
    """(n - 1,) means of a column that is held from stamp to stamp."""
    return hold.mean(log.time, column, grid, log.intersample)


def _supply(log: Log, servo: ServoLoop | None, grid: Samples | None) -> Samples | float:
    """(n,) volts by which a duty is multiplied; 1 of what is no duty, or has no supply."""
    if servo is None or servo.rule.output is not Output.DUTY:
        return 1.0
    if log.supply is None:
        return servo.supply or 1.0
    return log.supply if grid is None else _on_grid(log, log.supply, grid)


def _told(
    servo: ServoLoop | None,
    parameters: LumpedParameters | None,
    *,
    zero: float,
    period: float,
    every: int,
    columns: tuple[Samples, Samples, Samples | float, Samples | None],
) -> Loop:
    """Return the numbers of the kernel; of no servo the drive is as recorded.

    Without ``parameters`` the torque is what the firmware puts out.
    """
    setpoint, late, supply, enabled = columns
    kp, ki, kd = (1.0, 0.0, 0.0) if servo is None else servo.told
    by_p, by_i, by_d = (
        (1.0, 1.0, 1.0)
        if parameters is None
        else (parameters.loop_kp, parameters.loop_ki, parameters.loop_kd)
    )
    emf, drop = (0.0, math.inf) if servo is None else servo.reach
    limit = math.inf
    if servo is not None:
        limit = servo.rule.limit if servo.limit is None else float(servo.limit)
    return Loop(
        structure=kernel.RECORDED if servo is None else _STRUCTURES[servo.rule.structure],
        kp=kp * (1.0 if servo is None else by_p),
        ki=ki * by_i,
        kd=kd * by_d,
        told_kp=0.0 if servo is None else kp,
        told_ki=ki,
        told_kd=kd,
        limit=limit,
        speed_limit=math.inf if servo is None else float(servo.speed_limit),
        dead_band=0.0 if servo is None else float(servo.dead_band),
        slew=math.inf if servo is None else float(servo.slew) * period,
        period=period,
        every=every,
        lead=0.0 if servo is None else max(period - servo.period, 0.0) / 2,
        emf=float(emf),
        drop=float(drop),
        zero=zero,
        p4=1.0 if parameters is None else parameters.p4,
        dead_zone=0.0 if parameters is None else parameters.dead_zone,
        compression=0.0 if parameters is None else parameters.compression,
        setpoint=setpoint,
        late=late,
        supply=np.full(setpoint.size, 1.0) * supply,
        on=np.ones(setpoint.size) if enabled is None else np.rint(enabled),
    )


def driven(log: Log) -> Log:
    """Return the log of a servo with its drive as input, rebuilt if it was not recorded.

    The input of a set-point becomes what the law makes of it at each sample, V where the supply of
    a duty is known. A recorded duty is multiplied by a recorded supply.
    """
    servo = log.servo
    if log.input_kind is InputKind.DUTY and log.supply is not None:
        return replace(log, input=log.input * log.supply, input_kind=InputKind.VOLTAGE)
    if log.input_kind is not InputKind.SETPOINT or servo is None:
        return log
    supplied = log.supply is not None or servo.supply is not None
    kind = _DRIVES[servo.rule.output]
    kind = InputKind.VOLTAGE if kind is InputKind.DUTY and supplied else kind
    nothing = np.zeros(log.time.size)
    setpoint = log.input
    if servo.rule.structure is LawStructure.PID and math.isfinite(servo.speed_limit):
        setpoint, _ = kernel.slewed(setpoint, nothing, servo.speed_limit * log.mean_step)
    told = _told(
        replace(servo, clock=log.mean_step),
        None,
        zero=0.0,
        period=log.mean_step,
        every=1,
        columns=(setpoint, nothing, _supply(log, servo, None), log.enabled),
    )
    drive = kernel.outputs(log.angle, _rate(log), told)
    lead = log.lead
    if lead is not None:
        lead = replace(lead, input=np.full(lead.time.size, drive[0]), setpoint=lead.input)
    return replace(
        log, input=drive, setpoint=log.input, input_kind=kind, excitation=None, lead=lead
    )


def _rate(log: Log) -> Samples:
    """(n,) velocities in rad/s: as recorded, or slopes of local parabolas."""
    if log.velocity is not None:
        return log.velocity
    grid = uniform_grid(log.time)
    step = float(grid[1] - grid[0])
    reach = min(max(round(_REACH / step), 1), (grid.size - 1) // 2)
    slopes = polynomials.slope(resample(log.time, log.angle, grid), reach, 2, step)
    return np.interp(log.time, grid, slopes)
