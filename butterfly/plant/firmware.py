"""Firmware of a simulated servo: the law of `model.kernel.servo_loop`, update by update."""

from __future__ import annotations

import math

import numpy as np

from butterfly.arrays import Samples
from butterfly.model.kernel.servo_loop import MEMORY, Loop, slewed, torque
from butterfly.model.parameters import LumpedParameters
from butterfly.model.servo import LawStructure, ServoLoop
from butterfly.plant.joints import Joint
from butterfly.signals.excitations import Table

Spans = tuple[tuple[float, float], ...]
"""Pairs of start and end times in s between which a servo is off."""

_ROUNDING = 1e-9  # of a period, by which sums of durations miss an update


class Firmware:
    """Drives a joint, in MuJoCo or not, by a servo loop; its output is held between updates."""

    def __init__(self, loop: Loop) -> None:
        self._loop = loop
        self.start()

    def start(self) -> None:
        """Get ready at time 0."""
        self._memory, self._torque, self._is_on = np.zeros(MEMORY), 0.0, math.nan

    @property
    def command(self) -> float:
        """Present command of the drive."""
        return self._torque / self._loop.p4

    def update(self, joint: Joint, k: int = 0) -> None:
        """Sample a joint at the start of interval k."""
        loop = self._loop
        if loop.on[k] != self._is_on:
            self._is_on = loop.on[k]
            joint.open_circuit(not self._is_on)
        state = (joint.angle, joint.velocity, 0.0, 0.0)
        self._torque = torque(k, state, loop, self._memory, self._torque, None)


class Servo(Firmware):
    """A servo that follows a setpoint at the clock of its firmware, unless it is off.

    It measures the true state of its joint, without an encoder.
    """

    def __init__(
        self,
        servo: ServoLoop,
        parameters: LumpedParameters,
        torque_off: Spans,
        supply: Table | None,
    ) -> None:
        self._servo, self._torque_off, self._supply = servo, torque_off, supply
        columns = (np.zeros(1), np.zeros(1), None, np.ones(1))
        super().__init__(Loop.of(servo, parameters, period=servo.period, columns=columns))

    def start(self) -> None:
        """Get ready at time 0."""
        super().start()
        self._updates, self._goal = 0, math.nan

    def advance(self, joint: Joint, setpoint: float, begin: float, end: float) -> None:
        """Simulate a joint between two instants in s with a setpoint."""
        self._loop.on[0] = is_on(self._torque_off, np.array(begin))
        if self._supply is not None:
            self._loop.supply[0] = self._supply.sample(np.array(begin))
        margin = _ROUNDING * self._servo.period
        while (due := self._updates * self._servo.period) < end - margin:
            if due > begin + margin:
                joint.advance(self.command, due - begin)
                begin = due
            self._loop.setpoint[0] = self._goal = self._slewed(setpoint)
            self.update(joint)
            self._updates += 1
        joint.advance(self.command, end - begin)

    def _slewed(self, setpoint: float) -> float:
        servo = self._servo
        if servo.rule.structure is not LawStructure.PID or math.isnan(self._goal):
            return setpoint
        both = np.array([self._goal, setpoint])
        return float(slewed(both, both, servo.speed_limit * servo.period)[0][1])


def is_on(torque_off: Spans, time: Samples) -> Samples:
    """Return (n,) numbers: 1.0 at instants in s at which a servo is on, else 0.0."""
    off = [(time >= begin) & (time < end) for begin, end in torque_off]
    return np.asarray(1.0 - np.any(off, axis=0))
