"""Which added mass, or that of which log, may have been told wrong, and what would fit."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar

from butterfly.errors import ButterflyError
from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.findings import Finding, FindingKind
from butterfly.identification.diagnostics.unit_errors.names import UnitError
from butterfly.identification.diagnostics.unit_errors.trial import (
    FOLLOWED,
    NOTHING,
    Explanation,
    Trial,
    attempt_roughly,
    carrying,
    thinned,
    trial_of,
)
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators import Estimator, HarmonicBalance
from butterfly.identification.inference.mass_consistency import Correction, disagreeing
from butterfly.model.parameters import AddedMass
from butterfly.verdict import Level

_ROUNDS = 8  # in which a mass is corrected about the parameters found with it
_SETTLED = 1e-3  # relative change of a mass that is none
_LOGS = 3  # that are suspected alone, the most evident ones
_LEAST = -0.05  # of the largest mass, below which a mass is no rounding's
_MASSES = 41  # that are tried in the place of a log's own
_FOLLOWED_AGAIN = 0.3  # share of a log's misfit that another mass must leave at most
_CERTAIN = 100.0  # F statistic of a mass that is wrong for certain


@dataclass(frozen=True, kw_only=True, eq=False)
class _Corrected:
    """A data set with one mass corrected: whose and to what, and how it is explained then."""

    suspect: Correction
    mass: AddedMass
    trial: Trial
    left: float


def wrong_masses(data: DataSet, quick: Estimator) -> list[Explanation]:
    """Return the masses that may be wrong, one at a time; with three, any may be."""
    data = _used(data, quick)
    whole = _estimated(data, quick)
    found = whole.corrections if whole else ()
    evident = [each for each in found if each.evident]
    disagree = any(_is_whole(each, data) for each in evident)
    groups = [each for each in found if disagree and _is_whole(each, data)]
    singles = [each for each in disagreeing(found, data.masses) if not _is_whole(each, data)][
        :_LOGS
    ]
    tried = [_corrected(data, quick, each) for each in (*groups, *singles)]
    possible = [each for each in tried if each is not None and each.trial.misfit < FOLLOWED]
    least = min((each.left for each in possible), default=0.0)
    agreeing = [each for each in possible if each.left <= 2 * least]
    return [_explanation(data, each, len(agreeing)) for each in agreeing]


def mass_of_one_log(data: DataSet, quick: Estimator) -> list[Explanation]:
    """Return the log that spoils all others, if it may have carried another mass than was given.

    The estimate from all logs cannot tell it then, so each is left out in turn.
    """
    data = _used(data, quick)
    tried = [_corrected(data, quick, each) for each in _suspects_alone(data, quick)]
    possible = [each for each in tried if each is not None and each.trial.misfit < FOLLOWED]
    best = sorted(possible, key=lambda each: (each.left, each.trial.misfit))[:1]
    return [_explanation(data, each, 1) for each in best]


def mass_of_unfollowed(data: DataSet, estimate: Estimate) -> list[Explanation]:
    """Return the logs that the model does not follow, but would with another mass."""
    unfollowed = {
        name
        for each in estimate.findings
        if each.kind is FindingKind.UNFOLLOWED
        for name in each.logs
    }
    numbers = [k for k, log in enumerate(data.logs) if log.name in unfollowed]
    if not 0 < len(numbers) <= _LOGS:
        return []
    trial = trial_of(data, estimate)
    if trial is NOTHING:
        return []
    found = []
    for number in numbers:
        mass, misfit = _fitting_mass(data, estimate, number)
        if misfit < _FOLLOWED_AGAIN * trial.misfits[number]:
            told = data.logs[number].added_mass
            suspect = Correction(
                told=told, logs=(number,), change=mass.mass - told.mass, evidence=math.inf
            )
            alone = Trial(misfits=np.array([misfit]))
            corrected = _Corrected(suspect=suspect, mass=mass, trial=alone, left=0.0)
            found.append(_explanation(data, corrected, 1))
    return found


def _fitting_mass(data: DataSet, estimate: Estimate, number: int) -> tuple[AddedMass, float]:
    """Return the mass with which a model follows one log best, and its misfit then."""
    log, largest = data.logs[number], max(data.masses)
    arm = log.added_mass.arm or largest.arm
    alone = data.take([number])

    def misfit(mass: float) -> float:
        carried = carrying(alone, [replace(log.added_mass, mass=mass, arm=arm)])
        return float(trial_of(carried, estimate).misfits[0])

    tried = [each.mass for each in data.masses] + list(largest.mass * np.linspace(0, 2, _MASSES))
    best = min(tried, key=misfit)
    reach = 2 * largest.mass / (_MASSES - 1)
    bounds = max(best - reach, 0.0), best + reach
    fine = minimize_scalar(misfit, bounds=bounds, method="bounded", options={"xatol": 1e-3 * reach})
    mass = fine.x if fine.fun < misfit(best) else best
    return replace(log.added_mass, mass=float(mass), arm=arm), misfit(float(mass))


def _used(data: DataSet, quick: Estimator) -> DataSet:
    """Return the logs that an estimator uses."""
    if isinstance(quick, HarmonicBalance):
        return data.take([k for k, point in enumerate(data.points) if point is not None])
    return data


def _suspects_alone(data: DataSet, quick: Estimator) -> list[Correction]:
    """Suspect the log without which the rest agrees best to have carried another's mass."""
    numbers = range(len(data.logs))
    if len(numbers) == 1:
        return []
    misfits = []
    for number in numbers:
        rest = thinned(data.take([k for k in numbers if k != number]))
        misfits.append(attempt_roughly(lambda same: same, rest, quick).misfit)
    worst = int(np.argmin(misfits))
    if misfits[worst] > FOLLOWED:
        return []
    told = data.logs[worst].added_mass
    return [
        Correction(told=told, logs=(worst,), change=other.mass - told.mass, evidence=math.inf)
        for other in data.masses
        if other != told
    ]


