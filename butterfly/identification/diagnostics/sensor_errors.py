"""What encoder and noise add to a measured angle: found in a log, and drawn anew."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Samples = NDArray[np.float64]

_SAME = 1e-9  # rad, closer than which two readings are one
_FEWEST_GAPS = 3  # between different readings, of which a step can be told
_NEAR = 10  # steps, up to which gaps are looked at
_OFF = 0.1  # of a step, by which a gap may miss a whole number of them
_REGULAR = 0.95  # share of gaps that are whole numbers of steps where there are any
_MOST_SAMPLES = 20_000  # of a log, from which its noise is told
_HALVINGS = 10  # of the interval that holds the noise
_UNIFORM = 12.0  # square of the width of a uniform distribution over its variance
_CURVATURE = 6.0  # variance of a second difference of white noise over its own


@dataclass(frozen=True, kw_only=True)
class SensorErrors:
    """The errors of one log's readings: white noise, then rounding to a step of the encoder.

    Where the noise is less than a step the error is not white: it depends on the angle, and the
    slower that moves the longer the error stays.
    """

    step: float  # of the encoder in rad; 0 if the readings lie on no grid
    noise: float  # standard deviation in rad of the noise before rounding

    @property
    def spread(self) -> float:
        """Standard deviation in rad of a reading: of the noise, and of rounding to a step."""
        return math.hypot(self.noise, self.step / math.sqrt(_UNIFORM))

    @classmethod
    def of(cls, measured: Samples, angle: Samples) -> SensorErrors:
        """Tell step and noise from (n,) readings and the angles in rad that a model gives for them.

        The step is the distance of neighbouring readings. The noise is what makes the second
        differences of the errors as large as they are: what a model misses is smooth from sample to
        sample and hardly enters them.
        """
        step = encoder_step(measured)
        some = slice(_MOST_SAMPLES)
        roughness = _roughness(measured[some] - angle[some])
        upper = float(np.sqrt(roughness / _CURVATURE))
        if not step:
            return cls(step=0.0, noise=upper)
        white = np.random.default_rng(0).standard_normal(angle[some].size)
        lower = 0.0
        if _roughness(_errors(angle[some], 0.0 * white, step)) >= roughness:
            return cls(step=step, noise=0.0)
        for _ in range(_HALVINGS):
            middle = (lower + upper) / 2
            if _roughness(_errors(angle[some], middle * white, step)) < roughness:
                lower = middle
            else:
                upper = middle
        return cls(step=step, noise=lower)

    def draw(self, angle: Samples, random: np.random.Generator, *, unsure: float) -> Samples:
        """Return (n,) errors in rad that readings of (n,) angles in rad may have.

        All angles together may be off by a standard deviation of ``unsure`` rad.
        """
        shifted = angle + unsure * random.standard_normal()
        if not self.noise:
            return _errors(shifted, np.zeros(1), self.step)
        return _errors(shifted, self.noise * random.standard_normal(angle.size), self.step)


def encoder_step(readings: Samples) -> float:
    """Return the step in rad of the grid on which (n,) readings in rad lie; 0 if on none."""
    gaps = np.diff(np.unique(readings))
    gaps = gaps[gaps > _SAME]
    if gaps.size < _FEWEST_GAPS:
        return 0.0
    least = float(np.percentile(gaps, 5))
    step = float(np.median(gaps[gaps < 1.5 * least]))
    steps = gaps[gaps < _NEAR * step] / step
    regular = np.mean(np.abs(steps - np.rint(steps)) < _OFF)
    return step if regular > _REGULAR else 0.0


def _errors(angle: Samples, noise: Samples, step: float) -> Samples:
    read = angle + noise
    return (step * np.rint(read / step) if step else read) - angle


def _roughness(errors: Samples) -> float:
    """Mean square of the second differences of (n,) errors."""
    return float(np.mean(np.diff(errors, 2) ** 2))
