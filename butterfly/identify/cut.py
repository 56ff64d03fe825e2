"""What is left of a log of which a stretch is cut out."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from butterfly.logs.log import MIN_SAMPLES
from butterfly.signals.local_polynomial import slope
from butterfly.signals.window import MIN_PERIODS

if TYPE_CHECKING:
    from butterfly.logs.log import Log

_REACH = 0.05  # s on either side, over which the velocity is taken


def pieces_beside(log: Log, stretch: slice) -> list[Log]:
    """Return the pieces of a log before and after a stretch of it.

    Free runs start at rest: the piece after the stretch begins where the joint next turns back or
    rests. A piece that is too short to be used is left out.

    Parameters
    ----------
    log
        With increasing stamps.
    stretch
        Of its samples.
    """
    first, last, _ = stretch.indices(log.time.size)
    sides = {"before": slice(0, first), "after": slice(_next_at_rest(log, last), None)}
    pieces = []
    for side, samples in sides.items():
        numbers = np.arange(log.time.size)[samples]
        if numbers.size < MIN_SAMPLES:
            continue
        piece = replace(log.take(numbers), name=f"{log.name}, {side}")
        if _usable(piece):
            pieces.append(piece)
    return pieces


def _next_at_rest(log: Log, number: int) -> int:
    """Return the first sample from one on where the joint turns back or rests; n if nowhere."""
    reach = max(2, round(_REACH / log.mean_step))
    if number == 0 or log.time.size - number < 2 * reach + 1:
        return number if number == 0 else log.time.size
    speeds = slope(log.angle[number:], reach, 2, log.mean_step)
    turns = np.flatnonzero(speeds[:-1] * speeds[1:] <= 0)
    return number + int(turns[0]) if turns.size else log.time.size


def _usable(piece: Log) -> bool:
    """Whether a piece moves, and holds enough periods if it is a sine."""
    if np.ptp(piece.angle) == 0:
        return False
    if piece.excitation is None:
        return True
    periods = float(np.ptp(piece.time)) * piece.excitation.omega / (2 * math.pi)
    return periods > MIN_PERIODS + 1
