"""Flat tops of a signal: an input at its limit, an angle beyond what its encoder can say."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_SHORTEST = 5  # samples at one extreme value that make a suspicious flat top
_SWITCHED = 0.5  # share of its samples that a switched input spends on its extremes, at least
_ENOUGH = 4096  # samples that show the noise
_NEAR = 12.0  # resolutions below its flat top at which the speed of a signal is looked at
_NEAREST = 6  # samples beside its flat top at which it is looked at, at least
_OVERSHOOT = 4.0  # uncertainties of its height by which a clipped signal would have passed the top


def saturated(values: NDArray[np.float64]) -> int:
    """Count samples in flat runs at either extreme of a signal that is not a switched one."""
    extremes = (values.min(), values.max())
    on_top = [values == level for level in extremes]
    if sum(np.count_nonzero(each) for each in on_top) > _SWITCHED * values.size:
        return 0
    return int(sum((ends - starts).sum() for starts, ends in map(_flat_runs, on_top)))


def clipped(angle: NDArray[np.float64]) -> int:
    """Count samples in flat runs at either extreme that the angle enters and leaves at speed.

    Each side counts by itself: a joint that sticks at its turning point may leave it abruptly,
    but its speed had fallen to zero when it came.
    """
    runs = [(level, *_flat_runs(angle == level)) for level in (angle.min(), angle.max())]
    runs = [run for run in runs if run[1].size]
    resolution = _resolution(angle) if runs else 0.0
    return sum(_clipped_at(angle, *run, resolution) for run in runs)


def _clipped_at(
    angle: NDArray[np.float64],
    level: float,
    starts: NDArray[np.intp],
    ends: NDArray[np.intp],
    resolution: float,
) -> int:
    """Count samples in the flat runs at one extreme that the angle enters and leaves at speed."""
    drop = np.abs(angle - level)
    span = float(drop.max())
    starts, ends, lengths = _tops(drop, starts, ends, _NEAR * resolution)
    sides = np.split(drop, np.column_stack([starts, ends]).ravel())[::2]
    return sum(
        int(length)
        for entry, exit_, length in zip(sides[:-1], sides[1:], lengths, strict=True)
        if _at_speed(entry[::-1], resolution, span) and _at_speed(exit_, resolution, span)
    )


def _tops(
    drop: NDArray[np.float64], starts: NDArray[np.intp], ends: NDArray[np.intp], near: float
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
    """Join flat runs between which a signal stays near, as noise has it; return their samples too.

    ``drop``: (n,) distances from the top in rad; ``starts``, ``ends``: (k,) of the flat runs.
    """
    gaps = np.column_stack([ends[:-1], starts[1:]]).ravel()
    between = np.maximum.reduceat(drop, gaps)[::2] if gaps.size else np.empty(0)
    first = np.concatenate([[0], np.flatnonzero(between >= near) + 1])
    last = np.concatenate([first[1:], [starts.size]]) - 1
    return starts[first], ends[last], np.add.reduceat(ends - starts, first)


def _flat_runs(on_top: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return starts and ends of the runs of at least `_SHORTEST` samples of a mask."""
    rows = np.flatnonzero(on_top)
    breaks = np.flatnonzero(np.diff(rows) > 1)
    starts = rows[np.concatenate([[0], breaks + 1])]
    ends = rows[np.concatenate([breaks, [rows.size - 1]])] + 1
    long = ends - starts >= _SHORTEST
    return starts[long], ends[long]


def _resolution(angle: NDArray[np.float64]) -> float:
    """Return how finely angles in rad can be distinguished: the encoder's step, or the noise."""
    sizes = np.abs(np.diff(angle))
    step = np.min(sizes, where=sizes > 0, initial=np.inf)
    rows = np.linspace(1, angle.size - 2, min(angle.size, _ENOUGH)).astype(np.intp)
    bends = np.abs(angle[rows - 1] - 2.0 * angle[rows] + angle[rows + 1])
    return float(max(step, np.median(bends)))


def _at_speed(drop: NDArray[np.float64], resolution: float, span: float) -> bool:
    """Whether a signal runs into its flat top at speed, rather than coming to rest on it.

    By its drop v n + a n^2/2 at two numbers of samples n beside the top, it would have risen by
    v^2/(2 a) beyond it. A signal that comes to rest seems to do so too, but by no more than the
    resolution and what it rises within a sample. Beyond half of its span a swing is no parabola: a
    signal of so few resolutions that its speed cannot be known sooner is passed over.

    ``drop``: (n,) distances from the top in rad, the sample beside it first.
    """
    if drop.size <= 2 * _NEAREST:
        return False
    near = max(_first(drop, _NEAR * resolution), _NEAREST)
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


def _first(values: NDArray[np.float64], level: float) -> int:
    """Return the number of the first value that reaches a level; their count if none does."""
    reached = values >= level
    first = int(np.argmax(reached))
    return first if reached[first] else values.size
