"""Which samples of a faulty clock to keep."""

from __future__ import annotations

from bisect import bisect_left

import numpy as np
from numpy.typing import NDArray

_SHORTEST = 16  # samples on either side of a restart of the clock, at least
_MOST_RESTARTS = 10  # that are looked for
_MOST_FALLS = 32  # of the clock that are looked at for each
_SPLICED = 0.1  # share of the shorter side that must be gained by keeping some of both


def increasing(time: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return a (n,) mask by which (n,) stamps in s increase strictly and as many as can be stay.

    Of two equal stamps the first stays. Where the clock starts again, the longer side stays by
    itself: a beginning of the one and an end of the other are often as many samples, but of two
    motions.
    """
    begin, end, kept = 0, time.size, _longest(time)
    for _ in range(_MOST_RESTARTS):
        restart = _restart(time[begin:end], kept)
        if restart is None:
            break
        earlier, later = map(_longest, np.split(time[begin:end], [restart]))
        sizes = np.count_nonzero(earlier), np.count_nonzero(later)
        if np.count_nonzero(kept) - max(sizes) > _SPLICED * min(sizes):
            break
        if sizes[0] >= sizes[1]:
            end, kept = begin + restart, earlier
        else:
            begin, kept = begin + restart, later
    stay = np.zeros(time.size, dtype=np.bool_)
    stay[begin:end] = kept
    return stay


def restarts(time: NDArray[np.float64]) -> list[int]:
    """Return the numbers of the samples at which the clock falls back, and lastingly.

    A stamp that is late, or early, by itself is none of them.
    """
    found: list[int] = []
    for k in (1 + np.flatnonzero(np.diff(time) < 0)).tolist():
        before, after = time[max(k - _SHORTEST, 0) : k], time[k : k + _SHORTEST]
        near = found and k - found[-1] < _SHORTEST
        if not near and np.median(after) < np.median(before):
            found.append(k)
    return found


def repeated(time: NDArray[np.float64], kept: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which of the samples that were not kept repeat the stamp of the last one kept."""
    dropped, stays = np.flatnonzero(~kept), np.flatnonzero(kept)
    before = np.searchsorted(stays, dropped)
    rows = dropped[before > 0]
    repeats = np.zeros(time.size, dtype=np.bool_)
    repeats[rows] = time[rows] == time[stays[before[before > 0] - 1]]
    return repeats


def _longest(time: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return a longest strictly increasing subsequence.

    A stamp that all earlier ones precede and all later ones follow belongs to every longest one;
    the others are sorted into piles (patience sorting, O(n log n)).
    """
    if np.all(time[1:] >= time[:-1]):
        return np.diff(time, prepend=-np.inf) > 0
    highest = np.maximum.accumulate(time)
    lowest = np.minimum.accumulate(time[::-1])[::-1]
    kept = np.ones(time.size, dtype=np.bool_)
    kept[1:] &= time[1:] > highest[:-1]
    kept[:-1] &= time[:-1] < lowest[1:]
    disputed = np.flatnonzero(~kept)
    kept[disputed[_piled(time[disputed])]] = True
    return kept


def _piled(values: NDArray[np.float64]) -> list[int]:
    """Return the numbers of a longest strictly increasing subsequence of (n,) values.

    Sorted from the last value on, so that of equally long ones that is found which keeps what came
    first and drops what fell behind it.
    """
    tops: list[float] = []
    on_top: list[int] = []
    below = [-1] * values.size
    for number, value in zip(range(values.size - 1, -1, -1), (-values[::-1]).tolist(), strict=True):
        pile = len(tops) if not tops or value > tops[-1] else bisect_left(tops, value)
        if pile:
            below[number] = on_top[pile - 1]
        if pile == len(tops):
            tops.append(value)
            on_top.append(number)
        else:
            tops[pile], on_top[pile] = value, number
    found = []
    number = on_top[-1]
    while number >= 0:
        found.append(number)
        number = below[number]
    return found


def _restart(time: NDArray[np.float64], kept: NDArray[np.bool_]) -> int | None:
    """Return where the clock falls back furthest, and lastingly, in the longest run dropped."""
    edges = np.flatnonzero(np.diff(kept, prepend=True, append=True)).reshape(-1, 2)
    if not edges.size:
        return None
    begin, end = edges[np.argmax(edges[:, 1] - edges[:, 0])]
    first = max(int(begin), _SHORTEST)
    steps = np.diff(time[first - 1 : min(int(end), time.size - _SHORTEST) + 1])
    deepest = first + np.argsort(steps)[:_MOST_FALLS]
    lasting = {
        float(np.median(time[k : k + _SHORTEST]) - np.median(time[k - _SHORTEST : k])): int(k)
        for k in deepest
    }
    fall = min(lasting, default=0.0)
    return lasting[fall] if fall < 0 else None
