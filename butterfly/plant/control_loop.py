"""Run a control law against any motor, and get a log."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from butterfly.errors import InputError
from butterfly.logs.log import Intersample, Log
from butterfly.plant.motor import LARGEST_ANGLE, Motor, Reading
from butterfly.plant.sensors import Clock, filtered_difference, stamps_of

ControlLaw = Callable[[Reading], float]
Signal = Callable[[NDArray[np.float64]], NDArray[np.float64]]
Sample = tuple[float, float, float]  # stamp in s, command as it was set, angle in rad as read


class ControlLoop:
    """A motor under control: starts it on entering, stops it on leaving, come what may.

    Parameters
    ----------
    motor
        Real or simulated.
    clock
        Of the loop.
    rng
        Source of the clock's jitter.
    """

    def __init__(
        self, motor: Motor, *, clock: Clock = Clock(), rng: np.random.Generator | None = None
    ) -> None:
        self._motor = motor
        self._clock = clock
        self._rng = rng or np.random.default_rng(0)

    def __enter__(self) -> ControlLoop:
        self._motor.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._motor.stop()

    def run(self, law: ControlLaw, duration: float, **about: Any) -> Log:  # noqa: ANN401
        """Read, let the law decide, command, wait for the next cycle; and so on.

        Parameters
        ----------
        law
            From a reading to a command, V or units of torque.
        duration
            In s.
        about
            Fields of the log that describe the run: ``added_mass``, ``excitation``, ``source``.

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
        return self._recorded(self._samples(law, self._clock.cycles(duration, self._rng)), about)

    def play(self, signal: Signal, duration: float, **about: Any) -> Log:  # noqa: ANN401
        """Command a signal, from (n,) stamps in s to (n,) commands, at the cycles' planned stamps.

        The rest is as in `run`.
        """
        return self._recorded(self.samples(signal, duration), about)

    def samples(self, signal: Signal, duration: float) -> Iterator[Sample]:
        """Yield the samples of `play` one by one, each when its cycle begins."""
        cycles = self._clock.cycles(duration, self._rng)
        commands = iter(signal(stamps_of(cycles)).tolist())
        return self._samples(lambda _: next(commands), cycles)

    def _samples(self, law: ControlLaw, cycles: NDArray[np.float64]) -> Iterator[Sample]:
        motor = self._motor
        for cycle in [*cycles.tolist(), 0.0]:
            reading = motor.read()
            yield reading.time, motor.command(law(reading)), reading.angle
            if cycle > 0:
                motor.wait(cycle)

    def _recorded(self, samples: Iterator[Sample], about: dict[str, Any]) -> Log:
        stamps, commands, angles = [], [], []  # of numbers, which the garbage collector ignores
        for stamp, command, angle in samples:
            stamps.append(stamp)
            commands.append(command)
            angles.append(angle)
        columns = np.array(stamps), np.array(commands), np.array(angles)
        return recorded(*columns, input_kind=self._motor.input_kind, **about)


def recorded(
    time: NDArray[np.float64],
    inputs: NDArray[np.float64],
    angle: NDArray[np.float64],
    *,
    source: str = "bench",
    **about: Any,  # noqa: ANN401 - the other fields of Log
) -> Log:
    """Make the log of a controller that held each input until the next (zero-order hold)."""
    if not (np.abs(angle) < LARGEST_ANGLE).all():
        raise InputError(source, "angle", "a joint that diverged", "smaller commands")
    return Log(
        time=time,
        input=inputs,
        angle=angle,
        velocity=filtered_difference(time, angle),
        intersample=Intersample.ZERO_ORDER_HOLD,
        source=source,
        **about,
    )