def _is_whole(suspect: Correction, data: DataSet) -> bool:
    """Whether it is about all logs that are said to have carried the mass."""
    return len(suspect.logs) == sum(log.added_mass == suspect.told for log in data.logs)


def _corrected(data: DataSet, quick: Estimator, suspect: Correction) -> _Corrected | None:
    """Correct a mass about the parameters, and the parameters about the mass, until it settles."""
    masses = [log.added_mass for log in data.logs]
    largest = max(masses)
    mass, arm = suspect.told, suspect.told.arm or largest.arm
    change, found = suspect.change, None
    for _ in range(_ROUNDS):
        if mass.mass + change < _LEAST * largest.mass:
            return None
        mass = replace(mass, mass=max(mass.mass + change, 0.0), arm=arm)
        for number in suspect.logs:
            masses[number] = mass
        found = _estimated(carrying(data, masses), quick)
        if found is None:
            return None
        change = next((each.change for each in found.corrections if each.logs == suspect.logs), 0.0)
        if abs(change) <= _SETTLED * mass.mass:
            break
    assert found is not None  # noqa: S101 - there is a round
    wrong = disagreeing(found.corrections, masses)
    left = max((each.evidence for each in wrong), default=0.0)
    trial = trial_of(carrying(data, masses), found)
    return _Corrected(suspect=suspect, mass=mass, trial=trial, left=left)


def _estimated(data: DataSet, quick: Estimator) -> Estimate | None:
    try:
        with np.errstate(all="ignore"):
            return quick(data)
    except (ButterflyError, np.linalg.LinAlgError, ArithmeticError):
        return None


def _explanation(data: DataSet, corrected: _Corrected, ways: int) -> Explanation:
    """Name a wrong mass, which is one of some that would explain as much."""
    suspect = corrected.suspect
    whole = _is_whole(suspect, data)
    certain = suspect.evidence > _CERTAIN
    finding = Finding(
        kind=FindingKind.UNIT_ERROR,
        parameters=(UnitError.MASS, str(suspect.told), str(ways)),
        number=float(corrected.mass.mass),
        severity=Level.WARNING if certain else Level.CARE,
        logs=() if whole else tuple(data.logs[k].name for k in suspect.logs),
    )
    bare = whole and suspect.told.mass == 0
    return Explanation(finding=finding, misfit=corrected.trial.misfit, last=bare)
