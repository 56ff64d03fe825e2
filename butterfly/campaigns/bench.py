"""A motor kept on through many runs, under guard: limits, a watchdog, a brake, a log of each."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from butterfly.arrays import Samples
from butterfly.campaigns.laws import LAG, STILL, Brake, Law
from butterfly.errors import ButterflyError, require_number
from butterfly.logs.log import InputKind, Log
from butterfly.plant.motor import Motor, Reading, Sample, recorded
from butterfly.plant.sensors import FilteredDifference

_LATE = 0.1  # s between two readings, beyond which the drive was not under control
_LONGEST_STOP = 60.0  # s in which a joint has to come to rest
_RETURN = 5.0  # s in which it has to be near home, or is taken as it is
_NEAR = 0.1  # share of the largest angle that is near
_NOISES = 5.0  # standard deviations of the encoder's noise that are no motion
_FINEST = 5e-4  # rad, below which nothing counts as motion
_LAG = 0.01  # s, of the speed that is guarded


class SafetyStop(ButterflyError):  # noqa: N818 - it is what happens, not only an error
    """The drive was switched off: the joint, its drive or its encoder is not as it should be."""


class TimeUsed(SafetyStop):
    """The robot time is used up."""


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What a run may not exceed; beyond, the joint is braked and the run ends."""

    command: float  # in units of the input
    angle: float = 1.0  # from rest, in rad
    speed: float = math.inf  # rad/s
    current: float = math.inf  # A
    seconds: float = 600.0  # robot time of the whole campaign in s

    def __post_init__(self) -> None:
        require_number("Limits", positive=True, command=self.command, angle=self.angle)
        speed, current = (min(each, 1e9) for each in (self.speed, self.current))
        require_number("Limits", positive=True, seconds=self.seconds, speed=speed, current=current)


class Recording(NamedTuple):
    """What a run recorded: (n,) times in s from its beginning, commands as set, angles as read."""

    time: Samples
    input: Samples
    angle: Samples
    cut: str  # the limit that ended it early; empty if none did
    input_kind: InputKind

    def log(self, **about: Any) -> Log:  # noqa: ANN401 - fields of the log
        """Return its log."""
        about = {"source": "campaign", "input_kind": self.input_kind, **about}
        return recorded(self.time, self.input, self.angle, **about)


@contextmanager
def _answering() -> Iterator[None]:
    """Raise `SafetyStop` if the drive does not answer."""
    try:
        yield
    except OSError as error:
        raise SafetyStop(f"the drive no longer answers: {error}") from error


