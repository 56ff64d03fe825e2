"""Forest plots: half-widths of intervals in per cent of the value, on one logarithmic axis."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from butterfly.identification.parameter import Parameter

MOST = 100.0
"""Per cent of the value at which the axis ends: beyond it a value may be 0."""


class Axis(NamedTuple):
    """The axis of a forest plot, as the header of its column: powers of ten in per cent."""

    first: int
    last: int

    @property
    def decades(self) -> list[float]:
        """The per cents of its marks, evenly spaced."""
        return [10.0**power for power in range(self.first, self.last + 1)]

    def place(self, percent: float) -> float:
        """Return where a size is, from 0 to 100 along the axis: at an end if beyond it."""
        power = math.log10(self.clipped(percent))
        return round(100 * (power - self.first) / (self.last - self.first), 2)

    def clipped(self, percent: float) -> float:
        """Return a size as it is drawn."""
        return min(max(abs(percent), self.decades[0]), self.decades[-1])

    def __str__(self) -> str:
        return ""


class Bar(NamedTuple):
    """A row of a forest plot: sizes in per cent of a value; None where there is nothing to draw."""

    axis: Axis
    half_width: float | None  # of the 95 % interval, up to its farther limit
    left_out: float | None  # deviation of the farthest estimate without one mass
    true: float | None  # deviation of the truth
    may_be_zero: bool

    def __str__(self) -> str:
        return ""


def forest(rows: Sequence[Parameter]) -> list[Bar]:
    """Return the rows of an estimate's table as bars on one axis, which ends at 100 % at most."""
    marks = []
    for row in rows:
        limits = (None, None) if row.known else (row.lower, row.upper)
        half = _farthest(row.value, *limits)
        left_out = _farthest(row.value, row.least_left_out, row.largest_left_out)
        zero = half is not None and (row.lower or 0.0) <= 0.0 <= (row.upper or 0.0)
        marks.append((half, left_out, _farthest(row.value, row.true, row.true), zero))
    sizes = [min(size, MOST) for half, deviation, *_ in marks for size in (half, deviation) if size]
    powers = [math.log10(size) for size in sizes]
    last = math.ceil(max(powers, default=math.log10(MOST)))
    axis = Axis(min(math.floor(min(powers, default=last)), last - 1), last)
    return [Bar(axis, *mark) for mark in marks]


def _farthest(value: float | None, *limits: float | None) -> float | None:
    """Return how far the farther limit is from a value, in per cent of it; endless of 0."""
    if value is None:
        return None
    known = [limit for limit in limits if limit is not None and math.isfinite(limit - value)]
    if len(known) < len(limits):
        return None
    most = max(abs(limit - value) for limit in known)
    if value == 0.0:
        return math.inf if most else 0.0
    return 100 * most / abs(value)


def forest_caption(bars: Sequence[Bar]) -> str:
    """Explain the marks of a forest plot, those that it has."""
    if all(bar.half_width is None for bar in bars):
        return ""
    parts = [
        "Bars: half-width of the 95 % interval in % of the value, on a logarithmic axis; shorter "
        "is better."
    ]
    if any(bar.may_be_zero for bar in bars):
        parts.append("Orange: the interval includes 0.")
    if any(bar.left_out for bar in bars):
        parts.append(
            "Grey: the farthest estimate without the logs of one added mass, which the interval "
            "includes; where it is long, the model lacks something that depends on the mass."
        )
    if any(bar.true is not None for bar in bars):
        parts.append("Green: distance to the true value.")
    return " ".join(parts)
