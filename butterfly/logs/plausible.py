"""Numbers that no bench has: their squares and ratios would leave the range of doubles."""

from __future__ import annotations

import numpy as np

from butterfly.errors import InputError
from butterfly.logs.log import Log

_USED = ("time", "input", "angle")
_LARGEST = 1e30  # of any column, in its own unit
_SMALLEST = 1e-30  # range of any that is not constant, and step of the clock


def refuse_implausible(log: Log) -> None:
    """Raise InputError for a log whose numbers are too large, or differ by too little.

    Parameters
    ----------
    log
        With increasing stamps and finite values.
    """
    for name in _USED:
        column = getattr(log, name)
        largest = max(float(column.max()), -float(column.min()))
        if largest > _LARGEST:
            expected = f"numbers below {_LARGEST:g}"
            raise InputError(log.source, name, f"numbers up to {largest:.3g}", expected)
        span = float(column.max()) - float(column.min())
        if 0 < span < _SMALLEST:
            found = f"numbers that differ by {span:.3g} at most"
            raise InputError(log.source, name, found, f"a range above {_SMALLEST:g}")
    shortest = float(np.diff(log.time).min())
    if shortest < _SMALLEST:
        expected = f"stamps that differ by more than {_SMALLEST:g} s"
        raise InputError(log.source, "time", f"stamps {shortest:.3g} s apart", expected)
