"""The table of parameters as texts and marks: what console, page and notebook show of it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from butterfly.identification.parameter import Parameter, or_nan

_MARGIN = 0.1  # of the range that a whisker shows, on either side


@dataclass(frozen=True, kw_only=True)
class Whisker:
    """An estimate with its interval as a mark in a row of a table: a line of a forest plot."""

    value: float
    limits: tuple[float, float] | None = None  # of its 95 % interval
    left_out: tuple[float, float] | None = None  # range of estimates that leave a mass out
    true: float | None = None  # where it is known

    @property
    def scale(self) -> tuple[float, float]:
        """Ends of an axis that holds all of it."""
        known = [self.value, *(self.limits or ()), *(self.left_out or ())]
        known += [] if self.true is None else [self.true]
        least, most = min(known), max(known)
        spare = _MARGIN * (most - least) or abs(least) or 1.0
        return least - spare, most + spare

    @property
    def zero(self) -> float | None:
        """Where 0 is, from 0 to 100 along the axis; None if it is not on it."""
        least, most = self.scale
        return self.place(0.0) if least <= 0.0 <= most else None

    def place(self, number: float) -> float:
        """Return where a number is, from 0 to 100 along the axis."""
        least, most = self.scale
        return round(100 * (number - least) / (most - least), 2)

    @property
    def drawn(self) -> bool:
        """Whether there is an interval to draw, of finite limits."""
        return self.limits is not None and all(map(math.isfinite, self.scale))

    def __str__(self) -> str:
        return ""


@dataclass(frozen=True, kw_only=True)
class ParameterRow:
    """A row as texts, empty where there is nothing to say; ``whisker`` is the same to be drawn."""

    symbol: str
    meaning: str
    unit: str
    value: str
    error: str
    interval: str
    width: str
    left_out: str
    true: str
    deviation: str
    whisker: Whisker


def parameter_rows(table: Iterable[Parameter]) -> list[ParameterRow]:
    """Return the rows of an estimate's table as texts."""
    return [
        ParameterRow(
            symbol=each.symbol,
            meaning=each.meaning,
            unit=each.unit,
            value=with_error(each.value, or_nan(each.standard_error)),
            error=_error(each),
            interval="–" if each.known else interval(or_nan(each.lower), or_nan(each.upper)),
            width=_width(each),
            left_out=_left_out(each),
            true="" if each.true is None else f"{each.true:.5g}",
            deviation="" if each.deviation is None else f"{100 * each.deviation:+z.2f} %",
            whisker=_whisker(each),
        )
        for each in table
    ]


def _width(row: Parameter) -> str:
    """Return half the interval over the value; of one that may as well be 0, that it may."""
    if row.known or row.lower is None or row.upper is None:
        return "–"
    if row.lower <= 0 <= row.upper:
        return "may be 0"
    if not row.value:
        return "–"
    return f"± {50 * (row.upper - row.lower) / abs(row.value):.2g} %"


def _whisker(row: Parameter) -> Whisker:
    lower, upper = (None, None) if row.known else (row.lower, row.upper)
    least, largest = row.least_left_out, row.largest_left_out
    return Whisker(
        value=row.value,
        limits=None if lower is None or upper is None else (lower, upper),
        left_out=None if least is None or largest is None else (least, largest),
        true=row.true,
    )


def _left_out(row: Parameter) -> str:
    if row.least_left_out is None or row.largest_left_out is None:
        return ""
    return interval(row.least_left_out, row.largest_left_out)


def _error(row: Parameter) -> str:
    if row.known:
        return "known"
    return "–" if row.standard_error is None else f"{row.standard_error:#.2g}"


def with_error(value: float, error: float) -> str:
    """Write ``value`` to the second digit of its standard error, or to five digits without one.

    A value that is no number is a dash.
    """
    if not math.isfinite(value):
        return "–"
    if not (math.isfinite(error) and error > 0):
        return f"{value:.5g}"
    if abs(value) < error / 10:
        return f"{value:.1g}"
    return f"{value:#.{significant_digits(value, error)}g}".rstrip(".")


def significant_digits(value: float, error: float) -> int:
    """Count the digits of ``value`` down to the second digit of ``error``."""
    if value == 0:
        return 2
    return max(math.floor(math.log10(abs(value))) - math.floor(math.log10(error)) + 2, 2)


def interval(lower: float, upper: float) -> str:
    """Write an interval to the second digit of a quarter of its width; a dash if there is none."""
    if not (math.isfinite(lower) and math.isfinite(upper)):
        return "–"
    error = (upper - lower) / 4
    return f"[{with_error(lower, error)}, {with_error(upper, error)}]"
