"""Energy shaping: pump or brake until the hand moves with the energy of an orbit (103), (109)."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Protocol

import numpy as np

from butterfly.errors import InputError, require_number
from butterfly.model.energy import Orbit, potential
from butterfly.model.parameters import LumpedParameters
from butterfly.model.terms import CONSERVATIVE, DISSIPATIVE, TERMS, made_up, torque_of
from butterfly.plant.motor import ControlLaw, Reading
from butterfly.plant.sensors import FilteredDifference

Target = Callable[[LumpedParameters], Orbit]

_FRICTION = tuple(row for row in DISSIPATIVE if row.name != "p2")
_STARTED = 0.01  # share of the wanted kinetic energy above which the hand needs no kick
_LEAST_GAIN = 0.1  # share of its gain that a drive is believed to keep at any command
_SINES = 12  # of a dither
_ANGLES = 361  # of a turn, where its potential is looked at
_STANDSTILL = 1e-3  # rad/s, below which Coulomb friction has no sign and is not compensated
_STATIC = (*CONSERVATIVE, *DISSIPATIVE)


def gain_for(orbit: Orbit, multiplier: float) -> float:
    """Return gamma with which perturbations shrink to ``multiplier`` of themselves in a period.

    The Floquet multiplier is exp(-p4 gamma oint thd^2 dt), from (114) over a period.
    """
    if not 0 < multiplier < 1:
        raise InputError("orbit", "multiplier", multiplier, "between 0 and 1")
    return -math.log(multiplier) / (abs(orbit.parameters.p4) * orbit.squared_speed)


class VelocityEstimator(Protocol):
    """Gives the velocity at each reading, as `FilteredDifference` and `Observer` do."""

    def update(self, time: float, angle: float, command: float) -> float:
        """Return the velocity in rad/s; ``command`` was held since the reading before."""
        ...


class Observer:
    """Luenberger's observer with the model: without lag where the model is right.

    Delay, armature's lag and bristles are left out of it. The parameters are of the hand with what
    it carries; ``zero`` is the encoder reading in rad where the model's angle is 0. Both poles are
    at the ``bandwidth`` in rad/s, which amplifies encoder noise s to about 2 bandwidth s.
    """

    def __init__(
        self, parameters: LumpedParameters, zero: float = 0.0, bandwidth: float = 60.0
    ) -> None:
        require_number("Observer", positive=True, bandwidth=bandwidth)
        self._p, self._zero = parameters, zero
        self._gains = (2 * bandwidth, bandwidth**2)
        self._time: float | None = None
        self._angle = self._velocity = 0.0

    def update(self, time: float, angle: float, command: float) -> float:
        """Return the velocity in rad/s."""
        angle -= self._zero
        if self._time is None:
            self._angle = angle
        else:
            p, step = self._p, time - self._time
            error = angle - self._angle
            drive = p.p4 * p.delivered(command)
            motor = drive - p.back_emf * self._velocity
            motion = p.motion(self._angle, self._velocity, motor=motor)
            if abs(self._velocity) <= _STANDSTILL:
                motion = motion._replace(direction=0.0)
            rate = (drive - torque_of(p, motion, _STATIC)) / p.p1 + self._gains[1] * error
            self._angle += step * (self._velocity + 0.5 * step * rate + self._gains[0] * error)
            self._velocity += step * rate
        self._time = time
        return self._velocity


class EnergyShaping:
    """The control law (103) with (109), to be run on a bench.

    v = (p2 thd + T_c sgn thd)/p4 - gamma thd (E - E*) sgn p4, and whatever other friction the
    model has is compensated like T_c. The orbit is that of the hand with what it carries, as
    believed; gamma is in units of the input per rad/s and J. A ``kick`` along the velocity starts a
    hand that stands still, which (109) would leave alone.

    For an orbit that turns over, bias is compensated, too. While the hand moves against the orbit's
    direction, E* is below the top's energy by the factor by which it is above it otherwise.
    """

    def __init__(
        self,
        orbit: Orbit,
        gamma: float,
        *,
        zero: float = 0.0,
        velocity: VelocityEstimator | None = None,
        kick: float = 0.0,
    ) -> None:
        self._velocity = velocity or FilteredDifference()
        self._zero, self._kick, self._command = zero, kick, 0.0
        self.retune(orbit, gamma)

    def retune(self, orbit: Orbit, gamma: float) -> None:
        """Hold another orbit, of other believed parameters, from the next reading on."""
        if not (math.isfinite(gamma) and gamma > 0):
            raise InputError("EnergyShaping", "gamma", gamma, "a positive number")
        self._p = p = orbit.parameters
        self._target, self._direction = orbit.energy, orbit.direction
        levels = potential(orbit.conserving, np.linspace(orbit.lower, orbit.upper, _ANGLES))
        lowest, top = float(levels.min()), float(levels.max())
        self._backwards = lowest + (top - lowest) ** 2 / (orbit.energy - lowest)  # short of the top
        self._gain = math.copysign(gamma, p.p4)
        lost = (*_FRICTION, TERMS["bias"]) if orbit.direction else _FRICTION
        # Looking for the terms that a hand has takes longer than what is left of the law.
        self._stored, self._braked = (
            tuple(row for row in rows if getattr(of, row.name))
            for of, rows in ((orbit.conserving, CONSERVATIVE), (p, lost))
        )

    def __call__(self, reading: Reading) -> float:
        """Return the command for one reading."""
        p = self._p
        speed = self._velocity.update(reading.time, reading.angle, self._command)
        angle = reading.angle - self._zero
        target = self._target if speed * self._direction >= 0 else self._backwards
        kinetic, wanted = 0.5 * p.p1 * speed**2, target - potential(p, angle, self._stored)
        excess = kinetic - wanted
        command = p.p2 / p.p4 * speed - self._gain * speed * excess
        if self._braked and abs(speed) > _STANDSTILL:
            motion = p.motion(angle, speed, motor=p.p4 * command - p.back_emf * speed)
            command += made_up(p, motion, self._braked) / p.p4
        command /= max(1 - p.compression * abs(command), _LEAST_GAIN)
        command += math.copysign(p.dead_zone, command)
        if kinetic < _STARTED * wanted:
            command += math.copysign(self._kick, speed)
        self._command = float(command)
        return self._command


class Dithered:
    """A law with a random sum of sines added, of a given share of the law's own running rms."""

    def __init__(
        self, law: ControlLaw, share: float, omega: float, rng: np.random.Generator
    ) -> None:
        require_number("Dithered", share=share)
        require_number("Dithered", positive=True, omega=omega)
        self._law, self._share = law, share
        self._omega = rng.uniform(0.5, 4.0, _SINES) * omega
        self._phase = rng.uniform(0, 2 * math.pi, _SINES)
        self._rate, self._square, self._time = omega / (2 * math.pi), 0.0, 0.0

    def __call__(self, reading: Reading) -> float:
        """Return the command for one reading."""
        command = self._law(reading)
        fade = math.exp(-self._rate * (reading.time - self._time))
        self._time = reading.time
        self._square = fade * self._square + (1 - fade) * command**2
        sines = float(np.sin(self._omega * reading.time + self._phase).sum())
        return command + self._share * math.sqrt(2 * self._square / _SINES) * sines
