"""Simulink's band-limited white noise, number for number, so that the thesis's runs replay."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from butterfly.compiled import compiled
from butterfly.errors import InputError, require_number

_MULTIPLIER, _MODULUS = 16807, 2147483647  # Park & Miller's minimal standard generator
_LONGEST = 1 << 24  # samples; a longer record is a slip in the sample time


@dataclass(frozen=True, kw_only=True)
class BandLimitedNoise:
    """White noise held over each sample time, of a given power spectral density.

    Parameters
    ----------
    power
        Height of the density, in rad^2 s; the variance is ``power``/``sample_time``.
    sample_time
        In s.
    seed
        As typed into the Simulink block.
    """

    power: float
    sample_time: float
    seed: int = 23341

    def __post_init__(self) -> None:
        require_number("BandLimitedNoise", power=self.power)
        require_number("BandLimitedNoise", positive=True, unit="s", sample_time=self.sample_time)
        if not 0 <= self.seed < 2**32:
            raise InputError("BandLimitedNoise", "seed", self.seed, "from 0 to 2^32 - 1")

    def sample(self, time: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (n,) noise in rad at (n,) instants in s, from 0 on.

        Raises
        ------
        InputError
            If an instant is negative or so late that the noise would fill the memory.
        """
        index = np.floor(np.asarray(time) / self.sample_time * (1 + 1e-12)).astype(np.int64)
        last = int(index.max(initial=0))
        if index.min(initial=0) < 0 or last >= _LONGEST:
            raise InputError("BandLimitedNoise", "time", last, f"samples from 0 to {_LONGEST - 1}")
        scale = math.sqrt(self.power / self.sample_time)
        return np.asarray(scale * _normals(self.seed, 1 << (last + 1).bit_length())[index])


@lru_cache(maxsize=8)
def _normals(seed: int, count: int) -> NDArray[np.float64]:
    """Return the first ``count`` standard normal numbers of Simulink's generator."""
    high, bit = seed >> 16, seed & 32768
    state = ((((seed - (high << 16)) + bit) << 16) + bit + high) & 0xFFFFFFFF
    state = 1144108930 if state < 1 else min(state, _MODULUS - 1)
    return _polar(state, count)


@compiled
def _polar(state, count):
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