class Bench:
    """A motor between two runs and during them; a context that always switches the drive off.

    Commands are those of laws times the ``polarity``: 1, or -1 where a positive command turns
    towards negative angles.
    """

    def __init__(self, motor: Motor, limits: Limits, step: float) -> None:
        self._motor, self.limits, self.step = motor, limits, step
        self.polarity, self.used, self.pace = 1, 0.0, math.inf
        """Robot time in s so far is `used`; the joint's resonance in rad/s, if known, the pace."""
        self.noise, self.rest = 0.0, 0.0
        """Of the encoder at rest, in rad: standard deviation, and reading."""
        self.home, self._is_new = 0.0, True
        """Angle in rad of the first rest with the present load: swings count from there."""
        self._brake: tuple[float, float, float] | None = None

    @property
    def input_kind(self) -> InputKind:
        """Kind of the command."""
        return self._motor.input_kind

    def changed(self, change: Callable[[], None]) -> None:
        """Switch the drive off, let the load be changed, and switch it on again."""
        self._is_new = True
        self.__exit__()
        change()
        self.__enter__()

    @_answering()
    def __enter__(self) -> Bench:
        self._motor.start()  # with command 0
        return self

    @_answering()
    def __exit__(self, *_: object) -> None:
        try:
            self._motor.command(0.0)
        finally:
            self._motor.stop()

    @_answering()
    def run(self, law: Law, duration: float, reach: float | None = None) -> Recording:
        """Run a law within ``reach`` rad, or the limit, until it ends.

        That is after ``duration`` s, or when the joint rests after the last command. An infinite
        reach is that of a brake, of which no speed is too large.
        """
        motor, cut, samples = self._motor, "", list[Sample]()
        speed, reach = FilteredDifference(_LAG), reach or self.limits.angle
        begun = last = motor.read().time
        free, window, stands = math.inf, self._window, 0
        while True:
            time, angle, current = motor.read()
            stands = 0 if time > last else stands + 1  # cycles: a clock may be coarse
            in_time = last <= time <= last + _LATE and stands * self.step <= _LATE
            if not (math.isfinite(angle) and in_time):
                motor.command(0.0)
                raise SafetyStop(_said_of_reading(time - last, angle))
            since, last = time - begun, time
            rate = speed.update(time, angle, 0.0)
            swing = math.hypot(angle - self.home, rate / self.pace)  # that it is about to reach
            cut = self._exceeded(swing, reach, rate, current)
            command = None if cut or since > duration else law(Reading(since, angle, current))
            if command is None:
                break
            most = self.limits.command
            sent = motor.command(self.polarity * max(-most, min(most, command)))
            samples.append((since, sent, angle))
            if sent:
                free = since
            elif since - free > window:
                if self._is_still([x for t, _, x in samples if t > since - window]):
                    break
                free = since
            motor.wait(self.step)
        motor.command(0.0)
        if cut and not samples:
            raise SafetyStop(f"{cut} before the run: check joint and drive, and go on")
        self.used += since
        if self.used > self.limits.seconds:
            raise TimeUsed(f"the robot time of {self.limits.seconds:g} s is used up")
        times, inputs, angles = np.array(samples or [(0.0, 0.0, angle)]).T
        return Recording(times, inputs, angles, cut, motor.input_kind)

    def require_motion(self, run: Recording) -> None:
        """Raise `SafetyStop` if a run that was driven did not move the joint."""
        if np.any(run.input != 0) and float(np.ptp(run.angle)) <= 2 * self._motion(self.noise):
            raise SafetyStop(
                "the joint no longer moves when it is driven: check supply, enable, end stops, and "
                "that the encoder has its cable and slips nowhere"
            )

    @property
    def near(self) -> float:
        """Angle in rad about home in which runs begin."""
        return _NEAR * self.limits.angle

    def braked_with(self, size: float, speed: float, width: float = math.inf) -> None:
        """Brake from now on with a command of a size, full from a speed in rad/s on.

        Full too from ``width`` rad away from home on, back to there.
        """
        self._brake = size, max(_FINEST / LAG, _NOISES * self.noise / LAG, speed), width or math.inf

    def settle(self) -> None:
        """Bring the joint home and wait until it rests; measure where, and the encoder's noise."""
        begun, length = self.used, self._window
        while (passed := self.used - begun) < _LONGEST_STOP:
            if self._brake is not None:
                size, speed, width = self._brake
                if self._is_new or passed > _RETURN:  # where it is, if not at home
                    width = math.inf
                self._brought_to_rest(Brake(self.home, size, speed, width), length)
            angle = self._brought_to_rest(lambda _: 0.0, length)
            rest = float(angle.mean())
            near = self._is_new or abs(rest - self.home) < self.near or passed > _RETURN
            if near and self._is_still(angle):
                self.noise, self.rest = max(_noise(angle), self.noise), rest
                self.home, self._is_new = rest if self._is_new else self.home, False
                return
        raise SafetyStop(
            f"the joint has not come to rest in {_LONGEST_STOP:g} s: check that nothing drives it"
        )

    def _brought_to_rest(self, law: Law, length: float) -> Samples:
        """Return the (n,) angles of a law that brakes for some s."""
        run = self.run(law, length, math.inf)
        if run.cut:
            raise SafetyStop(f"{run.cut} while the joint is brought to rest: check the drive")
        return run.angle

    @property
    def _window(self) -> float:
        """Time in s in which a joint that swings moves for certain."""
        return max(STILL, 1 / self.pace)

    def _is_still(self, angle: ArrayLike) -> bool:
        """Whether (n,) angles show no motion."""
        parts = [part.mean() for part in np.array_split(angle, 4)]
        return float(np.ptp(parts)) <= self._motion(_noise(angle))

    def _motion(self, noise: float) -> float:
        """Return the angle in rad that counts as motion."""
        return max(_NOISES * max(noise, self.noise), _FINEST)

    def _exceeded(self, swing: float, reach: float, speed: float, current: float) -> str:
        """Say which limit is exceeded, if any."""
        limits = self.limits
        for what, value, most, unit in (
            ("swing", swing, reach, "rad"),
            ("speed", speed, limits.speed if reach < math.inf else math.inf, "rad/s"),
            ("current", current, limits.current, "A"),
        ):
            if abs(value) > most:
                return f"{what} {value:.3g} {unit} beyond {most:g} {unit}"
        return ""


def _noise(angle: ArrayLike) -> float:
    """Return the standard deviation of the noise of (n,) angles."""
    return float(np.std(np.diff(angle))) / math.sqrt(2)


def _said_of_reading(passed: float, angle: float) -> str:
    """Say what is wrong with a reading."""
    if not math.isfinite(angle):
        return "the encoder gives no number: check its cable"
    if passed <= 0:
        return f"the clock stands, or ran back by {abs(passed):.3g} s: check where it comes from"
    return (
        f"{passed:.3g} s passed between two readings (at most {_LATE:g} s): the command was held "
        "meanwhile; take load from the computer"
    )
