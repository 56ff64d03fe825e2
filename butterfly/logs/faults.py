"""Faults of clocks, amplifiers and encoders: where in a log they are, and how to repair them.

Timestamps that fall back or repeat; flat tops of an input at its limit, and of an angle beyond its
encoder's range; jumps of an angle by a turn while the joint moves on.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import Samples

Rows = NDArray[np.intp]
Mask = NDArray[np.bool_]

_SIDE = 16  # samples on either side of a restart of the clock, at least
_MOST_RESTARTS = 10  # that are looked for
_MOST_FALLS = 32  # of the clock that are looked at for each
_SPLICED = 0.1  # share of the shorter side that must be gained by keeping some of both

_SEVERAL = 3  # flat tops of an input, fewer of which may be chance: 0 of 4,500 rounded inputs were
_FINEST = 1e-9  # share of its range below which steps of an input are rounding of doubles
_STRAIGHT = 1e-3  # share of its height by which a ramp may bend: a sine cut at .4 bends by twice it
_FLAT = 5  # samples at one extreme value that make a suspicious flat top
_ENOUGH = 4096  # samples that show the noise
_NEAR_TOP = 12.0  # resolutions below its flat top at which the speed of a signal is looked at
_NEAREST = 6  # samples beside its flat top at which it is looked at, at least
_OVERSHOOT = 4.0  # uncertainties of its height by which a clipped signal would have passed the top

_TURN = 2 * math.pi
_NEAR_TURN = math.pi / 2  # rad by which a jump may miss a turn, as the joint goes on meanwhile
_SLACK = 0.05  # rad by which it may miss it at rest
_BLURRED = 0.1  # other large steps for each jump, of a log whose jumps stand out no more
_WHOLE = 0.75  # share of the span that a jump by an unknown turn takes, at least
_SMALL = 0.25  # share of it that all other steps stay below
_SWEPT = 0.5  # share of it that the joint passes between two jumps, at least once
_BACK = 0.75  # share of the jumps that go against the motion, at least
_BESIDE = 3  # steps on either side of a jump that show the motion, or bring an outlier back
_SNAP = 0.002  # by which an encoder's turn may miss a whole share or multiple of the joint's


def increasing(time: Samples) -> Mask:
    """Return a (n,) mask that keeps as many (n,) timestamps in s as possible, strictly increasing.

    Of two equal timestamps the first is kept. Where the clock restarts, only the longer side is
    kept: a mixture of both may have as many samples, but of two motions.
    """
    begin, end, mask = 0, time.size, _longest(time)
    for _ in range(_MOST_RESTARTS):
        restart = _restart(time[begin:end], mask)
        if restart is None:
            break
        earlier, later = map(_longest, np.split(time[begin:end], [restart]))
        sizes = np.count_nonzero(earlier), np.count_nonzero(later)
        if np.count_nonzero(mask) - max(sizes) > _SPLICED * min(sizes):
            break
        if sizes[0] >= sizes[1]:
            end, mask = begin + restart, earlier
        else:
            begin, mask = begin + restart, later
    stay = np.zeros(time.size, dtype=np.bool_)
    stay[begin:end] = mask
    return stay


def restarts(time: Samples) -> list[int]:
    """Return the numbers of the samples at which the clock restarts."""
    rows: list[int] = []
    for k in (1 + np.flatnonzero(np.diff(time) < 0)).tolist():
        before, after = time[max(k - _SIDE, 0) : k], time[k : k + _SIDE]
        near = rows and k - rows[-1] < _SIDE
        if not near and np.median(after) < np.median(before):
            rows.append(k)
    return rows


@np.errstate(over="ignore", invalid="ignore")  # of absurd timestamps
def cut_by_thousand(time: Samples) -> int | None:
    """Return the sample from which time and its steps are divided by 1000: 1.000 after 999."""
    steps = np.diff(time)
    falls = 1 + np.flatnonzero(steps[1:-1] < 0)
    before, after = steps[falls - 1], steps[falls + 1]
    there = np.abs(1000 * time[falls + 1] - time[falls] - before) <= before / 2
    rows = falls[there & (np.abs(1000 * after - before) <= before / 2)]
    return int(rows[0]) + 1 if rows.size else None


def repeated(time: Samples, mask: Mask) -> Mask:
    """Return which dropped samples repeat the timestamp of the last one kept."""
    dropped, stays = np.flatnonzero(~mask), np.flatnonzero(mask)
    before = np.searchsorted(stays, dropped)
    rows = dropped[before > 0]
    repeats = np.zeros(time.size, dtype=np.bool_)
    repeats[rows] = time[rows] == time[stays[before[before > 0] - 1]]
    return repeats


def _longest(time: Samples) -> Mask:
    """Return a longest strictly increasing subsequence: patience sorting of what is in dispute."""
    if np.all(time[1:] >= time[:-1]):
        return np.diff(time, prepend=-np.inf) > 0
    highest = np.maximum.accumulate(time)
    lowest = np.minimum.accumulate(time[::-1])[::-1]
    mask = np.ones(time.size, dtype=np.bool_)  # above all before and below all after: in each
    mask[1:] &= time[1:] > highest[:-1]
    mask[:-1] &= time[:-1] < lowest[1:]
    disputed = np.flatnonzero(~mask)
    mask[disputed[_piled(time[disputed])]] = True
    return mask


def _piled(values: Samples) -> list[int]:
    """Return the numbers of a longest increasing subsequence, which prefers what came first."""
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
    numbers = []
    number = on_top[-1]
    while number >= 0:
        numbers.append(number)
        number = below[number]
    return numbers


def _restart(time: Samples, mask: Mask) -> int | None:
    """Return where the clock restarts in the longest dropped run, by the largest step back."""
    edges = np.flatnonzero(np.diff(mask, prepend=True, append=True)).reshape(-1, 2)
    if not edges.size:
        return None
    begin, end = edges[np.argmax(edges[:, 1] - edges[:, 0])]
    first = max(int(begin), _SIDE)
    steps = np.diff(time[first - 1 : min(int(end), time.size - _SIDE) + 1])
    deepest = first + np.argsort(steps)[:_MOST_FALLS]
    lasting = {
        float(np.median(time[k : k + _SIDE]) - np.median(time[k - _SIDE : k])): int(k)
        for k in deepest
    }
    fall = min(lasting, default=0.0)
    return lasting[fall] if fall < 0 else None


def saturated(values: Samples, time: Samples) -> int:
    """Count samples in flat runs at either extreme at which an input is cut off, repeatedly.

    It reaches them at speed. An input that goes from one held level straight to the next, as a
    relay or steps do whose rate is limited, is switched, not cut off: so is a triangle whose tips
    are lost at both ends, which nothing distinguishes from it.
    """
    resolution = max(resolution_of(values), _FINEST * float(np.ptp(values)))
    flats: list[tuple[int, int, bool]] = []  # first sample, length, whether reached at speed
    for level in (values.min(), values.max()):
        drop = np.abs(values - level)
        runs = _flat_runs(drop == 0)
        for begin, (length, sides) in zip(runs[0].tolist(), _flanked(drop, *runs), strict=True):
            fast = all(_runs_on(side, length, resolution) for side in sides)
            flats.append((begin, length, fast))
    shortest = min((length for _, length, fast in flats if fast), default=0)
    if not shortest:
        return 0
    switched = _switched(values, time, shortest)
    lengths = [length for begin, length, fast in flats if fast and not switched[begin]]
    others = len(flats) - len(lengths)
    return sum(lengths) if len(lengths) >= max(_SEVERAL, others) else 0


def _switched(values: Samples, time: Samples, shortest: int) -> dict[int, bool]:
    """Return by the first sample of each level held whether the input goes straight to others.

    A level is held for at least ``shortest`` samples. Before the first and after the last one
    nothing shows where the input comes from or goes to: it counts as straight.
    """
    edges = np.concatenate([[0], np.flatnonzero(np.diff(values)) + 1, [values.size]])
    held = np.flatnonzero(np.diff(edges) >= shortest)
    starts, ends = edges[held], edges[held + 1]
    steps = np.abs(np.diff(values))
    quantum = float(np.min(steps, where=steps > 0, initial=np.inf))
    clocks = time, np.arange(values.size, dtype=np.float64)  # a rate may be one per cycle
    between = [slice(end, begin) for end, begin in zip(ends[:-1], starts[1:], strict=True)]
    straight = [
        any(_is_straight(clock[part], values[part], quantum) for clock in clocks)
        for part in between
    ]
    straight = [True, *straight, True]
    return {
        int(begin): before and after
        for begin, (before, after) in zip(starts, pairwise(straight), strict=True)
    }


def _is_straight(clock: Samples, values: Samples, quantum: float) -> bool:
    """Whether (n,) values lie on a line over a clock, but for their rounding."""
    if values.size < 3:  # noqa: PLR2004 - two points are always on one
        return True
    along = clock - clock.mean()
    rate = float(along @ values) / float(along @ along)
    residuals = values - values.mean() - rate * along
    return float(np.sqrt(np.mean(residuals**2))) <= quantum + _STRAIGHT * float(np.ptp(values))


def _flanked(
    drop: Samples, starts: Rows, ends: Rows, lengths: Rows | None = None
) -> Iterator[tuple[int, tuple[Samples, Samples]]]:
    """Yield the length of each flat run, and the drop on both sides, outwards."""
    lengths = ends - starts if lengths is None else lengths
    sides = np.split(drop, np.column_stack([starts, ends]).ravel())[::2]
    for length, (entry, leave) in zip(lengths.tolist(), pairwise(sides), strict=True):
        yield length, (entry[::-1], leave)


def _runs_on(drop: Samples, length: int, resolution: float) -> bool:
    """Whether a signal reaches a flat run at speed, by its drop beside it."""
    distance = 1 + (_first(drop, 1.5 * resolution) if drop.size else 0)
    if drop.size <= 3 * distance:
        return False
    near = max(_first(drop, _NEAR_TOP * resolution), _NEAREST)
    if 2 * near <= drop.size and drop[2 * near - 2] > 4.0 * drop[near]:  # faster than a parabola:
        return False  # it settles, as behind a lag
    moves = drop[3 * distance] > 1.5 * drop[0]  # a rounded top is at most so long, a step jumps:
    return bool(moves and length > 2 / (math.sqrt(2) - 1) * distance)


def clipped(angle: Samples) -> int:
    """Count samples in flat runs at either extreme that the angle enters and leaves at speed."""
    resolution, count = resolution_of(angle), 0
    for level in (angle.min(), angle.max()):
        drop = np.abs(angle - level)
        starts, ends = _flat_runs(drop == 0)
        if starts.size:
            span = float(drop.max())
            for length, sides in _flanked(drop, *_tops(drop, starts, ends, _NEAR_TOP * resolution)):
                # both: a joint that sticks where it turns may leave it abruptly
                count += length * all(at_speed(side, resolution, span) for side in sides)
    return count


def _tops(drop: Samples, starts: Rows, ends: Rows, near: float) -> tuple[Rows, Rows, Rows]:
    """Join (k,) flat runs between which a signal stays near its top; return their lengths too."""
    gaps = np.column_stack([ends[:-1], starts[1:]]).ravel()
    between = np.maximum.reduceat(drop, gaps)[::2] if gaps.size else np.empty(0)
    first = np.concatenate([[0], np.flatnonzero(between >= near) + 1])
    last = np.concatenate([first[1:], [starts.size]]) - 1
    return starts[first], ends[last], np.add.reduceat(ends - starts, first)


def _flat_runs(on_top: Mask) -> tuple[Rows, Rows]:
    """Return starts and ends of the runs of at least `_FLAT` samples of a mask."""
    edges = np.flatnonzero(np.diff(on_top, prepend=False, append=False)).reshape(-1, 2)
    starts, ends = edges[edges[:, 1] - edges[:, 0] >= _FLAT].T
    return starts, ends


def resolution_of(angle: Samples) -> float:
    """Return the resolution of an angle in rad: the encoder's step, or the noise."""
    sizes = np.abs(np.diff(angle))
    step = np.min(sizes, where=sizes > 0, initial=np.inf)
    rows = np.linspace(1, angle.size - 2, min(angle.size, _ENOUGH)).astype(np.intp)
    bends = np.abs(angle[rows - 1] - 2.0 * angle[rows] + angle[rows + 1])
    return float(max(step, np.median(bends)))


