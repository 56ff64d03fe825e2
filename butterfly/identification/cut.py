"""What is left of a log of which a stretch is cut out."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from butterfly.logs.log import MIN_SAMPLES, Log
from butterfly.signals.window import MIN_PERIODS


def pieces_beside(log: Log, stretch: slice) -> list[Log]:
    """Return the pieces of a log before and after a stretch of it.

    That after it begins in motion (see `Log.piece`). A piece that is too short to be used is left
    out.

    Parameters
    ----------
    log
        With increasing stamps.
    stretch
        Of its samples.
    """
    first, last, _ = stretch.indices(log.time.size)
    sides = {"before": (0, first), "after": (last, log.time.size)}
    pieces = []
    for side, (begin, end) in sides.items():
        if end - begin < MIN_SAMPLES:
            continue
        piece = replace(log.piece(begin, end), name=f"{log.name}, {side}")
        if _usable(piece):
            pieces.append(piece)
    return pieces


def _usable(piece: Log) -> bool:
    """Whether a piece moves, and holds enough periods if it is a sine."""
    if np.ptp(piece.angle) == 0:
        return False
    if piece.excitation is None:
        return True
    periods = float(np.ptp(piece.time)) * piece.excitation.omega / (2 * math.pi)
    return periods > MIN_PERIODS + 1
