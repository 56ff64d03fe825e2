"""Which number of counts per turn an angle in counts may have."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.unit_errors.hypotheses import of_angle
from butterfly.identification.diagnostics.unit_errors.names import Slip
from butterfly.identification.diagnostics.unit_errors.trial import (
    Explanation,
    attempt,
    attempt_roughly,
)
from butterfly.identification.estimators import Estimator

PER_TURN = tuple(
    sorted(
        {2**k for k in range(6, 25)}
        | {a * 10**k for a in (100, 125, 200, 250, 360, 400, 500, 512, 720) for k in range(5)}
        - {360}
    )
)
"""Counts per turn of common encoders, after their fourfold evaluation too; 360 are degrees."""

_SWINGS = (0.02, 3.0)  # rad, that the widest log may have
_ROUNDING = 1e-6  # of a count
_COARSE = 5  # of how many numbers one is tried first


def fitting_counts(data: DataSet, estimator: Estimator) -> list[Explanation]:
    """Suppose that the angle is in counts, with the number per turn that fits best.

    Where all swings are small, sin th is th and many numbers fit: the motion tells no unit then.
    Angles that are no whole numbers are named as counts after all else that explains as much.

    Parameters
    ----------
    data
        The logs; there is nothing to suppose where all swing as an angle in rad may.
    estimator
        A quick one.
    """
    swing = max(float(np.ptp(log.angle)) / 2 for log in data.logs)
    if swing < _SWINGS[1]:
        return []
    whole = all(
        bool(np.allclose(log.angle, np.rint(log.angle), atol=_ROUNDING)) for log in data.logs
    )
    least, most = (2 * math.pi * swing / each for each in reversed(_SWINGS))
    numbers = [each for each in PER_TURN if least <= each <= most]
    every = [of_angle(Slip.COUNTS, 2 * math.pi / each) for each in numbers]
    coarse = {
        k: attempt_roughly(every[k].undo, data, estimator).misfit
        for k in range(0, len(every), _COARSE)
    }
    if not coarse:
        return []
    best = min(coarse, key=lambda k: coarse[k])
    near = every[max(best - _COARSE + 1, 0) : best + _COARSE]
    tried = [
        Explanation.of(each.slip, each.factor, attempt(each.undo, data, estimator)) for each in near
    ]
    return [replace(min(tried, key=lambda each: each.misfit), last=not whole)]