def at_speed(drop: Samples, resolution: float, span: float) -> bool:
    """Whether a signal reaches its flat top at speed, rather than coming to rest on it.

    From its drop v n + a n^2/2 at two distances of n samples from the top, it would have risen by
    v^2/(2 a) beyond it. A signal that comes to rest seems to overshoot too, but at most by the
    resolution and the rise within a sample. Beyond half of its span a swing is not a parabola: a
    signal too coarse to show its speed before is skipped.
    """
    if drop.size <= 2 * _NEAREST:
        return False
    near = max(_first(drop, _NEAR_TOP * resolution), _NEAREST)
    far, around = 2 * near, near // 4
    if far + around >= drop.size:
        return False
    near_drop, far_drop = (float(drop[k - around : k + around + 1].mean()) for k in (near, far))
    if far_drop > 0.5 * span:
        return False
    speed = (4.0 * near_drop - far_drop) / (2.0 * near)
    deceleration = max((far_drop - 2.0 * near_drop) / near**2, 0.0)
    uncertainty = resolution + 0.5 * deceleration
    return speed > 0 and speed**2 > 2.0 * deceleration * _OVERSHOOT * uncertainty


def _first(values: Samples, level: float) -> int:
    """Return the index of the first value that reaches a level; the number of values if none."""
    reached = values >= level
    first = int(np.argmax(reached))
    return first if reached[first] else values.size


