"""A motor between two runs and during them: what is played, a brake, a way home, a log of each."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from butterfly.arrays import Samples
from butterfly.campaigns.drive import Drive, DriveFault, SafetyStop, TimeUsed
from butterfly.campaigns.guard import FINEST, NOISES, SOFT, Expected, Limits, MotionGuard
from butterfly.campaigns.laws import LAG, STILL, Brake, Law, LetGo
from butterfly.logs.log import InputKind, Log
from butterfly.plant.motor import Motor, Reading, Sample, recorded

_LONGEST_STOP = 60.0  # s in which a joint has to come to rest
_RETURN, _TRIES = 5.0, 3.0  # s, and windows, in which it has to be near home, or stays as it is
_NEAR = 0.1  # share of the largest angle that is near
_STILL_UNKNOWN = 1.0  # s in which a joint that is not known yet would be seen to swing
_STILL_SLOW = 5.0  # s after which a joint that hardly anything holds is taken to rest

Watch = Callable[[Reading, float], None]
"""Is shown each reading, and the command that answers it."""


class Recording(NamedTuple):
    """What a run recorded: (n,) times in s from its beginning, commands as set, angles as read."""

    time: Samples
    input: Samples
    angle: Samples
    cut: str  # the limit that ended it early; empty if none did
    input_kind: InputKind
    fault: DriveFault | None = None  # of the drive, when the run had ended

    def log(self, **about: Any) -> Log:  # noqa: ANN401 - fields of the log
        """Return its log."""
        about = {"source": "campaign", "input_kind": self.input_kind, **about}
        return recorded(self.time, self.input, self.angle, **about)


class Bench:
    """A motor under a `MotionGuard`; a context that always switches the drive off.

    Commands are those of laws times the ``polarity``: 1, or -1 where a positive command turns
    towards negative angles.
    """

    def __init__(
        self, motor: Motor, limits: Limits, step: float, watch: Watch | None = None
    ) -> None:
        self._drive, self.limits, self.step = Drive(motor), limits, step
        self.guard = MotionGuard(limits, step)
        self.input_kind, self._watch = self._drive.input_kind, watch
        self.polarity, self.used = 1, 0.0
        """Robot time in s so far is `used`."""
        self.rest, self._is_new, self._moves = 0.0, True, False
        """Angle in rad at which the joint rested last."""
        self._brake: tuple[float, float, float] | None = None

    def __enter__(self) -> Bench:
        self.guard.begin()
        self._drive.start()  # with command 0
        return self

    def __exit__(self, *_: object) -> None:
        self._drive.switch_off()

    def make_sure_it_is_off(self) -> None:
        """Switch the drive off where an interrupt has prevented it, however often."""
        while self._drive.is_enabled:
            with suppress(KeyboardInterrupt):
                self._drive.switch_off()

    def loaded_anew(self) -> None:
        """Take the next rest as home: the load is another one."""
        self._is_new, self.guard.home = True, None

    @property
    def is_loaded_anew(self) -> bool:
        """Whether the joint has not yet rested with its load."""
        return self._is_new

    @property
    def home(self) -> float:
        """Angle in rad of the first rest with the present load: swings count from there."""
        return self.guard.home or 0.0

    @property
    def noise(self) -> float:
        """Standard deviation of the encoder's noise at rest in rad."""
        return self.guard.noise

    @property
    def braking(self) -> float:
        """Size of a brake's command; 0 while there is none."""
        return 0.0 if self._brake is None else self._brake[0]

    def expect(self, model: Expected | None) -> None:
        """Take what a model says of the joint as it is loaded."""
        self.guard.model = model

    def run(self, law: Law, duration: float, reach: float | None = None) -> Recording:
        """Run a law within ``reach`` rad, by default nearly the limit, until it ends.

        That is after ``duration`` s, or when the joint rests after the last command. `TimeUsed`
        instead of a run for which no robot time is left.
        """
        if self.used >= self.limits.seconds:
            raise TimeUsed(f"the robot time of {self.limits.seconds:g} s is used up")
        run = self._play(law, duration, reach or SOFT * self.limits.angle)
        if run.cut and not np.any(run.input):
            raise SafetyStop(f"{run.cut} before the run: check joint and drive, then continue")
        return run

    def _play(self, law: Law, duration: float, reach: float = math.inf) -> Recording:
        """Return what a law makes of the joint within ``reach`` rad; cycle by cycle under guard."""
        drive, guard, cut, samples = self._drive, self.guard, "", list[Sample]()
        begun, free, window = math.nan, math.inf, self._window
        fault: DriveFault | None = None
        if isinstance(law, Brake):
            guard.save()
        while True:
            reading = drive.read()
            begun = reading.time if math.isnan(begun) else begun
            since = reading.time - begun
            guard.saw(reading)
            cut = guard.exceeded(reach) if reach < math.inf else ""
            command = None if cut or since > duration else law(Reading(since, *reading[1:]))
            if command is None:
                break
            most = self.limits.command
            sent = drive.command(self.polarity * max(-most, min(most, command)))
            guard.sent(sent)
            if samples and since <= samples[-1][0]:  # a clock with long ticks: one sample each
                samples[-1] = (since, sent, reading.angle)
            else:
                samples.append((since, sent, reading.angle))
            if self._watch is not None:
                self._watch(reading, sent)
            if sent:
                free, self._moves = since, True
            elif since - free > window:
                if self._is_still([x for t, _, x in samples if t > since - window]):
                    break
                free = since
            drive.wait(self.step)
            guard.waited(self.step)
        try:
            guard.sent(drive.command(0.0))
        except DriveFault as error:
            fault = error  # the run is over, and worth keeping
        self.used += since
        times, inputs, angles = np.array(samples or np.empty((0, 3))).T
        return Recording(times, inputs, angles, cut, self.input_kind, fault)

    def has_moved(self, run: Recording) -> bool:
        """Whether a run shows the joint in motion, beyond the encoder's noise."""
        if not run.angle.size:
            return False
        return float(np.ptp(run.angle)) > 2 * FINEST and float(np.std(run.angle)) > 2 * self.noise

    @property
    def near(self) -> float:
        """Angle in rad about home in which runs begin.

        A brake that is critically damped and full from there on can go by a velocity that the
        encoder's errors leave alone: its lag is then at most half of the brake's time constant.
        """
        return max(_NEAR * self.limits.angle, 4 * self.guard.grain)

    def braked_with(self, size: float, speed: float, width: float = math.inf) -> None:
        """Brake from now on with a command of a size, full from a speed in rad/s on.

        Full too from ``width`` rad away from home on, back to there.
        """
        self._brake = size, max(FINEST / LAG, speed), width or math.inf

    def settle(self) -> None:
        """Bring the joint home and wait until it rests; measure where, and the encoder's noise."""
        begun, away = self.used, max(_RETURN, _TRIES * self._window)
        while (passed := self.used - begun) < _LONGEST_STOP:
            if self._brake is not None and self._moves:
                size, speed, width = self._brake
                if self._is_new or passed > away:  # where it is, if not at home
                    width = math.inf
                lag = max(LAG, self.guard.grain / speed)  # errors of readings brake nothing
                self._play(Brake(self.home, size, speed, width, lag), self._window)
            angle = self._play(LetGo(self.near), self._window).angle
            rest = float(angle.mean())
            near = self._is_new or abs(rest - self.home) < self.near or passed > away
            if near and self._is_still(angle):
                self.guard.noise, self.rest = max(_noise(angle), self.noise), rest
                self.guard.home = rest if self._is_new else self.home
                self._is_new = self._moves = False
                self.guard.at_rest()
                return
            self._moves = True
        raise SafetyStop(
            f"the joint has not come to rest in {_LONGEST_STOP:g} s: check that nothing drives it"
        )

    @property
    def _window(self) -> float:
        """Time in s in which a joint that swings moves for certain."""
        model = self.guard.model
        if model is None:
            return _STILL_UNKNOWN
        return max(STILL, 2 / max(model.resonance, 2 / _STILL_SLOW))

    def _is_still(self, angle: ArrayLike) -> bool:
        """Whether (n,) angles show no motion."""
        parts = [part.mean() for part in np.array_split(angle, 4)]
        return float(np.ptp(parts)) <= max(NOISES * max(_noise(angle), self.noise), FINEST)


def _noise(angle: ArrayLike) -> float:
    """Return the standard deviation of the noise of (n,) angles."""
    return float(np.std(np.diff(angle))) / math.sqrt(2)
