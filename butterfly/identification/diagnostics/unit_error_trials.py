"""How well a joint explains logs as they are, or as they would be without a slip."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from butterfly.errors import ButterflyError
from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.findings import Finding, FindingKind
from butterfly.identification.diagnostics.plausibility import is_possible
from butterfly.identification.diagnostics.unit_errors import UnitError
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators import Estimator
from butterfly.logs.log import Log
from butterfly.model.parameters import AddedMass
from butterfly.signals.frequency_response import response_point
from butterfly.verdict import Level

FOLLOWED = 0.6
"""Misfit with which a slip undone must leave the logs at most."""

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


def attempt(undo: Callable[[DataSet], DataSet], data: DataSet, estimator: Estimator) -> Trial:
    """Undo a slip, estimate, and simulate; roughly at first, and no more if that is hopeless."""
    rough = attempt_roughly(undo, data, estimator)
    if rough is not NOTHING and rough.misfit > _HOPELESS:
        return rough
    return _attempted(undo, data, estimator)


def attempt_roughly(
    undo: Callable[[DataSet], DataSet], data: DataSet, estimator: Estimator
) -> Trial:
    """Undo a slip, estimate without terms, and simulate."""
    return _attempted(undo, data, estimator.roughly)


def _attempted(
    undo: Callable[[DataSet], DataSet],
    data: DataSet,
    estimate: Callable[[DataSet], Estimate],
) -> Trial:
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
    if not np.isfinite(estimate.values).all():
        return NOTHING
    if not is_possible(estimate, data.masses):
        return NOTHING
    whole = replace(estimate, horizon=estimate.horizon or math.inf)
    fits = data.simulations.fits(whole)
    misfits = np.nan_to_num(1 - fits / 100, nan=_NONE, posinf=_NONE)
    return Trial(misfits=np.minimum(misfits, _NONE))


@dataclass(frozen=True, kw_only=True)
class Explanation:
    """A slip, and the misfit that is left without it."""

    finding: Finding  # that names it
    misfit: float  # median over the logs
    last: bool = False  # whether it is far-fetched, and named after others that explain as much

    @classmethod
    def of(cls, slip: UnitError, factor: float, trial: Trial) -> Explanation:
        """Return what a trial of a whole data set without a slip says."""
        finding = Finding(FindingKind.UNIT_ERROR, (slip,), number=factor, severity=Level.WARNING)
        return cls(finding=finding, misfit=trial.misfit)

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
    """A slip, the factor that undoes it, and how a data set would be without it."""

    slip: UnitError  # which, and the factor
    factor: float
    # returns the data set as it would be; InputError if its sines would be none
    undo: Callable[[DataSet], DataSet]


def of_angle(slip: UnitError, factor: float) -> Hypothesis:
    """Suppose that the angle is in a unit of ``factor`` rad."""

    def undo(data: DataSet) -> DataSet:
        logs = tuple(replace(log, angle=factor * log.angle) for log in data.logs)
        points = tuple(
            None if point is None else replace(point, angle=point.angle.scaled(factor))
            for point in data.points
        )
        return replace(data, logs=logs, points=points)

    return Hypothesis(slip=slip, factor=factor, undo=undo)


def of_arms(slip: UnitError, factor: float) -> Hypothesis:
    """Suppose that the arms are in a unit of ``factor`` m."""

    def undo(data: DataSet) -> DataSet:
        return carrying(
            data, [replace(log.added_mass, arm=factor * log.added_mass.arm) for log in data.logs]
        )

    return Hypothesis(slip=slip, factor=factor, undo=undo)


def of_logs(slip: UnitError, factor: float, undo: Callable[[Log], Log]) -> Hypothesis:
    """Suppose that the columns of the logs are not what they are said to be."""

    def undone(data: DataSet) -> DataSet:
        logs = tuple(map(undo, data.logs))
        points = tuple(response_point(log) if log.excitation else None for log in logs)
        return replace(data, logs=logs, points=points)

    return Hypothesis(slip=slip, factor=factor, undo=undone)


def carrying(data: DataSet, masses: Sequence[AddedMass]) -> DataSet:
    """Return a data set whose logs carried other masses."""
    logs = tuple(replace(log, added_mass=mass) for log, mass in zip(data.logs, masses, strict=True))
    points = tuple(
        None if point is None else replace(point, added_mass=mass)
        for point, mass in zip(data.points, masses, strict=True)
    )
    return replace(data, logs=logs, points=points)


CLOCKS = (
    of_logs(
        UnitError.MILLISECONDS, 1e-3, lambda log: replace(log, time=1e-3 * log.time, lead=None)
    ),
    of_logs(
        UnitError.MICROSECONDS, 1e-6, lambda log: replace(log, time=1e-6 * log.time, lead=None)
    ),
)

OTHERS = (
    of_angle(UnitError.DEGREES, math.pi / 180),
    of_logs(
        UnitError.SWAPPED,
        1.0,
        lambda log: replace(log, input=log.angle, angle=log.input, lead=None),
    ),
    of_arms(UnitError.MILLIMETRES, 1e-3),
    of_arms(UnitError.CENTIMETRES, 1e-2),
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
    every = [of_angle(UnitError.COUNTS, 2 * math.pi / each) for each in numbers]
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
