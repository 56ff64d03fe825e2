"""Which logs of a sine have settled to a steady swing about the rest angle, and which have not."""

from __future__ import annotations

import math

import numpy as np

from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.findings import Finding, FindingKind
from butterfly.verdict import Level

LARGEST_SWING = 1.6
"""In rad, beyond which the steady response to a sine is no sine any more, even nearly."""

_UNSETTLED = 0.5  # of the swing: what a sine, its harmonics and a transient leave over
_CHANGED = 0.5  # of the swing: by how much it grows or falls within the window
_ELSEWHERE = 0.8  # rad between the middle of a swing and the rest angle
_MANY = 1 / 3  # share of the sines left out, from which on it is no detail


def steady_sines(data: DataSet) -> tuple[list[int], list[Finding]]:
    """Return the numbers of the logs whose response to a sine is steady, and what of the others.

    Where the hand turns over, swings too wide, or never settles, its motion has no phasor. One that
    swings about a place a whole turn off does so as well as at home.
    """
    sines = [k for k, point in enumerate(data.points) if point is not None]
    steady = [k for k in sines if _is_steady(data, k)]
    lost = [k for k in sines if k not in steady]
    if not lost:
        return steady, []
    return steady, [
        Finding(
            kind=FindingKind.LEFT_OUT,
            number=len(sines),
            severity=Level.CARE if len(lost) >= _MANY * len(sines) else Level.NOTE,
            logs=tuple(data.logs[k].name for k in lost),
        )
    ]


def _is_steady(data: DataSet, number: int) -> bool:
    point = data.points[number]
    assert point is not None  # noqa: S101 - of a sine
    log, swing = data.logs[number], point.amplitude
    away = math.remainder(point.angle.offset - data.zero_of(log), 2 * math.pi)
    widest = float(np.ptp(log.angle)) / 2
    return (
        0 < swing <= LARGEST_SWING
        and widest <= math.pi / 2 + LARGEST_SWING
        and not point.angle.residual_rms * math.sqrt(2) > _UNSETTLED * swing
        and not abs(point.drift) > _CHANGED
        and (abs(away) < _ELSEWHERE or not data.hangs)
    )
