"""What stands between the joint and the log: the encoder and the controller's clock."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from butterfly.arrays import Samples
from butterfly.compiled import compiled
from butterfly.errors import InputError, require_number, require_room
from butterfly.logs.log import Log

VELOCITY_LAG = 0.006
"""Lag in s of the velocity that the Butterfly robot's own controller records."""

_FINEST = 1 << 60  # steps per turn, finer than any angle in double precision
_BYTES_PER_CYCLE = 64  # stamps, input, angle and velocity of a log, and copies
_SHORTEST = 0.1  # an interval is never shorter than this share of the nominal one
_MULTIPLIER, _MODULUS = 16807, 2147483647  # Park & Miller's minimal standard generator
_LONGEST = 1 << 24  # samples of noise; a longer record is a slip in the sample time


@dataclass(frozen=True, kw_only=True)
class BandLimitedNoise:
    """Simulink's band-limited white noise, number for number, so that the thesis's runs replay."""

    # Height of the power spectral density in rad^2 s; the variance is `power`/`sample_time`
    power: float
    sample_time: float  # In s, over which each number is held
    seed: int = 23341  # As typed into the Simulink block

    def __post_init__(self) -> None:
        require_number("BandLimitedNoise", power=self.power)
        require_number("BandLimitedNoise", positive=True, unit="s", sample_time=self.sample_time)
        if not 0 <= self.seed < 2**32:
            raise InputError("BandLimitedNoise", "seed", self.seed, "from 0 to 2^32 - 1")

    def sample(self, time: Samples) -> Samples:
        """Return the (n,) noise in rad at (n,) instants in s, from 0 on."""
        index = np.floor(np.asarray(time) / self.sample_time * (1 + 1e-12)).astype(np.int64)
        last = int(index.max(initial=0))
        if index.min(initial=0) < 0 or last >= _LONGEST:
            raise InputError("BandLimitedNoise", "time", last, f"samples from 0 to {_LONGEST - 1}")
        scale = math.sqrt(self.power / self.sample_time)
        return np.asarray(scale * _normals(self.seed, 1 << (last + 1).bit_length())[index])


@lru_cache(maxsize=8)
def _normals(seed: int, count: int) -> Samples:
    """Return the first ``count`` standard normal numbers of Simulink's generator."""
    high, bit = seed >> 16, seed & 32768
    state = ((((seed - (high << 16)) + bit) << 16) + bit + high) & 0xFFFFFFFF
    state = 1144108930 if state < 1 else min(state, _MODULUS - 1)
    return _polar(state, count)


@compiled
def _polar(state: int, count: int) -> Samples:
    """Draw by Marsaglia's polar method, the second number of each pair thrown away."""
    numbers = np.empty(count)
    for k in range(count):
        square = 2.0
        first = 0.0
        while square > 1.0:
            state = _MULTIPLIER * state % _MODULUS
            first = 2.0 * state / _MODULUS - 1.0
            state = _MULTIPLIER * state % _MODULUS
            second = 2.0 * state / _MODULUS - 1.0
            square = first * first + second * second
        numbers[k] = first * math.sqrt(-2.0 * math.log(square) / square)
    return numbers


@dataclass(frozen=True, kw_only=True)
class Encoder:
    """An incremental encoder."""

    steps: int = 32768
    """Per turn."""
    noise: float = 0.0
    """Standard deviation in rad of white noise added before rounding to a step."""
    band_limited: BandLimitedNoise | None = None
    """Simulink's noise, added too; None for none."""

    def __post_init__(self) -> None:
        if not 1 <= self.steps <= _FINEST:
            found = self.steps if self.steps < _FINEST else "more"
            raise InputError("Encoder", "steps", found, f"1 to {_FINEST} steps per turn")
        require_number("Encoder", unit="rad", noise=self.noise)

    def read(self, time: Samples, angle: Samples, rng: np.random.Generator) -> Samples:
        """Return the (n,) readings in rad of (n,) true angles in rad at (n,) instants in s."""
        if self.noise:
            angle = angle + self.noise * rng.standard_normal(angle.size)
        if self.band_limited is not None:
            angle = angle + self.band_limited.sample(time)
        step = math.tau / self.steps
        return step * rounded(angle / step)

    def read_one(self, time: float, angle: float, rng: np.random.Generator) -> float:
        """Return the reading in rad of one true angle in rad."""
        if self.noise:
            angle += self.noise * rng.standard_normal()
        if self.band_limited is not None:
            angle += float(self.band_limited.sample(np.array([time]))[0])
        step = math.tau / self.steps
        return step * round(angle / step) if abs(angle) < math.inf else angle


@dataclass(frozen=True, kw_only=True)
class Faults:
    """What goes wrong between the controller and the file: shares of samples lost, or repeated."""

    dropped: float = 0.0
    duplicated: float = 0.0

    def __post_init__(self) -> None:
        for name in ("dropped", "duplicated"):
            share = getattr(self, name)
            if not 0 <= share < 1:
                raise InputError("Faults", name, share, "a share from 0 to below 1")

    def apply(self, log: Log, rng: np.random.Generator) -> Log:
        """Return the log as it is written: samples lost at random, and others repeated."""
        if self.dropped == self.duplicated == 0:
            return log
        draws = rng.uniform(size=(2, log.time.size))
        copies = np.where(draws[0] < self.dropped, 0, np.where(draws[1] < self.duplicated, 2, 1))
        return log.take(np.repeat(np.arange(log.time.size), copies))


