"""A motor between two runs and during them: what is played, first contact, a brake, a way home."""

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
from butterfly.logs.log import InputKind, Log
from butterfly.plant.motor import Motor, Reading, Sample, recorded
from butterfly.plant.sensors import FilteredDifference

Law = Callable[[Reading], float | None]
"""Returns the command for a reading, its time from the beginning of the run; None ends the run."""

STILL = 0.5
"""Time in s at rest at the beginning of each run: what the joint starts from is measured there."""

RESERVE = 0.6
"""Share of the limits that is used."""

LAG = 0.02
"""Least lag in s of the velocity that a brake goes by."""

_GROWTH = 1.25  # of a command, step by step
_STEP = 0.1  # s at one command
_SWITCH = 0.5  # share of the reach at which a relay switches while the swing is small
_SLEW = 0.02  # s, in which a relay's command reaches its size
_PATIENCE = 2.0  # s for which a relay waits to be switched
_STANDS = 0.6  # s for which it waits while the joint stands
_STAND = 0.03  # share of the reach within which that is
_BRAKED, _HELD = 1e-3, 0.2  # rad within which, and s for which, a joint stands that is braked
_BEGUN = 0.25  # share of a push's way from which on it has begun


class Push:
    """A command that grows from step to step until the joint has moved by ``enough`` rad."""

    def __init__(self, rest: float, enough: float, first: float, most: float) -> None:
        self._rest, self._enough, self._first, self._most = rest, enough, first, most
        self.command = self.moved = self.took = 0.0
        """The last command; how far in rad, and in how many s, it has moved the joint."""
        self._begun: float | None = None

    def __call__(self, reading: Reading) -> float | None:
        """Return the command for one reading; None when it moved, or after the largest one."""
        self.moved = reading.angle - self._rest
        if abs(self.moved) > _BEGUN * self._enough:
            self._begun = reading.time if self._begun is None else self._begun
            self.took = reading.time - self._begun
        else:
            self._begun = None
        wanted = abs(self._first) * _GROWTH ** int(reading.time / _STEP)
        if abs(self.moved) > self._enough or wanted > _GROWTH * self._most:
            return None
        self.command = math.copysign(min(wanted, self._most), self._first)
        return self.command


class Relay:
    """A relay with hysteresis that makes the joint swing by itself, then lets it go.

    The command switches between plus and minus its size as the angle passes a threshold, as in
    relay auto-tuning (Åström & Hägglund, Automatica 20, 1984). The threshold falls with the swing
    that was reached, and from before the middle on it brakes: so the swing stays near ``reach`` rad
    whatever the joint. The size grows while the swing is below half the reach, to ``most``. It also
    switches where the joint stands: so it never pushes for long against what gives no sign. After
    ``driven`` s the command is 0.
    """

    def __init__(self, rest: float, reach: float, size: float, most: float, driven: float) -> None:
        self._rest, self._reach, self._most, self._end = rest, reach, most, STILL + driven
        self.size = min(size, most)
        """Of the command, so far."""
        self._side, self._switched = 1, STILL
        self._peak = self._before = 0.0  # of the swing to this side, and to the other before
        self._command, self._time = 0.0, STILL
        self._stands = rest, STILL  # an angle, and since when the joint is there
        self._forced = 0.0  # time until when it pushes on, wherever the joint is

    def __call__(self, reading: Reading) -> float:
        """Return the command for one reading."""
        if reading.time < STILL:
            return 0.0
        wanted = self._wanted(reading) if reading.time < self._end else 0.0
        most = self.size * (reading.time - self._time) / _SLEW
        self._time = reading.time
        self._command += max(-most, min(most, wanted - self._command))
        return self._command

    def _wanted(self, reading: Reading) -> float:
        """Return the command that the relay is switched to."""
        swing = reading.angle - self._rest
        self._peak = max(self._peak, abs(swing))
        threshold = _SWITCH * self._reach * max(1 - self._peak / self._reach, -1.0)
        if abs(reading.angle - self._stands[0]) > _STAND * self._reach:
            self._stands = reading.angle, reading.time
        stands = reading.time - self._stands[1] > _STANDS  # gravity or friction holds it
        passed = self._side * swing > threshold and reading.time > self._forced
        switches = stands or passed
        if switches or reading.time - self._switched > _PATIENCE:
            if max(self._peak, self._before) < _SWITCH * self._reach:
                self.size = min(_GROWTH * self.size, self._most)
            self._switched = reading.time
        if switches:
            self._before = self._peak
            self._side, self._peak = -self._side, abs(swing)
            self._stands = reading.angle, reading.time
            self._forced = reading.time + _STANDS * stands
        return self._side * self.size


