"""Between the joint and the log: the encoder and the controller's clock."""

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

FINEST = 1 << 60  # steps per turn, finer than any angle in double precision
_BYTES_PER_CYCLE = 64  # timestamps, input, angle and velocity of a log, and copies
_SHORTEST = 0.1  # least interval, relative to the nominal one
_MULTIPLIER, _MODULUS = 16807, 2147483647  # Park & Miller's minimal standard generator
_LONGEST = 1 << 24  # samples of noise; more indicate a wrong sample time


@dataclass(frozen=True, kw_only=True)
class BandLimitedNoise:
    """Simulink's band-limited white noise, number for number, to repeat the thesis's runs."""

    # Height of the power spectral density in rad^2 s; the variance is `power`/`sample_time`
    power: float
    sample_time: float  # Hold time of each number in s
    seed: int = 23341  # As typed into the Simulink block

    def __post_init__(self) -> None:
        require_number("BandLimitedNoise", power=self.power)
        require_number("BandLimitedNoise", positive=True, unit="s", sample_time=self.sample_time)
        if not 0 <= self.seed < 2**32:
            raise InputError("BandLimitedNoise", "seed", self.seed, "an integer from 0 to 2^32 - 1")

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
    """Draw by Marsaglia's polar method, without the second number of each pair."""
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
    """Simulink's noise, added too, or None."""

    def __post_init__(self) -> None:
        if not 1 <= self.steps <= FINEST:
            steps = self.steps if self.steps < FINEST else "more"
            raise InputError("Encoder", "steps", steps, f"1 to {FINEST} steps per turn")
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
    """Faults between controller and file: fractions of samples lost or repeated."""

    dropped: float = 0.0
    duplicated: float = 0.0

    def __post_init__(self) -> None:
        for name in ("dropped", "duplicated"):
            share = getattr(self, name)
            if not 0 <= share < 1:
                raise InputError("Faults", name, share, "a fraction from 0 to below 1")

    def apply(self, log: Log, rng: np.random.Generator) -> Log:
        """Return the log as written, with samples lost and repeated at random."""
        if self.dropped == self.duplicated == 0:
            return log
        draws = rng.uniform(size=(2, log.time.size))
        copies = np.where(draws[0] < self.dropped, 0, np.where(draws[1] < self.duplicated, 2, 1))
        return log.take(np.repeat(np.arange(log.time.size), copies))


@dataclass(frozen=True, kw_only=True)
class ClockRegime:
    """A later regime of a controller's clock: mean cycle time and delay."""

    begin: float
    """Start in s."""
    step: float
    """Mean cycle time in s."""
    delay: float = 0.0
    """Additional delay of commands in s."""

    def __post_init__(self) -> None:
        require_number("ClockRegime", positive=True, unit="s", begin=self.begin, step=self.step)
        require_number("ClockRegime", unit="s", delay=self.delay)


@dataclass(frozen=True, kw_only=True)
class Clock:
    """The controller's cycle: it reads the angle and sets the input until the next cycle."""

    step: float = 0.001
    """Mean cycle time in s."""
    jitter: float = 0.0
    """Standard deviation in s of normal cycle times, which are at least a tenth of ``step``."""
    regimes: tuple[ClockRegime, ...] = ()
    """Later regimes, in order."""

    def __post_init__(self) -> None:
        require_number("Clock", positive=True, unit="s", step=self.step)
        if not (math.isfinite(self.jitter) and 0 <= self.jitter <= self.step / 2):
            raise InputError("Clock", "jitter", self.jitter, "from 0 to half the step, in s")
        if (begins := [regime.begin for regime in self.regimes]) != sorted(set(begins)):
            raise InputError("Clock", "regimes", begins, "increasing start times in s")

    @property
    def even(self) -> bool:
        """Whether all cycles have the same length."""
        return self.jitter == 0 and not self.regimes

    def late(self, time: Samples) -> Samples:
        """Return the (n,) additional delays in s of commands at (n,) instants in s."""
        delays = np.array([0.0, *(regime.delay for regime in self.regimes)])
        begins = [regime.begin for regime in self.regimes]
        return np.asarray(delays[np.searchsorted(begins, time, side="right")])

    def count(self, duration: float) -> int:
        """Return the number of cycles in about ``duration`` s, at least one."""
        require_number("Clock", positive=True, unit="s", duration=duration)
        count = max(duration / self.step, 1.0)
        require_room("Clock", "duration", f"{duration:g} s", _BYTES_PER_CYCLE * count)
        return round(count)

    def cycles(self, duration: float, rng: np.random.Generator) -> Samples:
        """Return the (n,) lengths in s of the cycles in about ``duration`` s."""
        nominal = np.full(self.count(duration), self.step)
        if self.regimes:
            edges = [0.0, *(min(regime.begin, duration) for regime in self.regimes), duration]
            steps = np.array([self.step, *(regime.step for regime in self.regimes)])
            nominal = np.repeat(steps, np.rint(np.diff(edges) / steps).astype(np.intp))
        if self.jitter == 0:
            return nominal
        jittered = nominal + self.jitter * rng.standard_normal(nominal.size)
        return np.maximum(jittered, _SHORTEST * nominal)


def rounded(values: Samples) -> Samples:
    """Return (n,) values rounded like Python's ``round``, without negative 0."""
    return np.rint(values) + 0.0


def stamps_of(cycles: Samples) -> Samples:
    """Return the (n + 1,) instants in s between (n,) cycles of given lengths in s."""
    return np.concatenate([[0.0], np.cumsum(cycles)])


def filtered_difference(time: Samples, angle: Samples, lag: float = VELOCITY_LAG) -> Samples:
    """Return (n,) velocities in rad/s, as in a controller, of angles at increasing timestamps.

    A backward difference and a first-order low pass with the time constant ``lag`` in s, as
    `FilteredDifference` computes sample by sample. They lag by it plus half a sample.
    """
    steps = np.diff(time)
    return _low_passed(np.exp(-steps / lag), np.diff(angle) / steps)


@compiled
def _low_passed(keep: Samples, values: Samples) -> Samples:
    filtered = np.zeros(values.size + 1)
    for k in range(values.size):
        filtered[k + 1] = keep[k] * filtered[k] + (1.0 - keep[k]) * values[k]
    return filtered


class FilteredDifference:
    """The `filtered_difference` of single readings, in a running control loop."""

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
