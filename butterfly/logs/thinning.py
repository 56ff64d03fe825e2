"""Means of neighbouring samples, for logs sampled far faster than they move.

Input and angle are averaged over the same stretches. A linear equation of motion holds exactly for
such means, gravity and friction to second order in the motion within a stretch.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import Samples
from butterfly.logs.health import GAP_FACTOR
from butterfly.logs.log import Intersample, Log

ENOUGH = 4_000_000
"""Samples of a log above which it is averaged: an hour at 1.1 kHz."""

GLANCE = 10_000
"""Samples of a log that a first look needs."""

_SLOW = 0.1  # rad of phase of a motion from one mean to the next
_ROWS = 100_000  # samples that show how fast it is


def thinned(log: Log, enough: int = ENOUGH) -> Log:
    """Return a log of means; itself if it has at most ``enough`` samples or moves fast."""
    block = _block(log.angle, -(-log.time.size // enough))
    if block == 1:
        return log
    share = np.full(block, 1 / block)
    columns = {name: _blocks(values, block) @ share for name, values in log.columns().items()}
    if log.between_samples is Intersample.ZERO_ORDER_HOLD:
        columns["input"] = _held(log, block)
    mask = _without_gap(log.time, block)  # without an incomplete stretch at the end
    means: dict[str, Any] = {name: values[mask] for name, values in columns.items()}
    return replace(log, **means)


def _blocks(values: Samples, block: int) -> Samples:
    count = values.size // block
    return values[: count * block].reshape(count, block)


def _held(log: Log, block: int) -> Samples:
    """Return the held input from one mean to the next that has the same effect.

    It is averaged like the angle, then from mean to mean, with weights that rise over one stretch
    and fall over the next. Input before the first mean acts after it. A sample holds from its
    timestamp: around it, the input is the mean of itself and the one before (0 if none).
    """
    first = 0.0 if log.lead is None or not log.lead.input.size else log.lead.input[-1]
    about = log.input.copy()
    about[1:] += log.input[:-1]
    about[0] += first
    about *= 0.5
    rise = (np.arange(block) + 0.5) / block**2
    stretches = _blocks(about, block)
    rising, falling = stretches @ rise, stretches @ rise[::-1]
    if log.lead is None:
        rising[0] += falling[0]
    return np.asarray(rising + np.append(falling[1:], falling[-1]))


def _without_gap(time: Samples, block: int) -> NDArray[np.bool_]:
    """(n,) whether each stretch is free of gaps (see `butterfly.logs.health`)."""
    intervals = np.diff(time)
    gaps = np.flatnonzero(intervals > GAP_FACTOR * np.median(intervals))
    within = gaps[(gaps + 1) % block > 0] // block
    mask = np.ones(time.size // block, dtype=np.bool_)
    mask[within[within < mask.size]] = False
    return mask


def _block(angle: Samples, wanted: int) -> int:
    """Return how many samples may be averaged into one, at most the wanted number."""
    spread = _SLOW**2 * float(np.var(angle[:: max(1, angle.size // _ROWS)]))
    block = 1
    while block < wanted:
        lag = min(2 * block, wanted)
        rows = slice(0, angle.size - 2 * lag, max(1, angle.size // _ROWS))
        near, far = (np.mean((angle[k * lag :][rows] - angle[rows]) ** 2) for k in (1, 2))
        if far - near > 3 * spread:  # three times the square of a motion's change, 0 of noise
            break
        block = lag
    return block
