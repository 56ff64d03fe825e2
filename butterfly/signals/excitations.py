"""Inputs for a joint, besides the plain sine (`butterfly.logs.log.Sine`)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np

from butterfly.arrays import Samples
from butterfly.errors import InputError, require_number, require_room
from butterfly.logs.log import Sine

_IN_CACHE = 1024  # instants at a time, whose sines stay in the processor's cache
_POINTS = 16  # in a period of the highest harmonic
_BYTES_PER_POINT = 40  # a signal, its spectrum, and copies
_CLIPPINGS = 200  # rounds of crest optimisation; it converges long before
_CLIP = 0.9  # share of the peak at which a round clips
_LONGEST = 20  # register: a sequence of a million bits


@dataclass(frozen=True, kw_only=True)
class SteppedSine:
    """One sine after another, without a jump in phase."""

    omegas: tuple[float, ...]
    """In rad/s, one for each step."""
    amplitudes: tuple[float, ...]
    """In units of the input, one for each step."""
    dwell: float
    """Length of each step in s; the last one continues."""

    def __post_init__(self) -> None:
        require_number("SteppedSine", positive=True, dwell=self.dwell)
        if not self.omegas or len(self.omegas) != len(self.amplitudes):
            lengths = f"{len(self.amplitudes)} amplitudes and {len(self.omegas)} omegas"
            raise InputError("SteppedSine", "amplitudes", lengths, "one amplitude per omega")
        for omega, amplitude in zip(self.omegas, self.amplitudes, strict=True):
            require_number("SteppedSine", positive=True, omegas=omega, amplitudes=amplitude)

    def sample(self, time: Samples) -> Samples:
        """Return the (n,) input at (n,) instants in s."""
        step = np.clip((time / self.dwell).astype(np.intp), 0, len(self.omegas) - 1)
        omegas = np.array(self.omegas)
        starts = np.concatenate([[0.0], np.cumsum(omegas[:-1] * self.dwell)])
        phase = starts[step] + omegas[step] * (time - step * self.dwell)
        return np.asarray(np.array(self.amplitudes)[step] * np.sin(phase))


@lru_cache(maxsize=32)
def _phases_of_low_crest(harmonics: tuple[int, ...], seed: int) -> tuple[Samples, float]:
    """Return phases with a low peak by clipping (Van der Ouderaa et al., 1988), and that peak.

    Cached for the runs of a sweep.
    """
    phases = np.random.default_rng(seed).uniform(-np.pi, np.pi, len(harmonics))
    best, least = phases, math.inf
    lines, points = list(harmonics), _POINTS * max(harmonics)
    for _ in range(_CLIPPINGS + 1):
        spectrum = np.zeros(points // 2 + 1, dtype=np.complex128)
        spectrum[lines] = 0.5 * points * np.exp(1j * phases)
        signal = np.fft.irfft(spectrum, points)
        peak = float(np.abs(signal).max())
        if peak < least:
            best, least = phases, peak
        phases = np.angle(np.fft.rfft(np.clip(signal, -_CLIP * peak, _CLIP * peak))[lines])
    return best, least


@dataclass(frozen=True, kw_only=True)
class Multisine:
    """Equal sines at harmonics of one base frequency, phases chosen for a low crest factor."""

    base: float
    """Base frequency in rad/s; the period is 2 pi/base."""
    harmonics: tuple[int, ...]
    """Multiples of the base frequency."""
    peak: float
    """Largest absolute value, in units of the input."""
    seed: int = 0
    """Of the random initial phases."""

    def __post_init__(self) -> None:
        require_number("Multisine", positive=True, base=self.base, peak=self.peak)
        if not self.harmonics or min(self.harmonics) < 1:
            raise InputError("Multisine", "harmonics", self.harmonics, "positive integers")
        if len(set(self.harmonics)) != len(self.harmonics):
            raise InputError("Multisine", "harmonics", self.harmonics, "distinct harmonics")
        size = _BYTES_PER_POINT * _POINTS * max(self.harmonics)
        require_room("Multisine", "harmonics", max(self.harmonics), size)
        object.__setattr__(self, "harmonics", tuple(self.harmonics))

    def sample(self, time: Samples) -> Samples:
        """Return the (n,) input at (n,) instants in s."""
        phases, peak = _phases_of_low_crest(self.harmonics, self.seed)
        omegas = self.base * np.array(self.harmonics)
        values = np.empty(time.size)
        for begin in range(0, time.size, _IN_CACHE):
            rows = slice(begin, begin + _IN_CACHE)
            angles = np.outer(time[rows], omegas)
            angles += phases
            values[rows] = np.cos(angles, out=angles).sum(axis=1)
        return self.peak / peak * values


@dataclass(frozen=True, kw_only=True)
class Chirp:
    """A sine whose frequency changes linearly in time, then stays constant."""

    start: float
    """Frequency in rad/s at time 0."""
    stop: float
    """Frequency in rad/s from ``duration`` on."""
    duration: float
    """Of the sweep in s."""
    amplitude: float
    """In units of the input."""

    def __post_init__(self) -> None:
        require_number("Chirp", positive=True, **vars(self))

    def sample(self, time: Samples) -> Samples:
        """Return the (n,) input at (n,) instants in s."""
        rise = (self.stop - self.start) / self.duration
        swept = np.minimum(time, self.duration)
        phase = (self.start + 0.5 * rise * swept) * swept + self.stop * (time - swept)
        return np.asarray(self.amplitude * np.sin(phase))


@dataclass(frozen=True, kw_only=True)
class Prbs:
    """A pseudo-random binary sequence of maximal length."""

    amplitude: float
    """The input is plus or minus this."""
    bit: float
    """Shortest time between two switches in s."""
    register: int = 10
    """Length of the shift register; the sequence repeats after 2^register - 1 bits."""

    def __post_init__(self) -> None:
        require_number("Prbs", positive=True, amplitude=self.amplitude, bit=self.bit)
        if self.register not in range(2, _LONGEST + 1):  # of one bit it is constant
            raise InputError("Prbs", "register", self.register, f"an integer from 2 to {_LONGEST}")

    def sample(self, time: Samples) -> Samples:
        """Return the (n,) input at (n,) instants in s."""
        from scipy.signal import max_len_seq  # noqa: PLC0415, TID251 - slow, and wanted here alone

        bits, _ = max_len_seq(self.register)
        index = np.floor(time / self.bit * (1 + 1e-12)).astype(np.intp) % bits.size
        return np.asarray(self.amplitude * (2.0 * bits[index] - 1.0))


@dataclass(frozen=True, kw_only=True)
class FreeDecay:
    """No input: released at an angle."""

    angle: float
    """In rad."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.angle) and self.angle != 0):
            raise InputError("FreeDecay", "angle", self.angle, "a finite angle other than 0")

    def sample(self, time: Samples) -> Samples:
        """Return (n,) zeros."""
        return np.zeros_like(time)


