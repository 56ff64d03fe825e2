"""The interface of a control law to a real or simulated joint, and the control loop."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import chain
from typing import Any, NamedTuple, Protocol

import numpy as np

from butterfly.arrays import Samples
from butterfly.errors import InputError, require_number
from butterfly.logs.log import InputKind, Intersample, Log
from butterfly.model.terms import DriveTerms
from butterfly.plant.sensors import Clock, filtered_difference, rounded, stamps_of

LARGEST_COMMAND = 1e10
"""In units of the command; MuJoCo accepts no larger one."""

LARGEST_ANGLE = 1e5
"""In rad, sixteen thousand turns: beyond it, a joint has diverged."""

_USABLE = f"a number smaller than {LARGEST_COMMAND:g}"


class Reading(NamedTuple):
    """A measurement: time in s, angle in rad, current in A (NaN if not measured)."""

    time: float
    angle: float
    current: float


ControlLaw = Callable[[Reading], float]
Signal = Callable[[Samples], Samples]
Sample = tuple[float, float, float]  # timestamp in s, command as set, angle in rad as read


class Motor(Protocol):
    """A joint that takes commands: any object with these methods, including hardware.

    The command is held until the next one (zero-order hold).
    """

    @property
    def input_kind(self) -> InputKind:
        """Kind of the command: V or units of torque."""

    def start(self) -> None:
        """Prepare at time 0, with command 0."""

    def stop(self) -> None:
        """Release the joint; always called at the end of a run."""

    def command(self, value: float) -> float:
        """Set the command; return it as set (saturated, rounded)."""

    def read(self) -> Reading:
        """Read clock and sensors now."""

    def wait(self, duration: float) -> None:
        """Let ``duration`` s pass."""


@dataclass(frozen=True, kw_only=True)
class CommandPath(DriveTerms):
    """The path from a command to the motor's terminals.

    A dead zone, in units of the command, and a compression c, in 1/unit, do not show in the log:
    the drive gives v/(1 + c |v|), with v the command beyond the dead zone.
    """

    limit: float = math.inf
    """Saturation, in units of the command."""
    resolution: float = 0.0
    """Step to which a command is rounded; 0 for none."""
    delay: float = 0.0
    """In s, from command to terminals."""

    def __post_init__(self) -> None:
        if not self.limit > 0:
            raise InputError("CommandPath", "limit", self.limit, "a positive number")
        others = {name: value for name, value in vars(self).items() if name != "limit"}
        require_number("CommandPath", **others)

    def shape(self, value: float) -> float:
        """Return the command after the path: rounded, then saturated."""
        if not abs(value) < LARGEST_COMMAND:
            raise InputError("control law", "command", value, _USABLE)
        if self.resolution > 0:
            value = self.resolution * round(value / self.resolution)
        return value if abs(value) <= self.limit else math.copysign(self.limit, value)

    def shape_all(self, values: Samples) -> Samples:
        """Return (n,) commands after the path."""
        usable = np.abs(values) < LARGEST_COMMAND
        if not usable.all():
            raise InputError("control law", "command", values[~usable][0], _USABLE)
        if self.resolution > 0:
            values = self.resolution * rounded(values / self.resolution)
        return np.clip(values, -self.limit, self.limit)


class ReplayMotor:
    """A recorded log in place of a motor: it returns the recorded angles for any command.

    Shows what a controller, an observer or an estimator would have done with these measurements.
    """

    def __init__(self, log: Log) -> None:
        self._log = log
        self._time = 0.0

    @property
    def input_kind(self) -> InputKind:
        """Kind of the log's input."""
        return self._log.input_kind

    def start(self) -> None:
        """Go back to the first sample."""
        self._time = 0.0

    def stop(self) -> None:
        """Do nothing: nothing moves."""

    def command(self, value: float) -> float:
        """Ignore the command; return it."""
        return value

    def read(self) -> Reading:
        """Return the recorded angle."""
        time = self._log.time
        angle = float(np.interp(self._time + time[0], time, self._log.angle))
        return Reading(self._time, angle, math.nan)

    def wait(self, duration: float) -> None:
        """Move on in the log, which must be long enough."""
        self._time += duration
        length = float(self._log.time[-1] - self._log.time[0])
        if self._time > length * (1 + 1e-9):
            raise InputError(self._log.source, "time", f"{length:.6g} s", "a longer log")


class ControlLoop:
    """A motor under control: started on entering, always stopped on leaving."""

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
        """Repeat for ``duration`` s: read, command what the law returns, wait for the next cycle.

        ``about`` are fields of the log that describe the run. Commands are logged as set, angles as
        read; the velocity is the filtered difference of the angles.
        """
        return self._recorded(self._samples(law, self._clock.cycles(duration, self._rng)), about)

    def play(self, signal: Signal, duration: float, **about: Any) -> Log:  # noqa: ANN401
        """Command a signal at (n,) planned timestamps in s; otherwise like `run`."""
        return self._recorded(self.samples(signal, duration), about)

    def samples(self, signal: Signal, duration: float) -> Iterator[Sample]:
        """Yield the samples of `play`, each at the beginning of its cycle."""
        cycles = self._clock.cycles(duration, self._rng)
        commands = iter(signal(stamps_of(cycles)).tolist())
        return self._samples(lambda _: next(commands), cycles)

    def _samples(self, law: ControlLaw, cycles: Samples) -> Iterator[Sample]:
        read, command, wait = self._motor.read, self._motor.command, self._motor.wait
        for cycle in [*cycles.tolist(), 0.0]:
            reading = read()
            yield reading.time, command(law(reading)), reading.angle
            if cycle > 0:
                wait(cycle)

    def _recorded(self, samples: Iterator[Sample], about: dict[str, Any]) -> Log:
        numbers = np.fromiter(chain.from_iterable(samples), np.float64).reshape(-1, 3)
        return recorded(
            *np.ascontiguousarray(numbers.T), input_kind=self._motor.input_kind, **about
        )


def recorded(
    time: Samples,
    inputs: Samples,
    angle: Samples,
    *,
    source: str = "bench",
    **about: Any,  # noqa: ANN401 - the other fields of Log
) -> Log:
    """Return the log of a controller that holds each input until the next (zero-order hold)."""
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
