"""The guard of a motion: it sees every reading and every command, and knows when to switch off.

Two lines of defence. Where a run leaves its limits it is cut: the command is 0, or a brake. If that
does not help, the drive is switched off by `SafetyStop`: at once where the joint is a quarter
beyond its limit, after `_RESCUE` s where it stays beyond one, and within them where it is seen to
run away: it speeds up, away from home, although it is braked or let go.
"""

from __future__ import annotations

import itertools
import math
import time as computer
from collections import deque
from dataclasses import dataclass

from butterfly.campaigns.drive import SafetyStop
from butterfly.errors import require_number
from butterfly.plant.motor import Reading
from butterfly.plant.sensors import FilteredDifference

FINEST = 5e-4
"""Angle in rad, below which nothing counts as motion."""

NOISES = 5.0
"""Standard deviations of the encoder's noise that are no motion."""

SOFT = 0.9
"""Share of a limit of angle or speed at which a run is cut: the rest is for the brake."""

HARD = 1.25
"""Times the largest angle, at which the drive is off at once."""

_RESCUE = 0.15  # s beyond a limit, in which a cut or a brake has to help
_LATE = 0.1  # s between two readings, beyond which the drive was not under control
_LAG = 0.01  # s, of the speed that is guarded
_ROUNDED = 1.05  # times the largest command, that a drive may make of it by its steps
_READINGS = 5  # that a change of command is given to show
_SLOPE = 0.03  # s, over which a speed is measured that is compared with another
_LONG, _NOISY = 0.2, 0.5  # s of the same for noisy encoders: errors in limits of angle per s
_SHARE_OF_TIME = 0.1  # of the joint's time constant, in which a brake has to help
_UNKNOWN = 0.5  # s, for the time constant of a joint that is not known
_MOST = 0.1  # s that a change of command is given to show
_GROWN, _FLOOR = 1.1, 0.1  # growth of a speed that counts: its ratio, and limits of angle per s
_GAINED, _SWING = 3.0, 0.15  # the same of an energy: its ratio, and limits of angle
_STOOD, _SHORTEST, _LONGEST = 2.0, 0.3, 0.6  # times, and s, that an encoder may stand at most
_LASTING = 0.05  # s, lag of the command that a stand is judged by: a brake's noise moves nothing
_STOPS, _STOPS_LATE = 0.1, 0.4  # s, in which a joint that hardly moves stands or turns: between
_SUDDEN, _ROOM = 3.0, 3.0  # times the largest acceleration so far, and motions, of a sudden stand
_LEAP, _TIMES = 0.03, 5.0  # rad, and times the largest step so far, that a jump exceeds
_CLOCKS = 2.0  # s, after which clocks are compared
_CLOCK_ERROR = 0.03  # by which they may differ


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
        speed, current = (min(limit, 1e9) for limit in (self.speed, self.current))
        require_number("Limits", positive=True, seconds=self.seconds, speed=speed, current=current)


@dataclass(frozen=True, kw_only=True)
class Expected:
    """What a model says of the joint as it is loaded."""

    resonance: float  # rad/s, the least that the model allows; 0 of a joint that nothing holds
    friction: float = 0.0  # Coulomb's over the inertia in rad/s^2, as little as there may be
    brake: float = 0.0  # deceleration in rad/s^2 that a brake makes for certain
    stiffness: float | None = None  # of gravity over the inertia, in 1/s^2; None if not known
    hanging: float = 0.0  # rad, the angle to which gravity pulls it
    delay: float = 0.0  # s, from a command to its effect

    def swing(self, away: float, rate: float) -> float:
        """Return how far in rad from home a joint gets at most, if its run is ended now.

        Its energy goes into the spring that gravity is, and into friction and a brake on the way;
        ``away`` in rad from home, ``rate`` in rad/s.
        """
        slows, outward = self.friction + self.brake, math.copysign(1.0, away * rate)
        energy = rate**2 + (self.resonance * away) ** 2 + 2 * slows * outward * abs(away)
        if energy <= 0:
            return abs(away)
        root = math.sqrt(slows**2 + self.resonance**2 * energy)
        return max(abs(away), energy / (slows + root)) if slows + root > 0 else math.inf