@dataclass(frozen=True)
class Wrapping:
    """Jumps of an angle by a turn of its encoder."""

    turn: float  # rad
    exact: bool  # 1/N or a multiple of the joint's turn; else measured, and drifts
    rows: Rows  # (n,) numbers of the samples before them


def find_wrapping(angle: Samples, gap: Mask) -> Wrapping | None:
    """Find where an (n,) angle in rad jumps by a turn; None if nowhere.

    The turn is 2 pi, or a multiple (a counter that restarts), if jumps of this size stand out from
    all other steps. Else it is any size by which the angle jumps at least twice across its span,
    against the motion, if no other step comes near it. An outlier, which comes back, is not a jump.
    ``gap``: (n - 1,) whether the motion within an interval is unknown.
    """
    steps = np.diff(angle)
    span = float(np.ptp(angle))
    if float(max(steps.max(), -steps.min())) < min(_TURN - _NEAR_TURN, _WHOLE * span):
        return None
    sizes = np.abs(steps)
    known = np.where(gap, 0.0, steps)
    turn = _whole_turns(known) or _encoders_turn(angle, known, span)
    if turn is None:
        return None
    ratio = round(turn / _TURN) or 1 / round(_TURN / turn)
    exact = abs(turn / (_TURN * ratio) - 1.0) < _SNAP
    turn = _TURN * ratio if exact else turn
    return Wrapping(turn, exact, np.flatnonzero(np.abs(sizes - turn) < 0.25 * turn))


