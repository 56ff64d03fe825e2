"""A geared servo in its firmware's loop, simulated with no code of the program.

The joint is that of `tests.independent.integrator` at 100 us; its motor gives nothing where the
torque is disabled: the bridge is open. The firmware looks at the joint at its own clock, through an
encoder of counts, and holds its output from ``late`` after the look to ``late`` after the next. The
host writes a goal and reads the angle at stamps of its own clock; a goal arrives ``delay`` later.
Duty is multiplied by a supply that sags with the current. The laws (`tests.independent.servos`
makes SI units of theirs):

- ``dynamixel-x``, position: pwm = P/128 e + I/65536 sum e + D/16 (e - last e), e in counts, duty =
  pwm/885 (ROBOTIS e-manual, X series, "Position PID Gain(80, 82, 84)", "Goal PWM(100)"; an XL330
  divides P by 256, Rhoban/bam bam/dynamixel/actuator.py); its integral stops while clipped.
- ``dynamixel-x-velocity``: pwm = P/128 e + I/65536 sum e, e in 0.229 rev/min ("Velocity PI Gain(76,
  78)").
- ``feetech-sts``: duty = 0.166 P e within 0.97, less damping, a dead zone in counts (Rhoban/bam
  bam/feetech/actuator.py, by oscilloscope; memory table 21-27; what its D is worth is not
  published).

How a Dynamixel and a Feetech find a rate is not published either: a filtered difference here.

- ``odrive``: vel = clip(pos_gain e), torque = vel_gain (vel - rate) + integral, whose integral
  decays by 1 % a tick while clipped; a PLL of 1000 rad/s reads the encoder
  (odriverobotics/ODrive f9b5419 Firmware/MotorControl/controller.cpp, encoder.cpp).
- ``moteus``: torque = kp e - kd rate, clipped (mjbots/moteus db1a762 fw/pid.h, docs/reference/
  theory.md); a PLL of 400 Hz.
"""

import math
from typing import NamedTuple

import numba
import numpy as np

from tests.independent.integrator import advance

STEP = 1e-4
"""Longest step in s."""

PID, DAMPED, CASCADE, VELOCITY = range(4)
"""What firmware does: D of the error, D of the rate, a speed asked for, or a speed followed."""

_SHARE = 0.3  # of a new difference in a filtered one
_DECAY = 0.99  # of a cascade's integral in a tick, while clipped


class Firmware(NamedTuple):
    """Its law, gains per rad, rad s and rad/s, and how it looks and acts."""

    law: int
    period: float  # s
    count: float  # rad, of the encoder
    limit: float
    p: float = 0.0
    i: float = 0.0
    d: float = 0.0
    speed_limit: float = np.inf
    dead_zone: float = 0.0  # rad, within which nothing is done
    phase: float = 0.0  # s, of its first look
    late: float = 0.0  # s, from a look to the drive
    delay: float = 0.0  # s, from the host's write to the firmware
    zero: float = 0.0  # rad, that the encoder reads at angle 0
    bandwidth: float = 0.0  # rad/s, of the PLL that makes rate and angle; 0: a filtered difference
    supply: float = 0.0  # V; 0 where the output is a torque
    sag: float = 0.0  # V per unit of duty and N m


def run(servo, firmware, plan, angle=0.0):
    """Return (n,) readings in rad, mean drives until the next stamp, supplies in V, and angles.

    ``plan`` is (n,) stamps in s, goals, and where the torque is enabled.
    """
    columns = tuple(np.asarray(column, dtype=np.float64) for column in plan)
    limp = servo._replace(gain=0.0, back_emf=0.0)
    return _run((servo, limp), firmware, columns, float(angle))