@dataclass(frozen=True, kw_only=True)
class ClockRegime:
    """Another mean cycle time of a controller's clock, and what comes with it."""

    begin: float
    """In s, from which on."""
    step: float
    """Mean cycle time in s."""
    delay: float = 0.0
    """In s, by which commands come later than without it."""

    def __post_init__(self) -> None:
        require_number("ClockRegime", positive=True, unit="s", begin=self.begin, step=self.step)
        require_number("ClockRegime", unit="s", delay=self.delay)


@dataclass(frozen=True, kw_only=True)
class Clock:
    """The controller's cycle: it reads the angle, and sets the input until the next one."""

    step: float = 0.001
    """Mean cycle time in s."""
    jitter: float = 0.0
    """Standard deviation in s of each cycle time, normal, cut at a tenth of ``step``."""
    regimes: tuple[ClockRegime, ...] = ()
    """Others that follow one after the other."""

    def __post_init__(self) -> None:
        require_number("Clock", positive=True, unit="s", step=self.step)
        if not (math.isfinite(self.jitter) and 0 <= self.jitter <= self.step / 2):
            raise InputError("Clock", "jitter", self.jitter, "between 0 and half the step, in s")
        if (begins := [each.begin for each in self.regimes]) != sorted(set(begins)):
            raise InputError("Clock", "regimes", begins, "beginnings in s, one after the other")

    @property
    def even(self) -> bool:
        """Whether all cycles are as long."""
        return self.jitter == 0 and not self.regimes

    def late(self, time: Samples) -> Samples:
        """Return the (n,) delays in s of the regimes of commands at (n,) instants in s."""
        delays = np.array([0.0, *(each.delay for each in self.regimes)])
        begins = [each.begin for each in self.regimes]
        return np.asarray(delays[np.searchsorted(begins, time, side="right")])

    def count(self, duration: float) -> int:
        """Return how many cycles fill about ``duration`` s, at least one."""
        require_number("Clock", positive=True, unit="s", duration=duration)
        count = max(duration / self.step, 1.0)
        require_room("Clock", "duration", f"{duration:g} s", _BYTES_PER_CYCLE * count)
        return round(count)

    def cycles(self, duration: float, rng: np.random.Generator) -> Samples:
        """Return the (n,) lengths in s of the cycles that fill about ``duration`` s."""
        nominal = np.full(self.count(duration), self.step)
        if self.regimes:
            edges = [0.0, *(min(each.begin, duration) for each in self.regimes), duration]
            steps = np.array([self.step, *(each.step for each in self.regimes)])
            nominal = np.repeat(steps, np.rint(np.diff(edges) / steps).astype(np.intp))
        if self.jitter == 0:
            return nominal
        jittered = nominal + self.jitter * rng.standard_normal(nominal.size)
        return np.maximum(jittered, _SHORTEST * nominal)


def rounded(values: Samples) -> Samples:
    """Return (n,) values rounded as Python's ``round`` does, which knows no negative 0."""
    return np.rint(values) + 0.0


def stamps_of(cycles: Samples) -> Samples:
    """Return the (n + 1,) instants in s at which (n,) cycles of given lengths in s begin or end."""
    return np.concatenate([[0.0], np.cumsum(cycles)])


def filtered_difference(time: Samples, angle: Samples, lag: float = VELOCITY_LAG) -> Samples:
    """Return (n,) velocities in rad/s, as a controller makes them, of angles at increasing stamps.

    `FilteredDifference` makes them one by one: a backward difference, and a low pass of first order
    with a time constant ``lag`` in s. They lag by it plus half a sample.
    """
    steps = np.diff(time)
    keep = np.exp(-steps / lag)
    return _low_passed(keep, np.diff(angle) / steps)


@compiled
def _low_passed(keep: Samples, values: Samples) -> Samples:
    filtered = np.zeros(values.size + 1)
    for k in range(values.size):
        filtered[k + 1] = keep[k] * filtered[k] + (1.0 - keep[k]) * values[k]
    return filtered


class FilteredDifference:
    """The `filtered_difference` of readings as they come, in a running control loop."""

    def __init__(self, time_constant: float = 0.003) -> None:
        require_number("FilteredDifference", positive=True, time_constant=time_constant)
        self._constant = time_constant
        self._last: tuple[float, float] | None = None
        self._velocity = 0.0

    def update(self, time: float, angle: float, command: float) -> float:  # noqa: ARG002 - not needed here
        """Return the velocity in rad/s."""
        if self._last is not None and time > self._last[0]:
            step = time - self._last[0]
            keep = math.exp(-step / self._constant)
            self._velocity = keep * self._velocity + (1 - keep) * (angle - self._last[1]) / step
        self._last = (time, angle)
        return self._velocity
