"""What sensors make of a perfect model: errors of readings, and the correlations that they have.

A reading is the angle with white noise, rounded to a step of the encoder. Where the noise is half a
step or more, its error is white (Widrow & Kollar, Quantization Noise, 2008, chapter 19). Where it
is less, the error depends on the angle, and the slower that moves the longer the error stays.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import fft
from scipy.optimize import bisect
from scipy.special import ndtri

from butterfly.arrays import Samples
from butterfly.identification.levels import CONFIDENCE, PRECISE


@dataclass(frozen=True, kw_only=True)
class SensorErrors:
    """The errors of one log's readings."""

    step: float  # of the encoder in rad; 0 if the readings lie on no grid
    noise: float  # standard deviation in rad of the noise before rounding

    @property
    def spread(self) -> float:
        """Standard deviation in rad of a reading: of the noise, and of rounding to a step."""
        return math.hypot(self.noise, self.step / math.sqrt(12))

    @property
    def white(self) -> bool:
        """Whether the errors do not depend on the angle."""
        return self.noise >= self.step / 2

    @classmethod
    def of(cls, measured: Samples, angle: Samples) -> SensorErrors:
        """Tell step and noise from (n,) readings and the angles in rad that a model gives for them.

        The step is the distance of neighbouring readings. The noise is what makes the second
        differences of the errors as large as they are: what a model misses is smooth from sample to
        sample and hardly enters them.
        """
        step, roughness = encoder_step(measured), _roughness(measured - angle)
        white = cls(step=step, noise=math.sqrt(max(roughness / 6 - step**2 / 12, 0.0)))
        if white.white:
            return white
        drawn = np.random.default_rng(0).standard_normal(angle.size)

        def excess(noise: float) -> float:
            return _roughness(_errors(angle, noise * drawn, step)) - roughness

        largest = math.sqrt(roughness / 6)
        if excess(0.0) >= 0 or excess(largest) <= 0:
            return cls(step=step, noise=0.0 if excess(0.0) >= 0 else largest)
        return cls(step=step, noise=float(bisect(excess, 0.0, largest, xtol=1e-3 * step)))

    def draw(self, angle: Samples, random: np.random.Generator, *, unsure: float) -> Samples:
        """Return (n,) errors in rad that readings of (n,) angles in rad may have.

        All angles together may be off by a standard deviation of ``unsure`` rad.
        """
        shifted = angle + unsure * random.standard_normal()
        noise = self.noise * random.standard_normal(angle.size) if self.noise else np.zeros(1)
        return _errors(shifted, noise, self.step)


def encoder_step(readings: Samples) -> float:
    """Return the step in rad of the grid on which (n,) readings in rad lie; 0 if on none."""
    gaps = np.diff(np.unique(readings))
    gaps = gaps[gaps > 1e-9]  # noqa: PLR2004 - rad, what rounding of numbers leaves
    if gaps.size < 3:  # noqa: PLR2004 - of fewer nothing can be told
        return 0.0
    step = float(np.median(gaps[gaps < 1.5 * np.percentile(gaps, 5)]))
    return step if np.median(np.abs(gaps / step - np.rint(gaps / step))) < PRECISE else 0.0


def _errors(angle: Samples, noise: Samples, step: float) -> Samples:
    read = angle + noise
    return (step * np.rint(read / step) if step else read) - angle


def _roughness(errors: Samples) -> float:
    """Mean square of the second differences of (n,) errors: 6 times the variance of white ones."""
    return float(np.mean(np.diff(errors, 2) ** 2))


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """A correlation over lags, and what sensors make of it."""

    lag: Samples  # (l,) in s
    value: Samples  # (l,) correlation, between -1 and 1
    centre: Samples  # (l,) mean of that of a sensor's errors
    reach: Samples  # (l,) half-widths of the band about it that holds whole curves

    @property
    def excess(self) -> float:
        """Largest distance from the centre over the band's half-width."""
        return float((np.abs(self.value - self.centre) / self.reach).max())

    @classmethod
    def of(cls, lag: Samples, curves: Samples, count: int, allowance: float) -> Curve:
        """Put a band about a curve.

        (l,) lags in s; (l, 1 + k) the curve, and k of a sensor's errors if these are not white;
        the number of errors, of which white ones have correlations of variance 1/count; and by how
        much a misfit too small to count may move the curve. The two curves of a log share its false
        alarms: of logs without a misfit both stay inside in a share of `CONFIDENCE`.
        """
        value, drawn, variance, centre = curves[:, 0], curves[:, 1:], 0.0, np.zeros(lag.size)
        if drawn.size:
            centre = drawn.mean(axis=1)
            variance = float(drawn.var(axis=1, ddof=1).mean()) * (1 + 1 / drawn.shape[1])
        factor = -float(ndtri((1 - CONFIDENCE) / (4 * lag.size)))
        half = factor * math.sqrt(max(variance, 1 / count)) + allowance
        return cls(lag=lag, value=value, centre=centre, reach=np.full(lag.size, half))


def correlations(errors: Samples, inputs: Samples, lags: int) -> tuple[Samples, Samples]:
    """Return (lags, k) correlations of (m, k) errors with themselves, from lag 1 on, and others.

    The others are (lags + 1, k), with (m,) inputs before them.
    """
    size = fft.next_fast_len(errors.shape[0] + lags, real=True)
    moving = inputs - inputs.mean()
    spectrum = fft.rfft(np.ascontiguousarray(errors.T), size)
    own = fft.irfft(np.abs(spectrum) ** 2, size)[:, : lags + 1]
    crossed = fft.irfft(spectrum * np.conj(fft.rfft(moving, size)), size)[:, : lags + 1]
    powers = np.where(own[:, :1] > 0, own[:, :1], 1.0)
    driven = np.sqrt(powers * (float(np.sum(moving**2)) or 1.0))
    return (own[:, 1:] / powers).T, (crossed / driven).T
