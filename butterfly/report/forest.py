"""Forest plots: estimates with their intervals on one axis, in per cent of the value."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from butterfly.identification.parameter import Parameter

MOST = 100.0
"""Per cent of the value at which the axis ends: beyond it a value may be 0."""

SPARE = 1.05
"""Of an axis, beyond the farthest mark."""

_STEPS = (1.0, 2.0, 5.0, 10.0)  # of the first digit of an axis' end

Ends = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class Marks:
    """What a row of a forest plot shows, of anything that is no `Parameter`."""

    value: float
    lower: float | None
    upper: float | None
    true: float | None = None
    known: bool = False
    least_left_out: float | None = None
    largest_left_out: float | None = None


@dataclass(frozen=True, kw_only=True)
class Whisker:
    """A row of a forest plot: what is known of a value, in per cent of it and from it on."""

    reach: float  # % at the ends of the axis
    limits: Ends | None = None  # of the 95 % interval
    left_out: Ends | None = None  # of the estimates that leave a mass out
    true: float | None = None  # where it is known
    may_be_zero: bool = False

    @property
    def drawn(self) -> bool:
        """Whether there is an interval to draw."""
        return self.limits is not None

    def limits_of(self, *, zero: bool) -> Ends | None:
        """Return its interval if the value may be 0, or if it cannot; else None."""
        return self.limits if self.may_be_zero == zero else None

    def clipped(self, percent: float) -> float:
        """Return a deviation in per cent as it is drawn: at an end of the axis if beyond it."""
        return min(max(percent, -self.reach), self.reach)

    def place(self, percent: float) -> float:
        """Return where a deviation is, from 0 to 100 along the axis."""
        return round(50 * (1 + self.clipped(percent) / self.reach), 2)

    def __str__(self) -> str:
        return ""


class Axis(NamedTuple):
    """The axis of a forest plot, as the header of its column: per cent at either end."""

    reach: float

    @classmethod
    def of(cls, whiskers: Sequence[Whisker]) -> Axis:
        """Return the axis that rows share."""
        return cls(max((each.reach for each in whiskers), default=MOST))

    def __str__(self) -> str:
        return ""


def forest(rows: Sequence[Parameter | Marks]) -> list[Whisker]:
    """Return the rows of an estimate's table as marks on one axis.

    Its ends hold the widest interval of a value that cannot be 0, and are 100 % at most.
    """
    marks = [_marks(row) for row in rows]
    known = [
        abs(number)
        for limits, left_out, true, zero in marks
        for number in (
            *(() if zero else limits or ()),
            *(() if zero else left_out or ()),
            true or 0,
        )
        if math.isfinite(number)
    ]
    reach = _rounded(min(SPARE * max(known, default=0.0) or MOST, MOST))
    return [
        Whisker(reach=reach, limits=limits, left_out=left_out, true=true, may_be_zero=zero)
        for limits, left_out, true, zero in marks
    ]


def _marks(row: Parameter | Marks) -> tuple[Ends | None, Ends | None, float | None, bool]:
    limits = None if row.known else _ends(row.lower, row.upper, row.value)
    left_out = _ends(row.least_left_out, row.largest_left_out, row.value)
    zero = limits is not None and (row.lower or 0.0) <= 0.0 <= (row.upper or 0.0)
    return limits, left_out, None if row.true is None else _percent(row.true, row.value), zero


def _ends(lower: float | None, upper: float | None, value: float) -> Ends | None:
    if lower is None or upper is None or not (math.isfinite(lower) and math.isfinite(upper)):
        return None
    return _percent(lower, value), _percent(upper, value)


def _percent(number: float, value: float) -> float:
    """Return how far a number is from a value, in per cent of it; endless of a value of 0."""
    if value == 0.0:
        return 0.0 if number == 0.0 else math.copysign(math.inf, number)
    return 100 * (number - value) / abs(value)


def _rounded(reach: float) -> float:
    """Return the next number whose first digit is 1, 2 or 5."""
    decade = 10.0 ** math.floor(math.log10(reach))
    return min(step * decade for step in _STEPS if step * decade >= reach * (1 - 1e-9))


def forest_caption(whiskers: Sequence[Whisker]) -> str:
    """Explain the marks of a forest plot, those that it has."""
    drawn = [each for each in whiskers if each.drawn]
    if not drawn:
        return ""
    parts = ["One axis, in % of each value. Blue: 95 % interval around the estimate."]
    if any(each.may_be_zero for each in drawn):
        parts.append("Orange: the interval holds 0.")
    if any(abs(end) > each.reach for each in drawn for end in each.limits or ()):
        parts.append("A bar that reaches the edge goes on beyond it.")
    if any(each.left_out for each in drawn):
        parts.append(
            "Grey: range of the estimates without the logs of one added mass, which the interval "
            "includes; where it is wide, the model misses something that depends on the mass."
        )
    if any(each.true is not None for each in drawn):
        parts.append("Green: the true value.")
    return " ".join(parts)