@dataclass(frozen=True, kw_only=True)
class Table:
    """Any input, as a table of values held until the next instant; 0 before the first."""

    time: tuple[float, ...]
    """Instants in s, increasing."""
    values: tuple[float, ...]
    """The input from each instant on."""

    def __post_init__(self) -> None:
        if not self.time or len(self.time) != len(self.values):
            lengths = f"{len(self.time)} instants and {len(self.values)} values"
            raise InputError("Table", "values", lengths, "one value per instant")
        if not np.isfinite([*self.time, *self.values]).all():
            raise InputError("Table", "values", "a value that is not finite", "finite numbers")
        if any(after <= before for before, after in pairwise(self.time)):
            raise InputError("Table", "time", "instants out of order", "increasing instants")

    def sample(self, time: Samples) -> Samples:
        """Return the (n,) input at (n,) instants in s."""
        return np.array((0.0, *self.values))[np.searchsorted(self.time, time, side="right")]


Excitation = Sine | SteppedSine | Multisine | Chirp | Prbs | FreeDecay | Table
"""Anything that can drive a sweep."""


def initial_angle(excitation: Excitation) -> float:
    """Return the angle in rad at which a run with ``excitation`` starts, at rest."""
    return excitation.angle if isinstance(excitation, FreeDecay) else 0.0
