"""Whether errors are as random as a sensor's: their correlations, and bands that hold for them.

The whiteness test of Ljung (System Identification, 2nd ed. 1999, section 16.6) takes errors that
are independent from sample to sample. Those of an encoder are not: they repeat with the motion. So
the bands come from errors drawn as the log's own sensor makes them, not from a formula.
"""

from __future__ import annotations

from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

Samples = NDArray[np.float64]

LEVELS = (0.95, 0.99)
"""Shares of logs without a misfit whose two curves both stay inside the inner and outer band."""

_CURVES = 2  # autocorrelation and cross-correlation, which share the false alarms
_SMOOTHED = 10  # lags on either side over which the spread of drawn curves is averaged


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """A correlation over lags, and what sensors make of it.

    Parameters
    ----------
    lag
        (l,) in s.
    value
        (l,) correlation, between -1 and 1.
    centre
        (l,) mean of that of a sensor's errors.
    reach
        (2, l) half-widths of the bands about it that hold whole curves, by `LEVELS`.
    """

    lag: Samples
    value: Samples
    centre: Samples
    reach: Samples

    @property
    def excess(self) -> Samples:
        """(2,) largest distance from the centre over the band's half-width, by `LEVELS`."""
        return np.asarray((np.abs(self.value - self.centre) / self.reach).max(axis=1))

    @classmethod
    def of(cls, lag: Samples, curves: Samples, count: int, allowance: float) -> Curve:
        """Put bands about a curve.

        Parameters
        ----------
        lag
            (l,) in s.
        curves
            (l, 1 + k): the curve, and k of a sensor's errors.
        count
            Number of errors, of which white ones have correlations of variance 1/count.
        allowance
            By how much a misfit too small to count may move the curve.
        """
        value, drawn = curves[:, 0], curves[:, 1:]
        variance = _smoothed(drawn.var(axis=1, ddof=1)) * (1 + 1 / drawn.shape[1])
        spread = np.sqrt(np.maximum(variance, 1 / count))
        tails = [(1 - level) / (2 * _CURVES * lag.size) for level in LEVELS]
        factors = np.array([-NormalDist().inv_cdf(tail) for tail in tails])
        return cls(
            lag=lag,
            value=value,
            centre=drawn.mean(axis=1),
            reach=factors[:, None] * spread + allowance,
        )


def autocorrelation(errors: Samples, lags: int) -> Samples:
    """Return the (lags, k) correlations of k series with themselves, from lag 1 on.

    Parameters
    ----------
    errors
        (m, k), each of mean 0 or nearly so.
    lags
        How many; fewer than m.
    """
    size = _padded(errors.shape[0] + lags)
    spectrum = np.fft.rfft(errors, size, axis=0)
    sums = np.fft.irfft(np.abs(spectrum) ** 2, size, axis=0)[: lags + 1]
    return np.asarray(sums[1:] / _or_one(sums[0]))


def cross_correlation(errors: Samples, inputs: Samples, lags: int) -> Samples:
    """Return the (lags + 1, k) correlations of k series with an input that went before, from lag 0.

    Parameters
    ----------
    errors
        (m, k).
    inputs
        (m,); its mean counts for nothing.
    lags
        How many; fewer than m.
    """
    size = _padded(errors.shape[0] + lags)
    moving = inputs - inputs.mean()
    product = np.fft.rfft(errors, size, axis=0) * np.conj(np.fft.rfft(moving, size))[:, None]
    sums = np.fft.irfft(product, size, axis=0)[: lags + 1]
    powers = np.sum(errors**2, axis=0) * np.sum(moving**2)
    return np.asarray(sums / _or_one(np.sqrt(powers)))


def _padded(size: int) -> int:
    return 1 << (size - 1).bit_length()


def _or_one(values: Samples) -> Samples:
    return np.where(values > 0, values, 1.0)


def _smoothed(values: Samples) -> Samples:
    window = np.ones(min(2 * _SMOOTHED + 1, values.size))
    sums = np.convolve(values, window, "same")
    return np.asarray(sums / np.convolve(np.ones_like(values), window, "same"))
