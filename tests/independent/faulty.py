"""A motor that a fault befalls in a phase of a campaign, which it sees from outside alone.

A push of contact is the first command other than 0; a relay is what comes to more than all before
in no time; a later run begins after rest, the way home while the joint moves or is away from home,
both with a log in the folder.
"""

import math
from hashlib import sha256

from tests.independent.faults import BRAKE, CONTACT, LATER, RELAY, REST, START
from tests.independent.motors import IndependentMotor

ANGLE = 1.0
"""Limit of angle in rad."""

LONGEST = 120.0
"""Simulated time in s from the onset of a fault, after which the campaign is ended from outside."""

_RISE = 0.12  # s in which a relay's command comes to its size; a push takes many times as long
_QUIET = 0.4  # s at command 0 before a run, at least
_SPEED = 5e-3  # rad/s, below which a joint rests
_AWAY = 0.05  # rad from home from which on it is brought back
_DRIVEN = 1.0  # s for which a campaign that was taken up has driven its next run


class OutOfTime(BaseException):
    """A campaign has gone on for too long; it is ended from outside, whatever it catches."""


class Endless(BaseException):
    """A campaign computes for too long."""


class GoesOn(BaseException):
    """A campaign that was taken up drives its next run."""


class FaultyMotor(IndependentMotor):
    """A motor that a fault befalls in a phase of a campaign, and that keeps what came of it."""

    def __init__(self, fault, phase, folder, *, after, limits, **about):
        super().__init__(**about)
        self.fault, self.phase, self.folder = fault, phase, folder
        self.input_kind = fault.kind
        self.limits = {"angle": ANGLE, "speed": math.inf} | limits
        self.memory, self.hooks, self.begun = {}, {}, None
        """Of the fault: what it remembers, its methods, and the time of its onset."""
        self.acted = False  # whether a method of the fault was called
        self.home, self.starts, self.most = self.angle, 0, 0.0
        self.beyond = self.driven = self.farthest = 0.0
        """Driven beyond a limit, driven since the onset, both in s; farthest angle while driven."""
        self.logs_then, self.is_taken_up = {}, False
        self._due, self._after, self._called = math.inf, after, ""
        self._zero_since, self._rise = 0.0, (0.0, 0.0, False)
        if phase == START:
            self._befall()

    @property
    def since(self):
        """Time in s since the onset."""
        return self.clock - self.begun

    @property
    def logs(self):
        """Digest of the logs in the folder, by name."""
        files = self.folder.glob("run_*.parquet") if self.folder.exists() else []
        return {path.name: sha256(path.read_bytes()).hexdigest() for path in files}

    def sound(self, *given):
        """Do what the method that is called does in a sound motor."""
        return getattr(IndependentMotor, self._called)(self, *given)

    def start(self):
        self.starts += 1
        return self._call("start")

    def stop(self):
        return self._call("stop")

    def read(self):
        return self._call("read")

    def wait(self, duration):
        if self.since_begun > LONGEST:
            raise OutOfTime
        return self._call("wait", duration)

    def carry(self, mass):
        self._call("carry", mass)
        self.home = self.angle

    def command(self, value):
        self._watch(value)
        if self.clock >= self._due and self.begun is None:
            self._befall()
        return self._call("command", value)

    def advance(self, duration):
        super().advance(duration)
        if not (self.enabled and self.applied):
            return
        swing = abs(self.angle - self.home)
        self.farthest = max(self.farthest, swing)
        if swing > self.limits["angle"] or abs(self.velocity) > self.limits["speed"]:
            self.beyond += duration
        if self.begun is not None:
            self.driven += duration

    @property
    def since_begun(self):
        """Time in s since the onset, 0 before it; of a sound motor never."""
        return self.since if self.begun is not None and not self.fault.harmless else 0.0

    def _call(self, name, *given):
        self._called = name
        hook = self.hooks.get(name)
        self.acted |= hook is not None
        return hook(self, *given) if hook else getattr(IndependentMotor, name)(self, *given)

    def _befall(self):
        self.begun, self.hooks, self.logs_then = self.clock, self.fault.does, self.logs
        self.driven, self.acted = 0.0, not self.hooks
        if self.fault.onset is not None:
            self.fault.onset(self)

    def _watch(self, value):
        """See from a command which phase has begun."""
        now = self.clock
        if not value:
            if self._zero_since is None:
                self._zero_since = now
            rests = now - self._zero_since > _QUIET and abs(self.velocity) < _SPEED
            if self.phase == REST and rests and self._due == math.inf and self.logs:
                self._due = now + 0.1 * self._after
            return
        if self._zero_since is not None:
            quiet, self._zero_since = now - self._zero_since, None
            self._rise = now, self.most, self._begins(quiet)
        begun, before, is_phase = self._rise
        rises = 0.0 < 1.2 * before < abs(value) and now - begun < _RISE
        if is_phase and self.is_taken_up and now - begun > _DRIVEN:
            raise GoesOn
        if self._due == math.inf and (is_phase or (self.phase == RELAY and rises)):
            self._due = now + self._after
        self.most = max(self.most, abs(value))

    def _begins(self, quiet):
        """Return whether the phase begins with a command after some s at 0."""
        if self.phase == CONTACT:
            return True
        if self.phase not in {LATER, BRAKE} or not self.logs:
            return False
        moves = abs(self.velocity) > _SPEED or abs(self.angle - self.home) > _AWAY
        return moves if self.phase == BRAKE else quiet > _QUIET and not moves
