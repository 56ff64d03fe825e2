"""The firmware of a simulated servo: the law of `butterfly.model.kernel.loop`, update by update."""

from __future__ import annotations

import math

import numpy as np

from butterfly.arrays import Samples
from butterfly.model.kernel.loop import MEMORY, Loop, slewed, torque
from butterfly.model.parameters import LumpedParameters
from butterfly.model.servo import LawStructure, Output, ServoLoop
from butterfly.plant.joints import Joint

Spans = tuple[tuple[float, float], ...]
"""Pairs of instants in s, from one to before the other of which a servo is off."""

_ROUNDING = 1e-9  # of a period, by which sums of durations miss an update


class Firmware:
    """Drives a joint, in MuJoCo or not, as a loop says; its output is held in between."""

    def __init__(self, loop: Loop) -> None:
        self.loop = loop
        self._memory, self._torque, self._is_on = np.zeros(MEMORY), 0.0, math.nan

    @property
    def command(self) -> float:
        """What the drive is told now."""
        return self._torque / self.loop.p4

    def update(self, joint: Joint, k: int = 0) -> None:
        """Look at a joint at the start of interval k."""
        loop = self.loop
        if loop.on[k] != self._is_on:
            self._is_on = loop.on[k]
            joint.open_circuit(not self._is_on)
        state = (joint.angle, joint.velocity, 0.0, 0.0)
        self._torque = torque(k, state, loop, self._memory, self._torque, None)


def is_on(torque_off: Spans, time: Samples) -> Samples:
    """Return where, of (n,) instants in s, a servo is not off."""
    off = [(time >= begin) & (time < end) for begin, end in torque_off]
    return np.asarray(1.0 - np.any(off, axis=0))


class Servo:
    """A servo that follows a set-point by the clock of its own firmware, unless it is off.

    It sees its joint as it is, without an encoder.
    """

    def __init__(
        self, servo: ServoLoop, parameters: LumpedParameters, torque_off: Spans = ()
    ) -> None:
        self._servo, self._parameters, self._torque_off = servo, parameters, torque_off
        self.start()

    def start(self) -> None:
        """Get ready at time 0."""
        servo, one = self._servo, np.zeros(1)
        supply = (servo.supply or 1.0) if servo.rule.output is Output.DUTY else 1.0
        columns = (one, one, supply, np.ones(1))
        loop = Loop.of(servo, self._parameters, period=servo.period, columns=columns)
        self._firmware, self._updates = Firmware(loop), 0
        self._now, self._goal = 0.0, math.nan
        self._is_on = 1.0

    @property
    def command(self) -> float:
        """What the drive is told now."""
        return self._firmware.command

    def hear(self, time: float) -> None:
        """Be told at an instant in s whether to be off."""
        if self._torque_off:
            self._is_on = float(is_on(self._torque_off, np.array(time)))

    def advance(self, joint: Joint, setpoint: float, duration: float) -> None:
        """Move a joint on for ``duration`` s with a set-point."""
        period = self._servo.period
        end, margin = self._now + duration, _ROUNDING * period
        while (due := self._updates * period) < end - margin:
            if due > self._now + margin:
                joint.advance(self.command, due - self._now)
                self._now = due
            self._look(joint, setpoint)
            self._updates += 1
        joint.advance(self.command, end - self._now)
        self._now = end

    def _look(self, joint: Joint, setpoint: float) -> None:
        servo, loop = self._servo, self._firmware.loop
        if servo.rule.structure is LawStructure.PID and not math.isnan(self._goal):
            both = np.array([self._goal, setpoint])
            setpoint = slewed(both, both, servo.speed_limit * servo.period)[0][1]
        loop.setpoint[0], loop.on[0] = setpoint, self._is_on
        self._goal = setpoint
        self._firmware.update(joint)