class MotionGuard:
    """Watches a motor from its start until it is switched off."""

    def __init__(self, limits: Limits, step: float) -> None:
        self.limits, self._step = limits, step
        self.home: float | None = None
        """Angle in rad from which swings count: the first reading, then the first rest."""
        self.noise = 0.0
        """Standard deviation of the encoder's noise at rest in rad."""
        self.model: Expected | None = None
        self.breakaway = math.inf
        """Command that moves the joint from rest, either way; infinite while that is unknown."""
        self.stood = _LONGEST / _STOOD
        """Time in s for which the joint may stand in a sound run although it has to move."""
        self._fastest = 0.0  # acceleration so far in rad/s^2
        self._slope_time = max(_SLOPE, _READINGS * step)  # s over which a speed is measured
        self._rate_of_error = -math.expm1(-step / _LAG) / step  # rad/s, of a reading's rad
        self._widest = 0.0  # angle between two readings so far in rad
        self._count = math.inf  # the smallest one, in rad
        self.begin()

    def begin(self) -> None:
        """Forget the readings so far: the drive starts anew."""
        self._last: Reading | None = None
        self._same_time = 0.0  # s waited for without that the clock went on
        self._beyond = 0.0  # s beyond a limit since the joint rested
        self._trail: deque[tuple[float, float]] = deque()  # times and angles of the last readings
        self._speed = FilteredDifference(_LAG)
        self.rate = self.swing = 0.0  # the least by which the joint moves, and will swing
        self._command = self._lasting = 0.0  # the last one, and what lasted of the last ones
        self._saved: float | None = None  # time since when a cut or a brake has to help
        self._outward: tuple[float, float] | None = None  # since when, and its largest speed then
        self._free: tuple[float, float] | None = None  # time of the last command, energy then
        self._stand: _Stand | None = None
        self._slopes: deque[tuple[float, float]] = deque()  # times and speeds
        self._least = 0.0, math.inf  # speed in rad/s at least, and by how much a reading may err
        self._count_to_learn = 0
        self._past: deque[tuple[float, float]] = deque()  # times and angles, now and then
        self._slow = 0.0  # speed in rad/s at least, over a longer time
        self._stood_now = 0.0
        self._clocks: tuple[float, float] | None = None
        self._waited = 0.0

    def saw(self, reading: Reading) -> None:
        """Take a reading; `SafetyStop` if the drive has to be switched off."""
        self._require_clock(reading.time)
        if self.home is None:
            self.home = reading.angle
        time, angle = reading.time, reading.angle
        self._require_no_jump(reading)
        rate = self._speed.update(time, angle, 0.0)
        self.rate = math.copysign(max(abs(rate) - self._rate_doubt, 0.0), rate)
        if self._rate_doubt > _NOISY * self.limits.angle and abs(self._slow) > abs(self.rate):
            self.rate = self._slow  # of a noisy encoder, over a longer time
        away = angle - self.home
        self.swing = self._swing(away)
        self._trail.append((time, angle))
        while time - self._trail[0][0] > self._slope_time:
            self._trail.popleft()
        passed = 0.0 if self._last is None else time - self._last.time
        self._last = reading
        self._require_within(passed, away, reading.current)
        if self._saved is not None:
            self._require_help(time, away)
        elif self._command == 0:
            self._require_less_energy(time, angle)
        self._count_to_learn -= 1
        if self._count_to_learn <= 0:
            self._learn(time)
        self._require_live(time, angle)
        self._require_no_sudden_stand(time)

    def sent(self, command: float) -> None:
        """Take a command as the drive set it."""
        assert self._last is not None  # noqa: S101 - a command follows a reading
        if abs(command) > _ROUNDED * self.limits.command:
            raise SafetyStop(
                f"the drive reports a command of {command:.4g}, but at most "
                f"{self.limits.command:g} was sent: command() must return the command as it was "
                "set, in the same unit"
            )
        if command != 0:
            self._free = None
        elif self._free is None:
            self._free = self._last.time, 0.0
        self._command = command
        self._lasting += (command - self._lasting) * min(self._step / _LASTING, 1.0)

    def waited(self, duration: float) -> None:
        """Take the s that the drive was asked to let pass."""
        self._waited += duration
        self._same_time += duration

    def exceeded(self, reach: float) -> str:
        """Say which limit a run is about to leave, if any; the joint has to be saved then.

        ``reach`` is the largest swing in rad from home that it allows.
        """
        assert self._last is not None  # noqa: S101 - asked after a reading
        limits, current = self.limits, abs(self._last.current)
        within = self.swing <= reach and abs(self.rate) <= SOFT * limits.speed
        if within and not current > limits.current:
            return ""
        for what, value, most, unit in (
            ("swing", self.swing, reach, "rad"),
            ("speed", abs(self.rate), SOFT * limits.speed, "rad/s"),
            ("current", current, limits.current, "A"),
        ):
            if value > most:
                self.save()
                return f"{what} {value:.3g} {unit} beyond {most:.3g} {unit}"
        return ""

    def save(self) -> None:
        """From now on the joint is braked, or let go: it may not run away."""
        if self._saved is None:
            self._saved, self._outward = self._now, None

    def at_rest(self) -> None:
        """Take that the joint rests: nothing has to be saved."""
        self._saved, self._outward, self._beyond = None, None, 0.0
        self._free = (self._now, 0.0)

    def sound_run(self) -> None:
        """Learn from a run that was sound how long the joint may stand."""
        self.stood = max(self.stood, self._stood_now)

    @property
    def motion(self) -> float:
        """Angle in rad that counts as motion."""
        return max(NOISES * self.noise, FINEST)

    @property
    def grain(self) -> float:
        """Angle in rad by which a reading at rest may err: by noise, or by a count."""
        return max(NOISES * self.noise, self._count if self._count < math.inf else 0.0)

    @property
    def _now(self) -> float:
        return 0.0 if self._last is None else self._last.time

    def _swing(self, away: float) -> float:
        """Return how far in rad from home the joint gets, if its run is ended now."""
        return abs(away) if self.model is None else self.model.swing(away, self.rate)

    @property
    def _patience(self) -> float:
        """Time in s that a change of command is given to show."""
        pace = 1 / _UNKNOWN if self.model is None else self.model.resonance
        delay = 0.0 if self.model is None else self.model.delay
        share = _SHARE_OF_TIME / pace if pace > 0 else math.inf
        return min(max(_READINGS * self._step, share) + delay, _MOST)

    @property
    def _rate_doubt(self) -> float:
        """Speed in rad/s that the noise of a reading, or its count, makes of rest."""
        return self.grain * self._rate_of_error

    def _slope(self) -> tuple[float, float]:
        """Return the mean speed of the last readings in rad/s, and by how much it may err."""
        (begin, first), (end, last) = self._trail[0], self._trail[-1]
        passed = end - begin
        if passed < self._slope_time / 2:
            return 0.0, math.inf
        return (last - first) / passed, 2 * self._slip / passed

    @property
    def _slip(self) -> float:
        """Angle in rad by which a reading in motion may err: as at rest, or as it last stepped."""
        pairs = itertools.pairwise(angle for _, angle in self._trail)
        return max(self.motion, max((abs(after - before) for before, after in pairs), default=0.0))

    def _require_clock(self, time: float) -> None:
        """Raise `SafetyStop` unless the drive's clock goes on, as the computer's does."""
        if self._last is None:
            self._clocks, self._waited, self._same_time = (time, computer.monotonic()), 0.0, 0.0
            return
        passed = time - self._last.time
        if passed > 0:
            self._same_time = 0.0
        if passed < 0 or self._same_time > _LATE:
            raise SafetyStop(
                f"the drive's clock stands still, or ran back by {abs(passed):.3g} s: check the "
                "source of its time"
            )
        if passed > _LATE:
            raise SafetyStop(
                f"{passed:.4g} s passed between two readings (at most {_LATE:g} s): the command "
                "was held meanwhile; reduce the load on the computer"
            )
        assert self._clocks is not None  # noqa: S101 - set with the first reading
        if self._waited >= _CLOCKS:
            of_drive, of_computer = time - self._clocks[0], computer.monotonic() - self._clocks[1]
            errors = [abs(of_drive / duration - 1) for duration in (self._waited, of_computer)]
            if min(errors) > _CLOCK_ERROR:  # a simulated motor's is that of its waits alone
                raise SafetyStop(
                    f"the drive's clock advanced by {of_drive:.3g} s during a wait of "
                    f"{self._waited:.3g} s ({of_computer:.3g} s by the computer's clock): check "
                    "the unit and the source of its time"
                )
            self._clocks, self._waited = (time, computer.monotonic()), 0.0

    def _require_no_jump(self, reading: Reading) -> None:
        """Raise `SafetyStop` if the angle went on farther in a cycle than any joint does at once.

        A joint that speeds up goes on a little farther in each cycle.
        """
        if self._last is None:
            return
        step = abs(reading.angle - self._last.angle)
        counts = 3 * self._count if self._count < math.inf else 0.0
        if step > max(_TIMES * self._widest, _LEAP, counts, 2 * NOISES * self.noise):
            raise SafetyStop(
                f"the encoder jumped by {step:.3g} rad in {reading.time - self._last.time:.2g} s: "
                "it slips, loses counts, or wraps after a turn; check its mount and cable"
            )
        self._widest = max(self._widest, step)
        self._count = min(self._count, step or math.inf)

    def _require_within(self, passed: float, away: float, current: float) -> None:
        """Raise `SafetyStop` where limits are left for too long, or by too much."""
        limits = self.limits
        coming = abs(away) + 2 * self._step * max(math.copysign(1.0, away) * self.rate, 0.0)
        if coming > HARD * limits.angle:
            raise SafetyStop(
                f"the joint is {abs(away):.3g} rad from rest, beyond its limit of "
                f"{limits.angle:g} rad, and keeps going: neither the brake nor "
                "switching off stops it; check that the drive follows its command, and its sign"
            )
        swing, rate, current = abs(away) - NOISES * self.noise, abs(self.rate), abs(current)
        if not (swing > limits.angle or rate > limits.speed or current > limits.current):
            return
        self._beyond += passed
        for what, value, most, unit in (
            ("angle", swing, limits.angle, "rad"),
            ("speed", rate, limits.speed, "rad/s"),
            ("current", current, limits.current, "A"),
        ):
            if value > most:
                self.save()
                if self._beyond > _RESCUE:
                    raise SafetyStop(
                        f"{what} {value:.3g} {unit} beyond {most:g} {unit} for "
                        f"{self._beyond:.2g} s, although the run was ended: check that the "
                        "drive follows its command, and that nothing else turns the joint"
                    )
                return

    def _require_help(self, time: float, away: float) -> None:
        """Raise `SafetyStop` if a joint that is saved speeds up, away from home.

        Gravity, friction and a brake only slow it down there.
        """
        assert self._saved is not None  # noqa: S101 - asked only then
        slope, doubt = self._slope()
        speed = math.copysign(1.0, away) * slope
        if math.isinf(doubt):
            return
        if speed <= 0 or abs(away) <= self._slip:
            self._outward = None
            return
        if self._outward is None:
            self._outward = time, speed
        since, most = self._outward
        if time - max(since, self._saved) <= self._patience + self._slope_time:
            self._outward = since, max(most, speed)
        elif speed > _GROWN * most + 2 * doubt + _FLOOR * self.limits.angle:
            raise SafetyStop(
                f"the joint runs away from rest ({speed:.3g} rad/s at {abs(away):.3g} rad, "
                f"{most:.3g} rad/s before) although it is braked or released: check that the drive "
                "follows its command, both signs, and that the encoder does not slip"
            )

    def _require_less_energy(self, time: float, angle: float) -> None:
        """Raise `SafetyStop` if a joint at command 0 moves with more energy than it was left with.

        Energies are over the inertia, in rad^2/s^2; they need a model.
        """
        slope, doubt = self._slope()
        stiffness = None if self.model is None else self.model.stiffness
        if self.model is None or stiffness is None or self._free is None or math.isinf(doubt):
            return
        potential = stiffness * (1 - math.cos(angle - self.model.hanging))
        since, most = self._free
        if time - since <= self._patience + self._slope_time:
            self._free = since, max(most, (abs(slope) + doubt) ** 2 / 2 + potential)
            return
        energy = max(abs(slope) - doubt, 0.0) ** 2 / 2 + potential
        swing = _SWING * self.limits.angle * max(math.sqrt(stiffness), 1.0)
        if energy > _GAINED * most + swing**2 / 2:
            raise SafetyStop(
                f"the joint moves at {abs(slope):.3g} rad/s, faster than when the command went to "
                "0: check that the drive follows its command, and that nothing else turns the "
                "joint"
            )

    def _require_live(self, time: float, angle: float) -> None:
        """Raise `SafetyStop` if the encoder stands while the command has to move the joint.

        A joint that stands is held by friction. It breaks away at the latest after the command has
        changed by twice what moves it from rest, whatever part of that gravity takes.
        """
        if self._stand is None or abs(angle - self._stand.angle) > self.motion:
            if self._stand is not None and self._stand.since is not None:
                self._stood_now = max(self._stood_now, time - self._stand.since)
            self._stand = _Stand(angle, time, *self._least)
            return
        stand, lasting = self._stand, self._lasting
        most = _STOOD * self.stood  # s, in which it leaves where it stood, or only turned
        if time - stand.begun < min(max(most, _STOPS), _STOPS_LATE):
            return
        stand.low, stand.high = min(stand.low, lasting), max(stand.high, lasting)
        if max(stand.high - lasting, lasting - stand.low) <= 2 * self.breakaway:
            stand.since = None
            return
        stand.since = time if stand.since is None else stand.since
        if time - stand.since > min(max(most, _SHORTEST), _LONGEST):
            raise SafetyStop(
                "the joint no longer moves when it is driven: the encoder has stayed at "
                f"{angle:.4g} rad for {time - stand.since:.2g} s although the command went from "
                f"{stand.low:.3g} to {stand.high:.3g}, and {self.breakaway:.3g} moved the joint "
                "before; check supply, enable, the encoder's cable, and that nothing blocks the "
                "joint"
            )

    def _learn(self, time: float) -> None:
        """Learn how the joint accelerates, and how fast it moves at least; now and then."""
        self._count_to_learn = _READINGS
        self._past.append((time, self._trail[-1][1]))
        while time - self._past[0][0] > _LONG:
            self._past.popleft()
        (begin, first), (_, last) = self._past[0], self._past[-1]
        mean = (last - first) / max(time - begin, _LONG / 2)
        sure = max(abs(mean) - NOISES * self.noise / _LONG, 0.0)
        self._slow = math.copysign(sure, mean)
        slope, doubt = self._slope()
        if math.isinf(doubt):
            return
        long = self._slope_time
        self._slopes.append((time, slope))
        while time - self._slopes[0][0] > 2 * long:
            self._slopes.popleft()
        before, earlier = self._slopes[0]
        if time - before > long:
            self._fastest = max(self._fastest, abs(slope - earlier) / (time - before))
        since = long / 2 + _READINGS * self._step  # s for which it may have slowed down
        self._least = abs(slope) - doubt - self._fastest * since, self._slip

    def _require_no_sudden_stand(self, time: float) -> None:
        """Raise `SafetyStop` if the encoder stands at once where the joint cannot.

        From a speed v it stops within v^2/2a at the earliest, a being all that acts on it.
        """
        stand, limit = self._stand, _SUDDEN * self._fastest
        if stand is None or stand.speed <= 0 or limit <= 0:
            return
        passed = min(time - stand.begun, stand.speed / limit)
        if stand.speed * passed - limit * passed**2 / 2 > _ROOM * stand.grain:
            raise SafetyStop(
                f"the joint no longer moves: its encoder stopped abruptly at {stand.angle:.4g} "
                f"rad, from {stand.speed:.2g} rad/s or more; check its cable, and that the joint "
                "has not hit an end stop"
            )


@dataclass
class _Stand:
    """A reading that stays, and the commands meanwhile."""

    angle: float
    begun: float  # time in s
    speed: float  # before it, in rad/s at least
    grain: float  # by which a reading may err, in rad
    low: float = math.inf  # of the commands since it has stopped for certain
    high: float = -math.inf
    since: float | None = None  # time from which on the joint has to move
