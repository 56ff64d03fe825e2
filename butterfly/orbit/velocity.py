"""Velocity of the joint from encoder readings, inside a running control loop."""

from __future__ import annotations

import math
from typing import Protocol

from butterfly.errors import require_number
from butterfly.model.kinematics import Motion
from butterfly.model.parameters import LumpedParameters, compressed
from butterfly.model.terms import CONSERVATIVE, DISSIPATIVE, torque_of

_STANDSTILL = 1e-3  # rad/s, below which friction has no sign
_STATIC = (*CONSERVATIVE, *DISSIPATIVE)


class VelocityEstimator(Protocol):
    """Gives the velocity at each reading; its lag is stated in s."""

    @property
    def lag(self) -> float:
        """Time in s by which the velocity is late, at low frequencies."""
        ...

    def update(self, time: float, angle: float, command: float) -> float:
        """Return the velocity in rad/s; ``command`` was held since the reading before."""
        ...


class FilteredDifference:
    """Backward difference and a first-order low pass.

    Parameters
    ----------
    time_constant
        Of the low pass in s.
    step
        Of the control loop in s, for `lag` only.
    """

    def __init__(self, time_constant: float = 0.003, step: float = 0.001) -> None:
        require_number("FilteredDifference", positive=True, time_constant=time_constant, step=step)
        self._constant = time_constant
        self._step = step
        self._last: tuple[float, float] | None = None
        self._velocity = 0.0

    @property
    def lag(self) -> float:
        """Time constant and half a step."""
        return self._constant + 0.5 * self._step

    def update(self, time: float, angle: float, command: float) -> float:  # noqa: ARG002 - not needed here
        """Return the velocity in rad/s."""
        if self._last is not None and time > self._last[0]:
            step = time - self._last[0]
            keep = math.exp(-step / self._constant)
            self._velocity = keep * self._velocity + (1 - keep) * (angle - self._last[1]) / step
        self._last = (time, angle)
        return self._velocity


class Observer:
    """Luenberger's observer with the model: without lag where the model is right.

    The delay, the armature's lag and bristles are left out of it.

    Parameters
    ----------
    parameters
        Of the hand with what it carries.
    zero
        Encoder reading in rad where the model's angle is 0.
    bandwidth
        In rad/s; both poles of the error are there. Encoder noise s is amplified to about
        2 bandwidth s per reading.
    """

    def __init__(
        self, parameters: LumpedParameters, zero: float = 0.0, bandwidth: float = 60.0
    ) -> None:
        require_number("Observer", positive=True, bandwidth=bandwidth)
        self._p = parameters
        self._zero = zero
        self._gains = (2 * bandwidth, bandwidth**2)
        self._time: float | None = None
        self._angle = self._velocity = 0.0

    @property
    def lag(self) -> float:
        """None, by design."""
        return 0.0

    def update(self, time: float, angle: float, command: float) -> float:
        """Return the velocity in rad/s."""
        angle -= self._zero
        if self._time is None:
            self._angle = angle
        else:
            p, step = self._p, time - self._time
            error = angle - self._angle
            motion = Motion.of(p, self._angle, self._velocity)
            if abs(self._velocity) <= _STANDSTILL:
                motion = motion._replace(direction=0.0)
            delivered = compressed(command, p.compression)
            torque = p.p4 * delivered - torque_of(p, motion, _STATIC)
            rate = torque / p.p1 + self._gains[1] * error
            self._angle += step * (self._velocity + 0.5 * step * rate + self._gains[0] * error)
            self._velocity += step * rate
        self._time = time
        return self._velocity
