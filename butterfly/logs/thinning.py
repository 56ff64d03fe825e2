"""Means of neighbouring samples, in place of logs that have far more of them than motion.

Input and angle are averaged over the same stretches. A linear equation of motion holds for such
means exactly, gravity and friction to the second order of how far the motion goes on meanwhile.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from butterfly.logs.log import Intersample

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from butterfly.logs.log import Log

    Samples = NDArray[np.float64]

ENOUGH = 4_000_000
"""Samples of a log, above which their means are taken: an hour at 1.1 kHz."""

_SLOW = 0.1  # rad of its own phase that a motion may go on from one mean to the next
_ROWS = 100_000  # samples that tell how fast it is
_LONG = 2.0  # median lengths of a stretch, from which on there is a gap in it


def thinned(log: Log, enough: int = ENOUGH) -> Log:
    """Return a log of means; itself if it has few samples, or its motion is fast.

    The input is that of its means with straight lines between: a held input is half a sampling
    period later than its stamps, which is heeded. Stretches with a gap, and what is left over at
    the end, are left out.

    Parameters
    ----------
    log
        With increasing stamps.
    enough
        Samples that it may keep.
    """
    block = _block(log.angle, -(-log.time.size // enough))
    if block == 1:
        return log
    count = log.time.size // block
    length = log.time[block - 1 :: block][:count] - log.time[::block][:count]
    kept = length < _LONG * np.median(length)
    columns = {name: _means(values, block)[kept] for name, values in log.columns().items()}
    if log.intersample is Intersample.ZERO_ORDER_HOLD:
        ends = log.input[block - 1 :: block][:count]
        before = np.concatenate([log.input[:1], ends[:-1]])
        columns["input"] += ((before - ends) / (2 * block))[kept]
    means: dict[str, Any] = columns
    return replace(log, **means, intersample=Intersample.FIRST_ORDER_HOLD)


def _means(values: Samples, block: int) -> Samples:
    count = values.size // block
    return np.asarray(values[: count * block].reshape(count, block).mean(axis=1))


def _block(angle: Samples, wanted: int) -> int:
    """Return how many samples may be averaged into one, up to as many as are wanted.

    By the mean squares of the angle's change over a lag and over twice of it: their difference is
    three times that of a motion, and none of white noise.
    """
    spread = _SLOW**2 * float(np.var(angle[:: max(1, angle.size // _ROWS)]))
    block = 1
    while block < wanted:
        lag = min(2 * block, wanted)
        rows = np.linspace(0, angle.size - 2 * lag - 1, min(_ROWS, angle.size)).astype(np.intp)
        near, far = (np.mean((angle[rows + k * lag] - angle[rows]) ** 2) for k in (1, 2))
        if far - near > 3 * spread:
            break
        block = lag
    return block
