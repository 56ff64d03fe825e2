"""Numbers as a person would write them."""

from __future__ import annotations

import math


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
