"""Look for the mistake that explains what is wrong with an identification, or with its refusal."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar

from butterfly.errors import ButterflyError
from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.findings import Finding, FindingKind
from butterfly.identification.diagnostics.unit_error_trials import (
    CLOCKS,
    FOLLOWED,
    NOTHING,
    OTHERS,
    Explanation,
    Hypothesis,
    Trial,
    attempt,
    attempt_roughly,
    carrying,
    fitting_counts,
    thinned,
    trial_of,
)
from butterfly.identification.diagnostics.unit_errors import (
    UnitError,
    unit_error,
    unit_errors_of_omega,
)
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators import Estimator, HarmonicBalance, WeakForm
from butterfly.identification.inference.consistency import Correction, disagreeing
from butterfly.logs.log import Log
from butterfly.model.parameters import AddedMass

_CLEARLY = 0.5  # share of the misfit that a mistake undone must leave at most
_FAR_MORE = 0.3  # share of the misfit that a far-fetched mistake must leave at most to come first
_AS_GOOD = 1.3  # times the least misfit, below which a mistake explains as much
_LONGEST_TRIAL = 50_000.0  # s that may be simulated to see whether seconds are right
_EXPLAINED = 0.2  # misfit of logs that a joint explains as they are: a method refused, no mistake
_ROOM = 0.005  # misfit that makes no difference

_TELLING = {FindingKind.TORQUE_DRIVEN}
_LONGEST_STEP = 0.05  # s, above which stamps may be no seconds
_LONGEST_LOG = 3600.0  # s
_LONGEST_ARM = 5.0  # m
_COARSEST = 0.02  # rad that an encoder tells apart; 314 counts per turn
_HEAVIEST = 10.0  # kg
_HEAVY = 1.0  # kg, of a motor whose resistance seems to be none
_STEEL = 7850.0  # kg/m^3
_LOOKED_AT = 1000  # samples

_ROUNDS = 8  # in which a mass is corrected about the parameters found with it
_SETTLED = 1e-3  # relative change of a mass that is none
_LOGS = 3  # that are suspected alone, the most evident ones
_LEAST = -0.05  # of the largest mass, below which a mass is no rounding's
_MASSES = 41  # that are tried in the place of a log's own
_FAR_WORSE = 6.0  # times the median misfit, of a log that is not followed as the others are
_NOTABLE = 0.15  # misfit below which a log is followed, however well the others are
_FOLLOWED_AGAIN = 0.3  # share of a log's misfit that another mass must leave at most
_CERTAIN = 100.0  # F statistic of a mass that is wrong for certain


def find_unit_errors(data: DataSet, estimator: Estimator, estimate: Estimate) -> list[Finding]:
    """Name the mistakes that explain what speaks against an estimate; cheap where nothing does.

    The estimate has all other findings on it.
    """
    if of_omega := unit_errors_of_omega(data.logs, data.points):
        return of_omega
    grams = unit_error(UnitError.GRAMS, 1e-3)
    heavy = [grams] if _too_heavy(data.masses, estimate) else []
    calm = set(data.calm)
    corrections = [each for each in estimate.corrections if calm.issuperset(each.logs)]
    disagree = bool(disagreeing(corrections, data.masses))
    if not (disagree or _suspicious(data, estimate)):
        return heavy
    quick = _quick(data, estimator)
    units = _tried(data, quick, OTHERS) if _suspicious(data, estimate) else []
    masses = _wrong_masses(data, quick)
    before = _before(data, estimator, estimate, quick)
    best = _best([*units, *masses], before)
    if disagree and not best:
        best = [each.finding for each in _ordered(masses)]
    alone = [each.finding for each in _mass_of_unfollowed(data, estimate)]
    if best or alone:
        return best or alone
    spoiling = _mass_of_one_log(data, quick) if before.misfit > FOLLOWED else []
    return _best(spoiling, before) or heavy


def find_unit_errors_of_refused(data: DataSet, estimator: Estimator) -> list[Finding]:
    """Name the mistakes but for which there would be an estimate."""
    quick = _quick(data, estimator)
    before = attempt(thinned(data), quick)
    if before.misfit < _EXPLAINED:
        return []
    return _best(_tried(data, quick, (*CLOCKS, *OTHERS)), before)


def find_unit_errors_of_clock(data: DataSet, estimator: Estimator) -> list[Finding]:
    """Name the mistake that makes stamps advance slowly, before they are simulated for ages."""
    if not _slow_clock(data):
        return []
    quick, some = _quick(data, estimator), thinned(data)
    span = sum(float(log.time[-1] - log.time[0]) for log in some.logs)
    before = attempt(some, quick) if span < _LONGEST_TRIAL else NOTHING
    return _best(_tried(data, quick, CLOCKS), before)


def _before(data: DataSet, estimator: Estimator, estimate: Estimate, quick: Estimator) -> Trial:
    """Return how well a joint explains logs as they are: a poor method is no mistake of theirs."""
    found = trial_of(data, estimate)
    if isinstance(estimator, type(quick)):
        return found
    return min(found, attempt(data, quick), key=lambda trial: trial.misfit)


def _quick(data: DataSet, estimator: Estimator) -> Estimator:
    """Return an estimator of the same kind that takes no time."""
    if isinstance(estimator, HarmonicBalance | WeakForm):
        return estimator.unchecked()
    sines = all(point is not None for point in data.points)
    return HarmonicBalance(check=False) if sines else WeakForm(check=False)


def _tried(data: DataSet, quick: Estimator, hypotheses: Iterable[Hypothesis]) -> list[Explanation]:
    some = thinned(data)
    return [*(each.tried(some, quick) for each in hypotheses), *fitting_counts(some, quick)]


def _best(tried: list[Explanation], before: Trial) -> list[Finding]:
    """Return what explains the logs clearly better than they are, and what does so as well."""
    order = _ordered(tried)
    if not order:
        return []
    first = order[0]
    if not first.misfit < min(FOLLOWED, _CLEARLY * before.misfit):
        return []
    most = _AS_GOOD * first.misfit + _ROOM
    return [each.finding for each in order if each.misfit <= most or each.of_a_mass(first)]


def _ordered(tried: list[Explanation]) -> list[Explanation]:
    """Sort by what is left, the far-fetched after the others unless it explains far more."""
    likely = min((each.misfit for each in tried if not each.last), default=math.inf)
    return sorted(
        tried, key=lambda each: (each.last and each.misfit > _FAR_MORE * likely, each.misfit)
    )


def _suspicious(data: DataSet, estimate: Estimate) -> bool:
    """Whether an estimate, or the sizes in its data, are those of a mistake."""
    return (
        any(each.forbids or each.kind in _TELLING for each in estimate.findings)
        or not (data.simulations.fits(estimate) > 100 * (1 - _NOTABLE)).all()
        or any(mass.arm > _LONGEST_ARM for mass in data.masses)
        or any(point.amplitude > math.pi for point in data.sines)
        or all(_angle_step(log) >= _COARSEST for log in data.logs)
    )


def _slow_clock(data: DataSet) -> bool:
    """Whether the stamps of a data set advance as those of no robot that is controlled."""
    steps = [log.mean_step for log in data.logs]
    spans = [log.time[-1] - log.time[0] for log in data.logs]
    return bool(np.median(steps) > _LONGEST_STEP or np.median(spans) > _LONGEST_LOG)


def _too_heavy(masses: Sequence[AddedMass], estimate: Estimate) -> bool:
    """Whether a mass is too heavy for its place: so heavy, so large, or for such a motor.

    In grams all masses, and with them all parameters but the delay, are a thousand times too large,
    which the motion does not tell. A ball of steel that reaches halfway to the pivot is too large;
    a voltage-fed motor of almost no resistance is one whose torque is too large.
    """
    driven = any(each.kind is FindingKind.TORQUE_DRIVEN for each in estimate.findings)
    return any(
        mass.mass
        > min(_HEAVY if driven else _HEAVIEST, _STEEL * 4 / 3 * math.pi * (mass.arm / 2) ** 3)
        for mass in masses
        if mass.arm > 0
    )


def _angle_step(log: Log) -> float:
    """Return the least distance in rad between readings of the angle in the middle of a log."""
    middle = log.angle.size // 2
    changes = np.abs(np.diff(log.angle[middle : middle + _LOOKED_AT]))
    return float(np.min(changes[changes > 0], initial=math.inf)) if changes.any() else 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class _Corrected:
    """A data set with one mass corrected: whose and to what, and how it is explained then."""

    suspect: Correction
    mass: AddedMass
    misfit: float
    left: float  # evidence that masses still disagree


def _wrong_masses(data: DataSet, quick: Estimator) -> list[Explanation]:
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
    possible = [each for each in tried if each is not None and each.misfit < FOLLOWED]
    least = min((each.left for each in possible), default=0.0)
    agreeing = [each for each in possible if each.left <= 2 * least]
    return [
        _explanation(data, each.suspect, each.mass, each.misfit, len(agreeing)) for each in agreeing
    ]


def _mass_of_one_log(data: DataSet, quick: Estimator) -> list[Explanation]:
    """Return the log that spoils all others, if it may have carried another mass than was given.

    The estimate from all logs cannot tell it then, so each is left out in turn.
    """
    data = _used(data, quick)
    tried = [_corrected(data, quick, each) for each in _suspects_alone(data, quick)]
    possible = [each for each in tried if each is not None and each.misfit < FOLLOWED]
    best = sorted(possible, key=lambda each: (each.left, each.misfit))[:1]
    return [_explanation(data, each.suspect, each.mass, each.misfit) for each in best]


def _mass_of_unfollowed(data: DataSet, estimate: Estimate) -> list[Explanation]:
    """Return the logs that the model does not follow, but would with another mass."""
    trial = trial_of(data, estimate)
    if trial is NOTHING:
        return []
    worst = max(_FAR_WORSE * float(np.median(trial.misfits)), _NOTABLE)
    numbers = np.flatnonzero(trial.misfits > worst).tolist()
    if not 0 < len(numbers) <= _LOGS:
        return []
    found = []
    for number in numbers:
        mass, misfit = _fitting_mass(data, estimate, number)
        if misfit < _FOLLOWED_AGAIN * trial.misfits[number]:
            given = data.logs[number].added_mass
            change = mass.mass - given.mass
            suspect = Correction(given=given, logs=(number,), change=change, evidence=math.inf)
            found.append(_explanation(data, suspect, mass, misfit))
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
        misfits.append(attempt_roughly(rest, quick).misfit)
    worst = int(np.argmin(misfits))
    if misfits[worst] > FOLLOWED:
        return []
    given = data.logs[worst].added_mass
    return [
        Correction(given=given, logs=(worst,), change=other.mass - given.mass, evidence=math.inf)
        for other in data.masses
        if other != given
    ]


def _is_whole(suspect: Correction, data: DataSet) -> bool:
    """Whether it is about all logs that are said to have carried the mass."""
    return len(suspect.logs) == sum(log.added_mass == suspect.given for log in data.logs)


def _corrected(data: DataSet, quick: Estimator, suspect: Correction) -> _Corrected | None:
    """Correct a mass about the parameters, and the parameters about the mass, until it settles."""
    masses = [log.added_mass for log in data.logs]
    largest = max(masses)
    mass, arm = suspect.given, suspect.given.arm or largest.arm
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
    misfit = trial_of(carrying(data, masses), found).misfit
    return _Corrected(suspect=suspect, mass=mass, misfit=misfit, left=left)


def _estimated(data: DataSet, quick: Estimator) -> Estimate | None:
    try:
        with np.errstate(all="ignore"):
            return quick(data)
    except (ButterflyError, np.linalg.LinAlgError, ArithmeticError):
        return None


def _explanation(
    data: DataSet, suspect: Correction, mass: AddedMass, misfit: float, ways: int = 1
) -> Explanation:
    """Name a wrong mass, which is one of some that would explain as much."""
    whole = _is_whole(suspect, data)
    finding = unit_error(
        UnitError.MASS,
        float(mass.mass),
        str(suspect.given),
        str(ways),
        logs=() if whole else [data.logs[k] for k in suspect.logs],
        moves=suspect.evidence > _CERTAIN,
    )
    return Explanation(finding=finding, misfit=misfit, last=whole and suspect.given.mass == 0)