def unwrapped(angle: Samples, wrapping: Wrapping) -> Samples:
    """Return the continuous (n,) angle."""
    jumps = np.zeros(angle.size)
    rows = wrapping.rows
    jumps[rows + 1] = wrapping.turn * np.sign(angle[rows] - angle[rows + 1])
    return np.asarray(angle + np.cumsum(jumps))


def _whole_turns(steps: Samples) -> float | None:
    """Return 2 pi, or a multiple, if steps of this size stand out."""
    sizes = np.abs(steps)
    large = sizes > _TURN - _NEAR_TURN
    if not large.any():
        return None
    turn = _TURN * round(float(np.median(sizes[large])) / _TURN)
    jump = np.abs(sizes - turn) < _NEAR_TURN
    others = sizes[~jump]
    if not jump.any() or not others.size:
        return None
    blurred = np.count_nonzero(others > _NEAR_TURN) > _BLURRED * np.count_nonzero(jump)
    usual = float(others[others <= _NEAR_TURN].max(initial=0.0))
    fits = np.abs(sizes[jump] - turn) <= 2.0 * usual + _SLACK
    lasting = turn == _TURN or not _comes_back(np.sign(steps) * jump)
    return turn if lasting and not blurred and fits.any() else None


def _comes_back(jumps: Samples) -> bool:
    """Whether each jump, 1 or -1 among zeros, is undone soon after."""
    rows = np.flatnonzero(jumps)
    pairs = zip(rows[::2], rows[1::2], strict=False)
    undone = [jumps[i] == -jumps[j] and j - i <= _BESIDE for i, j in pairs]
    return rows.size % 2 == 0 and all(undone)


def _encoders_turn(angle: Samples, steps: Samples, span: float) -> float | None:
    """Return the turn of an encoder that is not on the joint, or has another range."""
    sizes = np.abs(steps)
    rows = np.flatnonzero(sizes >= _WHOLE * span)
    others = np.delete(sizes, rows)
    if rows.size < 2 or not others.size or others.max() > _SMALL * span:  # noqa: PLR2004
        return None
    if max(float(np.ptp(piece)) for piece in np.split(angle, rows + 1)) < _SWEPT * span:
        return None
    neighbours = rows[:, None] + np.setdiff1d(np.arange(-_BESIDE, _BESIDE + 1), [0])
    near = steps[np.clip(neighbours, 0, steps.size - 1)]
    motion = np.median(np.where(np.abs(near) >= _WHOLE * span, 0.0, near), axis=1)
    if np.mean(motion * steps[rows] < 0) < _BACK:
        return None
    return float(np.mean(sizes[rows] + np.abs(motion)))
