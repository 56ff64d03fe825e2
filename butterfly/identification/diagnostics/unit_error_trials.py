"""How well a joint explains logs as they are, or as they would be without a mistake."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from butterfly.errors import ButterflyError
from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.findings import Finding
from butterfly.identification.diagnostics.plausibility import is_possible
from butterfly.identification.diagnostics.unit_errors import FACTORS, UnitError, unit_error
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators import Estimator
from butterfly.logs.log import Log
from butterfly.model.parameters import AddedMass
from butterfly.signals.frequency_response import response_point

FOLLOWED = 0.6
"""Misfit with which a mistake undone must leave the logs at most."""

_MOST_STEPS = 200_000  # samples that are simulated for a trial, about
_NONE = 1e3  # misfit of logs that no joint explains
_HOPELESS = 1.0  # misfit without any terms, from which on terms do not help

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


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial:
    """How well a joint explains logs."""

    # (n,) 1 - FIT/100 of each log: 0 is perfect, 1 no better than a constant
    misfits: NDArray[np.float64]

    @property
    def misfit(self) -> float:
        """Median over the logs."""
        return float(np.median(self.misfits))


NOTHING = Trial(misfits=np.array([_NONE]))
"""Of logs that tell no parameters, or such as no joint can have."""


Undo: TypeAlias = Callable[[DataSet], DataSet]
"""Returns data as they would be without a mistake; InputError if their sines would be none."""


def attempt(data: DataSet, estimator: Estimator, undo: Undo = lambda same: same) -> Trial:
    """Undo a mistake, estimate, and simulate; roughly at first, and no more if that is hopeless."""
    rough = attempt_roughly(data, estimator, undo)
    if rough is not NOTHING and rough.misfit > _HOPELESS:
        return rough
    return _attempted(data, estimator, undo)


def attempt_roughly(data: DataSet, estimator: Estimator, undo: Undo = lambda same: same) -> Trial:
    """Undo a mistake, estimate without terms, and simulate."""
    return _attempted(data, estimator.roughly, undo)


def _attempted(data: DataSet, estimate: Callable[[DataSet], Estimate], undo: Undo) -> Trial:
    try:
        with np.errstate(all="ignore"):
            undone = undo(data)
            return trial_of(undone, estimate(undone))
    except (ButterflyError, np.linalg.LinAlgError, ArithmeticError):
        return NOTHING


def trial_of(data: DataSet, estimate: Estimate) -> Trial:
    """Simulate logs with an estimate, if a joint can be so.

    Logs are simulated whole, unless the estimate says otherwise: wrong units make any motion look
    as if small causes grew.
    """
    if not (np.isfinite(estimate.values).all() and is_possible(estimate, data.masses)):
        return NOTHING
    whole = replace(estimate, horizon=estimate.horizon or math.inf)
    misfits = np.nan_to_num(1 - data.simulations.fits(whole) / 100, nan=_NONE, posinf=_NONE)
    return Trial(misfits=np.minimum(misfits, _NONE))


@dataclass(frozen=True, kw_only=True)
class Explanation:
    """A mistake, and the misfit that is left without it."""

    finding: Finding  # that names it
    misfit: float  # median over the logs
    last: bool = False  # whether it is far-fetched, and named after others that explain as much

    def of_a_mass(self, other: Explanation) -> bool:
        """Whether this and another are of masses, between which the motion cannot choose."""
        return all(each.finding.parameters[0] == UnitError.MASS for each in (self, other))


def thinned(data: DataSet) -> DataSet:
    """Return some of the logs, those of every added mass, as many as a trial may take."""
    sizes = [log.time.size for log in data.logs]
    count = max(4 * len(data.masses), int(_MOST_STEPS / np.mean(sizes)))
    if count >= len(sizes):
        return data
    kept: list[int] = []
    for mass in data.masses:
        own = [k for k, log in enumerate(data.logs) if log.added_mass == mass]
        share = max(4, round(count * len(own) / len(sizes)))
        picked = np.linspace(0, len(own) - 1, min(share, len(own))).round().astype(int)
        kept += [own[k] for k in picked]
    return data.take(sorted(kept))


@dataclass(frozen=True, kw_only=True)
class Hypothesis:
    """A mistake in a whole data set, and what undoes it."""

    error: UnitError
    factor: float
    undo: Undo

    def tried(self, data: DataSet, estimator: Estimator) -> Explanation:
        """Return how well the logs are explained without it."""
        trial = attempt(data, estimator, self.undo)
        return Explanation(finding=unit_error(self.error, self.factor), misfit=trial.misfit)


def _of_angle(error: UnitError, factor: float) -> Hypothesis:
    """Suppose that the angle is in a unit of ``factor`` rad."""

    def undo(data: DataSet) -> DataSet:
        logs = tuple(replace(log, angle=factor * log.angle) for log in data.logs)
        points = tuple(
            None if point is None else replace(point, angle=point.angle.scaled(factor))
            for point in data.points
        )
        return replace(data, logs=logs, points=points)

    return Hypothesis(error=error, factor=factor, undo=undo)


def _of_arms(error: UnitError) -> Hypothesis:
    """Suppose that the arms are in another unit."""
    factor = FACTORS[error]

    def undo(data: DataSet) -> DataSet:
        masses = [log.added_mass for log in data.logs]
        return carrying(data, [replace(each, arm=factor * each.arm) for each in masses])

    return Hypothesis(error=error, factor=factor, undo=undo)


def _of_columns(error: UnitError, factor: float, undo: Callable[[Log], Log]) -> Hypothesis:
    """Suppose that the columns of the logs are not what they are said to be."""

    def undone(data: DataSet) -> DataSet:
        logs = tuple(map(undo, data.logs))
        points = tuple(response_point(log) if log.excitation else None for log in logs)
        return replace(data, logs=logs, points=points)

    return Hypothesis(error=error, factor=factor, undo=undone)


def _of_stamps(error: UnitError) -> Hypothesis:
    """Suppose that the stamps are in another unit."""
    factor = FACTORS[error]
    return _of_columns(error, factor, lambda log: replace(log, time=factor * log.time, lead=None))


def carrying(data: DataSet, masses: Sequence[AddedMass]) -> DataSet:
    """Return a data set whose logs carried other masses."""
    logs = tuple(replace(log, added_mass=mass) for log, mass in zip(data.logs, masses, strict=True))
    points = tuple(
        None if point is None else replace(point, added_mass=mass)
        for point, mass in zip(data.points, masses, strict=True)
    )
    return replace(data, logs=logs, points=points)


CLOCKS = (_of_stamps(UnitError.MILLISECONDS), _of_stamps(UnitError.MICROSECONDS))

OTHERS = (
    _of_angle(UnitError.DEGREES, FACTORS[UnitError.DEGREES]),
    _of_columns(
        UnitError.SWAPPED,
        1.0,
        lambda log: replace(log, input=log.angle, angle=log.input, lead=None),
    ),
    _of_arms(UnitError.MILLIMETRES),
    _of_arms(UnitError.CENTIMETRES),
)


def fitting_counts(data: DataSet, estimator: Estimator) -> list[Explanation]:
    """Suppose that the angle is in counts, with the number per turn that fits best.

    There is nothing to suppose where all swing as an angle in rad may. Where all swings are small,
    sin th is th and many numbers fit: the motion tells no unit then. Angles that are no whole
    numbers are named as counts after all else that explains as much.
    """
    swing = max(float(np.ptp(log.angle)) / 2 for log in data.logs)
    if swing < _SWINGS[1]:
        return []
    whole = all(
        bool(np.allclose(log.angle, np.rint(log.angle), atol=_ROUNDING)) for log in data.logs
    )
    least, most = (2 * math.pi * swing / each for each in reversed(_SWINGS))
    numbers = [each for each in PER_TURN if least <= each <= most]
    every = [_of_angle(UnitError.COUNTS, 2 * math.pi / each) for each in numbers]
    coarse = {
        k: attempt_roughly(data, estimator, every[k].undo).misfit
        for k in range(0, len(every), _COARSE)
    }
    if not coarse:
        return []
    best = min(coarse, key=lambda k: coarse[k])
    near = every[max(best - _COARSE + 1, 0) : best + _COARSE]
    tried = [each.tried(data, estimator) for each in near]
    return [replace(min(tried, key=lambda each: each.misfit), last=not whole)]
