"""Run a control law against any motor, and get a log."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from butterfly.errors import InputError
from butterfly.logs.log import Intersample, Log
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass
from butterfly.plant.sensors import Clock, filtered_difference

if TYPE_CHECKING:
    from collections.abc import Callable

    from butterfly.logs.log import Sine
    from butterfly.plant.motor import Motor, Reading

    ControlLaw = Callable[[Reading], float]


class Bench:
    """A motor under control: starts it on entering, stops it on leaving, come what may.

    Parameters
    ----------
    motor
        Real or simulated.
    clock
        Of the control loop.
    rng
        Source of the clock's jitter.
    """

    def __init__(
        self, motor: Motor, *, clock: Clock = Clock(), rng: np.random.Generator | None = None
    ) -> None:
        self._motor = motor
        self._clock = clock
        self._rng = rng or np.random.default_rng(0)

    def __enter__(self) -> Bench:
        self._motor.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._motor.stop()

    def run(
        self,
        law: ControlLaw,
        duration: float,
        *,
        added_mass: AddedMass = NO_ADDED_MASS,
        excitation: Sine | None = None,
        source: str = "bench",
    ) -> Log:
        """Read, let the law decide, command, wait for the next cycle; and so on.

        Parameters
        ----------
        law
            From a reading to a command, V or units of torque.
        duration
            In s.
        added_mass, excitation, source
            What the log is to say about the run.

        Returns
        -------
        Log
            Of stamps, commands as they were set, and angles as they were read. Its velocity is
            the filtered difference of the angles.

        Raises
        ------
        InputError
            If ``duration`` is not positive, or law or joint yield a value that is not finite.
        """
        if not (math.isfinite(duration) and duration > 0):
            raise InputError("bench", "duration", duration, "a finite positive number of s")
        cycles = self._clock.cycles(duration, self._rng).tolist()
        motor = self._motor
        stamps, commands, angles = [], [], []
        for cycle in [*cycles, 0.0]:
            reading = motor.read()
            stamps.append(reading.time)
            angles.append(reading.angle)
            commands.append(motor.command(law(reading)))
            if cycle > 0:
                motor.wait(cycle)
        time, angle = np.array(stamps), np.array(angles)
        if not np.isfinite(angle).all():
            raise InputError(source, "angle", "a joint that diverged", "smaller commands")
        return Log(
            time=time,
            input=np.array(commands),
            angle=angle,
            velocity=filtered_difference(time, angle),
            input_kind=motor.input_kind,
            intersample=Intersample.ZERO_ORDER_HOLD,
            added_mass=added_mass,
            excitation=excitation,
            source=source,
        )
