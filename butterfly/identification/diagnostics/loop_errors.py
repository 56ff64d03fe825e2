"""Mistakes of servos: a set-point that was told as a drive, a gain that was told wrongly.

A joint that follows its input is driven by what is left to go. Averaged over test functions, in
units of the input,

    u = a th + p1' thdd + p2' thd + p3' sin th + p3_offset' cos th + friction' + bias',

each log with primed values of its own, for its gain and mass: a is 0 of a drive, for gravity makes
no linear spring, and 1 of a set-point, which no spring has by nature.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from butterfly.arrays import Samples
from butterfly.errors import ButterflyError
from butterfly.identification.blocks import CELLS
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators import Estimator, OutputError
from butterfly.identification.levels import CLEARLY, LOST, MATTERS, PRECISE
from butterfly.identification.problem import Start
from butterfly.identification.weak_regression import Windows
from butterfly.model.prior import Known, Prior
from butterfly.model.terms import offered

_OTHERS = ("p1", "p2", "p3", "p3_offset", "coulomb", "drag", "bias")


def follows(windows: Sequence[Windows]) -> bool:
    """Whether a is clearly not 0, and 1 as far as the logs tell, or within what counts as known."""
    found = [each for each in map(_cells_of, windows) if each is not None]
    if not found:
        return False
    logs = np.array(found)  # (n, cells, 2)
    information, pull = logs.sum(axis=(0, 1))
    share = pull / information
    scores = logs @ [-share, 1.0]
    scatter = np.sum(scores**2), np.sum(scores.sum(axis=1) ** 2)  # of cells, and of whole logs
    error = np.sqrt(max(scatter)) / information
    return bool(CLEARLY * error < share and abs(share - 1) < max(PRECISE, CLEARLY * error))


def _cells_of(each: Windows) -> Samples | None:
    """(cells, 2) what parts of a log know of a, and where they pull it; None of one undriven."""
    signals = each.averaging.signals((*_OTHERS, "p4", "spring"))
    moving = signals.moving
    names = ("spring", "p4", *_OTHERS)
    spring, drive, *others = (signals.mean[name][moving] for name in names)
    if spring.size <= len(names) or not drive.any():
        return None
    columns = np.column_stack(others)
    columns /= np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
    basis = np.linalg.qr(columns)[0]
    angle, inputs = (rest - basis @ (basis.T @ rest) for rest in (spring, -drive))
    left = inputs - angle * (angle @ inputs) / (angle @ angle)
    variance = float(left @ left) / (left.size - len(names) + 1)
    parts = zip(*(np.array_split(each, CELLS) for each in (angle, inputs)), strict=True)
    return np.array([(own @ own, own @ theirs) for own, theirs in parts]) / variance


def with_free_gain(data: DataSet, estimator: Estimator, before: Estimate) -> Estimate | None:
    """Return the estimate with another P gain, if that leaves half the misfit at most."""
    misfit = 1 - float(np.median(data.simulations.fits(before))) / 100
    if not isinstance(estimator, OutputError) or not any(log.closed for log in data.logs):
        return None
    if "loop_kp" in before.names or misfit < MATTERS:
        return None
    known = data.known | Prior({"loop_kp": Known(value=1.0, uncertainty=math.inf)})
    terms = tuple({*before.names} & {*offered(estimator.method)})
    try:
        found = replace(estimator, terms=terms).of_logs(data.logs, [Start.at(before, data)], known)
    except (ButterflyError, np.linalg.LinAlgError, ArithmeticError):
        return None
    left = 1 - float(np.median(data.simulations.fits(found))) / 100
    return found if abs(found.parameters.loop_kp - 1) > PRECISE and left < LOST * misfit else None