@numba.njit(cache=True)
def _run(servos, firmware, plan, angle):
    (servo, limp), (stamps, goals, enabled) = servos, plan
    n = stamps.size
    readings, drives, supplies, angles = np.empty(n), np.zeros(n), np.empty(n), np.empty(n)
    ticks = int((stamps[-1] - stamps[0]) / firmware.period) + 2
    outputs, memory = np.zeros(ticks), np.zeros(5)
    memory[2] = _reading(firmware, angle)
    state, now = (angle, 0.0, 0.0, 0.0), stamps[0]
    looked = acted = arrived = 0  # looks, outputs and goals so far
    row, goal, on, duty = 0, goals[0], enabled[0] > 0.0, 0.0
    while row < n:
        look = stamps[0] + firmware.phase + looked * firmware.period
        act = np.inf
        if acted < looked:
            act = stamps[0] + firmware.phase + acted * firmware.period + firmware.late
        come = stamps[arrived] + firmware.delay if arrived < n else np.inf
        then = min(look, act, come, stamps[row])
        supply = _supply(servo, firmware, duty, state[1])
        drive = duty * supply if on else 0.0
        steps = max(1, math.ceil((then - now) / STEP))
        for _ in range(steps):
            load = servo.gain * drive, 1.0
            state = advance(servo if on else limp, state, load, (then - now) / steps)
        if row > 0:
            drives[row - 1] += drive * (then - now)
        now = then
        if come == now:
            goal, on, arrived = goals[arrived], enabled[arrived] > 0.0, arrived + 1
            if not on:
                outputs[acted:looked] = 0.0
                duty = 0.0
        if act == now:
            duty, acted = outputs[acted], acted + 1
        if look == now and looked < ticks:
            outputs[looked] = _output(firmware, goal, _reading(firmware, state[0]), on, memory)
            looked += 1
        if stamps[row] == now:
            readings[row], angles[row] = _reading(firmware, state[0]), state[0]
            supplies[row] = _supply(servo, firmware, duty, state[1])
            row += 1
    drives[:-1] /= np.diff(stamps)
    return readings, drives, supplies, angles


@numba.njit(cache=True)
def _reading(firmware, x):
    return firmware.count * np.rint((x + firmware.zero) / firmware.count)


@numba.njit(cache=True)
def _supply(servo, firmware, duty, v):
    """What a duty is multiplied by: a supply that the current pulls down, or 1 of a torque."""
    if firmware.supply == 0.0:
        return 1.0
    torque = servo.gain * duty * firmware.supply - servo.back_emf * v
    return firmware.supply - firmware.sag * abs(duty * torque)


@numba.njit(cache=True)
def _output(firmware, goal, reading, on, memory):
    """Return the duty or torque of a look; ``memory``: integral, last error, angle and rate
    as seen, started."""
    _look(firmware, reading, memory)
    if not on:
        memory[0] = memory[4] = 0.0
        return 0.0
    rate, seen = memory[3], memory[2]
    error = goal - (rate if firmware.law == VELOCITY else seen)
    change = error - memory[1] if memory[4] > 0.0 else 0.0
    memory[1], memory[4] = error, 1.0
    if abs(error) <= firmware.dead_zone:
        error = 0.0
    if firmware.law == CASCADE:
        wanted = min(max(firmware.p * error, -firmware.speed_limit), firmware.speed_limit)
        error = wanted - rate
        raw = firmware.d * error + memory[0]
    elif firmware.law == PID:
        raw = firmware.p * error + memory[0] + firmware.d * change / firmware.period
    elif firmware.law == DAMPED:
        raw = firmware.p * error + memory[0] - firmware.d * rate
    else:
        raw = firmware.p * error + memory[0]
    out = min(max(raw, -firmware.limit), firmware.limit)
    if out == raw or (firmware.law != CASCADE and error * raw < 0.0):
        memory[0] += firmware.i * firmware.period * error
    elif firmware.law == CASCADE:
        memory[0] *= _DECAY
    return out


@numba.njit(cache=True)
def _look(firmware, reading, memory):
    """Follow the readings by a critically damped loop of second order, or as they are."""
    if firmware.bandwidth == 0.0:
        slope = (reading - memory[2]) / firmware.period
        memory[2], memory[3] = reading, memory[3] + _SHARE * (slope - memory[3])
        return
    memory[2] += firmware.period * memory[3]
    gap = reading - memory[2]
    memory[2] += 2.0 * firmware.bandwidth * firmware.period * gap
    memory[3] += firmware.bandwidth**2 * firmware.period * gap