class Brake:
    """A command back to ``home``, full from ``speed`` rad/s and from ``width`` rad on.

    It goes by the velocity, with a lag in s.
    It ends where the joint stands: friction holds it, or its encoder is dead.
    """

    def __init__(
        self, home: float, size: float, speed: float, width: float, lag: float = LAG
    ) -> None:
        self._home, self._size, self._speed, self._width = home, size, speed, width
        self._velocity = FilteredDifference(lag)
        self._stands = math.nan, 0.0  # an angle, and since when the joint is there

    def __call__(self, reading: Reading) -> float | None:
        """Return the command for one reading; None when the joint stands."""
        if not abs(reading.angle - self._stands[0]) <= _BRAKED:
            self._stands = reading.angle, reading.time
        elif reading.time - self._stands[1] > _HELD:
            return None
        velocity = self._velocity.update(reading.time, reading.angle, 0.0)
        away = (reading.angle - self._home) / self._width + velocity / self._speed
        return -self._size * max(-1.0, min(1.0, away))


class LetGo:
    """Command 0, until the joint has moved by ``far`` rad and so does not rest."""

    def __init__(self, far: float) -> None:
        self._far, self._from = far, math.nan

    def __call__(self, reading: Reading) -> float | None:
        """Return the command for one reading."""
        self._from = reading.angle if math.isnan(self._from) else self._from
        return None if abs(reading.angle - self._from) > self._far else 0.0


class Signal:
    """A signal of time, after a rest."""

    def __init__(self, signal: Callable[[float], float]) -> None:
        self._signal = signal

    def __call__(self, reading: Reading) -> float:
        """Return the command for one reading."""
        return self._signal(reading.time - STILL) if reading.time >= STILL else 0.0


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


ENOUGH = 8e-3
"""Rad by which the joint has to move."""

_FIRST = 1e-3  # share of the largest command, at which a push begins
_NOISES = 10.0  # standard deviations of the encoder's noise that count as motion
_LONGEST = 10.0  # s of a push, from the first command to the largest


class Contact(NamedTuple):
    """What first contact showed."""

    polarity: int  # 1, or -1 where a positive command turns towards negative angles
    breakaway: float  # command that moves the joint, the larger of both directions


def make_contact(bench: Bench) -> Contact:
    """Push either way with a growing command until the joint moves; `SafetyStop` if it does not."""
    most, pushes = RESERVE * bench.limits.command, list[Push]()
    for side in (1, -1):
        bench.settle()
        enough = max(ENOUGH, _NOISES * bench.noise)
        push = Push(bench.rest, enough, side * _FIRST * most, most)
        cut = bench.run(push, _LONGEST, RESERVE * bench.limits.angle).cut
        if cut:
            raise SafetyStop(
                f"{cut} before the joint has moved by {enough:.2g} rad: check the drive"
            )
        if abs(push.moved) < enough:
            raise SafetyStop(
                f"nothing moves at a command of {push.command:g}, {RESERVE:.0%} of the largest "
                "allowed: check supply, enable, brake, and the encoder's cable"
            )
        if side > 0:
            bench.polarity = 1 if push.moved > 0 else -1
            bench.braked_with(push.command, enough / max(push.took, LAG))
        elif push.moved > 0:
            raise SafetyStop(
                "both signs of the command move the joint the same way: check the drive's "
                "direction input, and that its command has a sign"
            )
        pushes.append(push)
    bench.guard.stood = max(push.took for push in pushes)
    return Contact(bench.polarity, max(abs(push.command) for push in pushes))
