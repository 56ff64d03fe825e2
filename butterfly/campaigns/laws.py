"""What a campaign plays: a push until the joint moves, a relay that finds its own size, a brake."""

from __future__ import annotations

import math
from collections.abc import Callable

from butterfly.plant.motor import Reading
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
