"""Choose the part of a log in which the response is steady."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from butterfly.errors import InputError
from butterfly.logs.log import Log

STEADY_SECONDS = 30.0
"""Length of the window at the log's end, as in the thesis; the transient before it is left out."""

MIN_PERIODS = 3
"""Fewest whole periods that a window must hold."""


def steady_window(log: Log, omega: float, seconds: float = STEADY_SECONDS) -> NDArray[np.bool_]:
    """Return the (n,) mask of the last whole periods of a log (see `steady_span`)."""
    return np.asarray(log.time > log.time[-1] - steady_span(log, omega, seconds))


def steady_span(log: Log, omega: float, seconds: float = STEADY_SECONDS) -> float:
    """Return the length in s of the last whole periods of a log.

    Whole periods keep the sine, its harmonics and the mean orthogonal on a uniform clock.

    At most `seconds`, if that holds `MIN_PERIODS` periods; as many are used of slower sines. A log
    shorter than `seconds` is used whole, one shorter than `MIN_PERIODS` periods is an InputError.
    """
    period = 2 * math.pi / omega
    available = float(log.time[-1] - log.time[0])
    whole = math.floor(available / period)
    if whole < MIN_PERIODS:
        raise InputError(
            log.source,
            "time",
            f"{available:.3g} s",
            f"at least {MIN_PERIODS} periods of {period:.3g} s",
        )
    longest = math.floor(min(seconds, available) / period)
    return max(longest, MIN_PERIODS) * period


def first_counted(log: Log, seconds: float = STEADY_SECONDS) -> int:
    """Return the number of the first sample whose free-run error counts.

    It begins the last ``seconds`` of a sine's log, whose start depends on how the joint came to
    rest; logs of other inputs count from their first sample.
    """
    if log.excitation is None:
        return 0
    return int(np.searchsorted(log.time, log.time[-1] - seconds))
