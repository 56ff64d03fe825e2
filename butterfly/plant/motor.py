"""The motor wrapper: what a control law may do to a joint, real or simulated."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from butterfly.errors import InputError, require_number
from butterfly.logs.log import InputKind, Log
from butterfly.model.parameters import compressed
from butterfly.plant.sensors import Encoder, rounded

LARGEST_COMMAND = 1e10
"""In units of the command; MuJoCo takes none from there on."""

LARGEST_ANGLE = 1e5
"""In rad, sixteen thousand turns; a joint that has turned further has diverged."""

_USABLE = f"a number smaller than {LARGEST_COMMAND:g}"


class Reading(NamedTuple):
    """What the controller sees: time in s, angle in rad, current in A (NaN if not measured)."""

    time: float
    angle: float
    current: float


class Motor(Protocol):
    """A joint that takes commands. Whoever has these methods is one; hardware included.

    The command is held until the next one (zero-order hold).
    """

    @property
    def input_kind(self) -> InputKind:
        """What the command means: V or units of torque."""

    def start(self) -> None:
        """Get ready at time 0, with the command at 0."""

    def stop(self) -> None:
        """Let go of the joint; called however the run ended."""

    def command(self, value: float) -> float:
        """Set the command, and return it as it was really set (saturated, rounded)."""

    def read(self) -> Reading:
        """Read clock and sensors now."""

    def wait(self, duration: float) -> None:
        """Let ``duration`` s pass."""


@dataclass(frozen=True, kw_only=True)
class CommandPath:
    """What lies between a command and the motor's terminals.

    Parameters
    ----------
    limit
        Saturation, in units of the command.
    resolution
        Step to which a command is rounded; 0 for none.
    delay
        In s, from command to terminals.
    compression
        c in 1/unit of the command: the drive yields v/(1 + c |v|), its gain falling with the
        command v. Unlike the others a flaw that the log does not show.
    """

    limit: float = math.inf
    resolution: float = 0.0
    delay: float = 0.0
    compression: float = 0.0

    def __post_init__(self) -> None:
        if not self.limit > 0:
            raise InputError("CommandPath", "limit", self.limit, "a positive number")
        require_number("CommandPath", resolution=self.resolution, delay=self.delay)
        require_number("CommandPath", compression=self.compression)

    def shape(self, value: float) -> float:
        """Return the command that leaves the path: rounded, then saturated."""
        if not abs(value) < LARGEST_COMMAND:
            raise InputError("control law", "command", value, _USABLE)
        if self.resolution > 0:
            value = self.resolution * round(value / self.resolution)
        return min(max(value, -self.limit), self.limit)

    def shape_all(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what leaves the path when (n,) ``values`` enter it one by one."""
        usable = np.abs(values) < LARGEST_COMMAND
        if not usable.all():
            raise InputError("control law", "command", values[~usable][0], _USABLE)
        if self.resolution > 0:
            values = self.resolution * rounded(values / self.resolution)
        return np.clip(values, -self.limit, self.limit)

    def deliver(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (n,) inputs that the joint gets when (n,) shaped commands have been set."""
        return compressed(values, self.compression)


class Joint(Protocol):
    """A simulated joint: its state, and how it moves under a constant command."""

    @property
    def input_kind(self) -> InputKind:
        """What the command means."""

    @property
    def angle(self) -> float:
        """True angle in rad."""

    def reset(self) -> None:
        """Go back to rest at time 0."""

    def advance(self, command: float, duration: float) -> None:
        """Move on for ``duration`` s with ``command`` held."""

    def current(self, command: float) -> float:
        """Armature current in A under ``command``; NaN if the drive hides it."""


class SimulatedMotor:
    """A motor whose joint is simulated, with a command path and an encoder.

    Parameters
    ----------
    joint
        In MuJoCo or the grey box.
    path
        Between command and terminals. A delayed command takes effect at its own instant, not at
        the next cycle.
    encoder
        Reads the angle.
    rng
        Source of the encoder's noise.
    """

    def __init__(
        self,
        joint: Joint,
        *,
        path: CommandPath = CommandPath(),
        encoder: Encoder = Encoder(),
        rng: np.random.Generator | None = None,
    ) -> None:
        self._joint = joint
        self._path = path
        self._encoder = encoder
        self._rng = rng or np.random.default_rng(0)
        self._pending: deque[tuple[float, float]] = deque()
        self._time = self._applied = 0.0

    @property
    def input_kind(self) -> InputKind:
        """What the command means."""
        return self._joint.input_kind

    def start(self) -> None:
        """Put the joint to rest at time 0."""
        self._joint.reset()
        self._pending.clear()
        self._time = self._applied = 0.0

    def stop(self) -> None:
        """Set the terminals to 0."""
        self._pending.clear()
        self._applied = 0.0

    def command(self, value: float) -> float:
        """Set the command; see `Motor`."""
        value = self._path.shape(value)
        delivered = compressed(value, self._path.compression)
        if self._path.delay > 0:
            self._pending.append((self._time + self._path.delay, delivered))
        else:
            self._applied = delivered
        return value

    def read(self) -> Reading:
        """Read the encoder; see `Motor`."""
        angle = self._encoder.read_one(self._time, self._joint.angle, self._rng)
        return Reading(self._time, angle, self._joint.current(self._applied))

    def wait(self, duration: float) -> None:
        """Simulate ``duration`` s, switching to each delayed command at its own instant."""
        end = self._time + duration
        while self._pending and self._pending[0][0] < end:
            instant, value = self._pending.popleft()
            if instant > self._time:
                self._joint.advance(self._applied, instant - self._time)
                self._time = instant
            self._applied = value
        self._joint.advance(self._applied, end - self._time)
        self._time = end


class ReplayMotor:
    """A recorded log in the place of a motor: its angles come back, whatever is commanded.

    Tells what a controller, an observer or an estimator would have seen and done on that day.

    Parameters
    ----------
    log
        With increasing stamps. Between them the angle is interpolated; time starts at 0.
    """

    def __init__(self, log: Log) -> None:
        self._log = log
        self._time = 0.0

    @property
    def input_kind(self) -> InputKind:
        """What the log's input meant."""
        return self._log.input_kind

    @property
    def duration(self) -> float:
        """Length of the log in s."""
        return float(self._log.time[-1] - self._log.time[0])

    def start(self) -> None:
        """Go back to the first sample."""
        self._time = 0.0

    def stop(self) -> None:
        """Do nothing: nothing moves."""

    def command(self, value: float) -> float:
        """Take note of nothing; return the value."""
        return value

    def read(self) -> Reading:
        """Return the recorded angle."""
        time = self._log.time
        angle = float(np.interp(self._time + time[0], time, self._log.angle))
        return Reading(self._time, angle, math.nan)

    def wait(self, duration: float) -> None:
        """Move on in the log, which must not end before."""
        self._time += duration
        if self._time > self.duration * (1 + 1e-9):
            raise InputError(self._log.source, "time", f"{self.duration:.6g} s", "a longer log")
