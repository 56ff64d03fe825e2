"""Where a hand hangs at rest at the start or at the end of a log, without a torque to speak of."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from butterfly.logs.log import Log

Samples = NDArray[np.float64]

_LEAST_SECONDS = 0.7  # of standstill, longer than any turning point lasts
_SMALL = 0.02  # of the largest command: no torque to speak of
_STEPS, _SIGMAS = 2.0, 8.0  # of the encoder and of its noise: what a resting hand reads
_SIGMA_OF_MEDIAN = 0.6745 * 6**0.5  # median absolute second difference of white noise of sigma 1


def rest_readings(log: Log) -> list[float]:
    """Return the encoder's readings in rad of a hand that hangs still with no input.

    At the start it must be the input that sets the hand in motion: one that is let go was held. How
    far friction holds such a hand off its equilibrium is not known here.

    ``log``: of any input, with increasing stamps.
    """
    still = _still_band(log.angle)
    small = _SMALL * float(np.abs(log.input).max())
    readings = []
    first, last = _still_from(log.angle, still), _still_from(log.angle[::-1], still)
    if first < log.angle.size and _seconds(log.time[:first]) >= _LEAST_SECONDS:
        before = np.abs(log.input[:first])
        driven = np.flatnonzero(before > small)
        calm = int(driven[0]) if driven.size else 0
        if _seconds(log.time[:calm]) >= _LEAST_SECONDS:
            readings.append(float(np.median(log.angle[:calm])))
    end = slice(log.angle.size - last, None)
    if last < log.angle.size and _seconds(log.time[end]) >= _LEAST_SECONDS:
        calm = _still_from(np.abs(log.input[::-1][:last]), small, about_zero=True)
        kept = slice(log.angle.size - calm, None)
        if calm and _seconds(log.time[kept]) >= _LEAST_SECONDS:
            readings.append(float(np.median(log.angle[kept])))
    return readings


def _still_band(angle: Samples) -> float:
    """Range in rad of what an encoder reads of a hand at rest, by its step and its noise."""
    differences = np.abs(np.diff(angle))
    moved = differences[differences > 0]
    step = float(moved.min()) if moved.size else 0.0
    noise = float(np.median(np.abs(np.diff(angle, 2)))) / _SIGMA_OF_MEDIAN
    return _STEPS * step + _SIGMAS * noise


def _still_from(values: Samples, band: float, *, about_zero: bool = False) -> int:
    """Return how many of the first values stay within a band of each other, or of 0."""
    if about_zero:
        outside = values > band
    else:
        spread = np.maximum.accumulate(values) - np.minimum.accumulate(values)
        outside = spread > band
    return int(np.argmax(outside)) if outside.any() else values.size


def _seconds(time: Samples) -> float:
    return float(time[-1] - time[0]) if time.size else 0.0
