"""Regimes of a controller's clock: switches of its mean sampling interval, from timestamps alone.

A self-normalised statistic (Shao & Zhang, J. Am. Stat. Assoc. 105, 2010) asks whether the mean of
the intervals changes once. It needs no variance, so the intervals may be correlated, and a drift
stays below 43. A switch counts if it also shows in the neighbouring intervals, and if a step fits
them better than a smooth drift.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.polynomial import legendre

from butterfly.arrays import Samples

_GAP = 3.0  # median intervals, above which one is a gap
_BLOCK = 32  # intervals per mean,
_MOST = 1000  # and means per piece at most
_LEAST = 16  # means of a regime
_WHOLE = 200.0  # of the statistic; of a million even clocks fewer than 200 come to 138
_NEAR = 80.0  # of the statistic over so many means on either side,
_BESIDE = 32
_STEP = 0.01  # of the interval, that counts as a change
_SMOOTH = 5  # degree of a drift,
_LESS = 0.95  # and the residual squares of a step over its own, at most
_HALVES = 2  # of a piece without a switch, as two may cancel


class Regime(NamedTuple):
    """A stretch of a log: its beginning in s, and its mean sampling interval in s."""

    begin: float
    interval: float


def find_regimes(time: Samples) -> tuple[Regime, ...]:
    """Return the regimes of (n,) increasing timestamps in s, at least one."""
    intervals = np.diff(time)
    even = intervals <= _GAP * np.median(intervals)
    regular = intervals if even.all() else intervals[even]
    switches = _switches(regular)
    edges = [0, *switches, regular.size]
    first = [0, *(np.flatnonzero(even)[switches] if switches else ())]
    return tuple(
        Regime(float(time[row]), float(regular[begin:end].mean()))
        for row, (begin, end) in zip(first, pairwise(edges), strict=True)
    )


def between_regimes(logs: Sequence[tuple[Regime, ...]], ends: Iterable[float]) -> float:
    """Return an interval between fast and slow regimes (Otsu, IEEE Trans. SMC 9, 1979), or 0."""
    if all(len(regimes) == 1 for regimes in logs):
        return 0.0
    stretches = sorted(
        (here.interval, after - here.begin)
        for regimes, end in zip(logs, ends, strict=True)
        for here, after in zip(
            regimes, [*(regime.begin for regime in regimes[1:]), end], strict=True
        )
    )
    interval, weight = np.array(stretches).T
    fast, slow = np.cumsum(weight)[:-1], np.cumsum(weight[::-1])[-2::-1]
    sums = np.cumsum(weight * interval)
    lower, upper = sums[:-1] / fast, (sums[-1] - sums[:-1]) / slow
    best = int(np.argmax(fast * slow * (upper - lower) ** 2))
    return float(lower[best] + upper[best]) / 2


def _switches(intervals: Samples) -> list[int]:
    """Return the numbers of the intervals at which a regime begins, except the first."""
    switches, waiting = [], [(0, intervals.size, 0)]
    while waiting:
        begin, end, halved = waiting.pop()
        if end - begin < 2 * _LEAST * _BLOCK:
            continue
        cut = _switch(intervals[begin:end])
        if cut is not None:
            switches.append(begin + cut)
        elif halved == _HALVES:
            continue
        middle = begin + (cut or (end - begin) // 2)
        halvings = halved + (cut is None)
        waiting += [(begin, middle, halvings), (middle, end, halvings)]
    switches.sort()
    while True:  # drop the smallest false switch
        pieces = np.split(intervals, switches)
        wrong = [
            (abs(before.mean() - after.mean()), number)
            for number, (before, after) in enumerate(pairwise(pieces))
            if not _is_step(before, after)
        ]
        if not wrong:
            return switches
        del switches[min(wrong)[1]]


def _switch(intervals: Samples) -> int | None:
    """Return the number of the interval at which the mean changes, if it does."""
    block = _length(intervals.size)
    if not _changes(_means(intervals, block))[_LEAST - 1 : -_LEAST].max(initial=0.0) > _WHOLE:
        return None
    sums = np.cumsum(intervals - intervals.mean())[:-1]
    count = np.arange(1, intervals.size)
    least = _LEAST * block - 1
    contrast = np.abs(sums) / np.sqrt(count * (intervals.size - count))
    return int(np.argmax(contrast[least:-least])) + least + 1


def _is_step(before: Samples, after: Samples) -> bool:
    """Whether two pieces differ by a step, also close by, and not by a drift."""
    means = before.mean(), after.mean()
    if abs(means[1] - means[0]) <= _STEP * min(means):
        return False
    block = _length(before.size + after.size)
    early, late = _means(before[before.size % block :], block), _means(after, block)
    near = min(_BESIDE, early.size, late.size)
    if not _changes(np.concatenate([early[early.size - near :], late[:near]]))[near - 1] > _NEAR:
        return False
    both = np.concatenate([early, late])
    drift, _ = np.linalg.qr(legendre.legvander(np.linspace(-1, 1, both.size), _SMOOTH))
    smooth = both - drift @ (drift.T @ both)
    return bool(early.size * early.var() + late.size * late.var() < _LESS * (smooth @ smooth))


def _length(count: int) -> int:
    return max(_BLOCK, count // _MOST)


def _means(intervals: Samples, block: int) -> Samples:
    """Return the means of whole blocks."""
    count = intervals.size // block
    return np.asarray(intervals[: count * block].reshape(count, block).mean(axis=1))


def _changes(values: Samples) -> Samples:
    """(n - 1,) self-normalised statistics: the mean of (n,) values changes after each of them."""
    values = values - values.mean()
    sums, before = _partial(values)
    _, after = _partial(values[::-1])
    spread = (before[:-1] + after[-2::-1]) / values.size**2
    floor: float = np.finfo(float).tiny
    return np.asarray(sums[:-1] ** 2 / values.size / np.maximum(spread, floor))


def _partial(values: Samples) -> tuple[Samples, Samples]:
    """Return (n,) partial sums, and the sums of their squares about the line of their mean."""
    count = np.arange(1.0, values.size + 1)
    sums = np.cumsum(values)
    line = sums / count
    squares = np.cumsum(sums**2) - 2 * line * np.cumsum(count * sums)
    return sums, squares + line**2 * np.cumsum(count**2)
