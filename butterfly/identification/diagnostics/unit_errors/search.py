"""Look for the slip that explains what is wrong with an identification, or with its refusal."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.findings import Finding, FindingKind
from butterfly.identification.diagnostics.unit_errors.inputs import unit_errors_of_omega
from butterfly.identification.diagnostics.unit_errors.masses import (
    mass_of_one_log,
    mass_of_unfollowed,
    wrong_masses,
)
from butterfly.identification.diagnostics.unit_errors.names import UnitError
from butterfly.identification.diagnostics.unit_errors.trial import (
    CLOCKS,
    FOLLOWED,
    NOTHING,
    OTHERS,
    Explanation,
    Hypothesis,
    Trial,
    attempt,
    fitting_counts,
    thinned,
    trial_of,
)
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators import Estimator, HarmonicBalance, WeakForm
from butterfly.identification.inference.mass_consistency import disagreeing
from butterfly.logs.log import Log
from butterfly.model.parameters import AddedMass
from butterfly.verdict import Level

_CLEARLY = 0.5  # share of the misfit that a slip undone must leave at most
_FAR_MORE = 0.3  # share of the misfit that a far-fetched slip must leave at most to come first
_AS_GOOD = 1.3  # times the least misfit, below which a slip explains as much
_LONGEST_TRIAL = 50_000.0  # s that may be simulated to see whether seconds are right
_EXPLAINED = 0.2  # misfit of logs that a joint explains as they are: a method refused, no slip
_ROOM = 0.005  # misfit that makes no difference

_TELLING = {FindingKind.POOR_FIT, FindingKind.UNFOLLOWED, FindingKind.TORQUE_DRIVEN}
_LONGEST_STEP = 0.05  # s, above which stamps may be no seconds
_LONGEST_LOG = 3600.0  # s
_LONGEST_ARM = 5.0  # m
_COARSEST = 0.02  # rad that an encoder tells apart; 314 counts per turn
_HEAVIEST = 10.0  # kg
_HEAVY = 1.0  # kg, of a motor whose resistance seems to be none
_STEEL = 7850.0  # kg/m^3
_LOOKED_AT = 1000  # samples


def find_unit_errors(data: DataSet, estimator: Estimator, estimate: Estimate) -> list[Finding]:
    """Name the slips that explain what speaks against an estimate; cheap where nothing does.

    The estimate has all other findings on it.
    """
    told = unit_errors_of_omega(data.logs, data.points)
    if told:
        return told
    heavy = [_grams()] if too_heavy(data.masses, estimate) else []
    calm = set(data.calm)
    told_apart = [each for each in estimate.corrections if calm.issuperset(each.logs)]
    disagree = bool(disagreeing(told_apart, data.masses))
    if not (disagree or suspicious(data, estimate)):
        return heavy
    quick = _quick(data, estimator)
    units = _tried(data, quick, OTHERS) if suspicious(data, estimate) else []
    masses = wrong_masses(data, quick)
    before = _before(data, estimator, estimate, quick)
    best = _best([*units, *masses], before)
    if disagree and not best:
        best = [each.finding for each in _ordered(masses)]
    alone = [each.finding for each in mass_of_unfollowed(data, estimate)]
    return best or alone or _best(_of_one_log(data, quick, before), before) or heavy


def find_unit_errors_of_refused(data: DataSet, estimator: Estimator) -> list[Finding]:
    """Name the slips but for which there would be an estimate."""
    quick = _quick(data, estimator)
    before = attempt(lambda same: same, thinned(data), quick)
    if before.misfit < _EXPLAINED:
        return []
    return _best(_tried(data, quick, (*CLOCKS, *OTHERS)), before)


def find_unit_errors_of_clock(data: DataSet, estimator: Estimator) -> list[Finding]:
    """Name the slip that makes stamps advance slowly, before they are simulated for ages."""
    if not slow_clock(data):
        return []
    quick, some = _quick(data, estimator), thinned(data)
    span = sum(float(log.time[-1] - log.time[0]) for log in some.logs)
    before = attempt(lambda same: same, some, quick) if span < _LONGEST_TRIAL else NOTHING
    return _best(_tried(data, quick, CLOCKS), before)


def _before(data: DataSet, estimator: Estimator, estimate: Estimate, quick: Estimator) -> Trial:
    """Return how well a joint explains the logs as they are: a poor method is no slip of theirs."""
    found = trial_of(data, estimate)
    if isinstance(estimator, type(quick)):
        return found
    return min(found, attempt(lambda same: same, data, quick), key=lambda trial: trial.misfit)


def _quick(data: DataSet, estimator: Estimator) -> Estimator:
    """Return an estimator of the same kind that takes no time."""
    if isinstance(estimator, HarmonicBalance | WeakForm):
        return estimator.unchecked()
    sines = all(point is not None for point in data.points)
    return HarmonicBalance(check=False) if sines else WeakForm(check=False)


def _tried(data: DataSet, quick: Estimator, hypotheses: Iterable[Hypothesis]) -> list[Explanation]:
    some = thinned(data)
    tried = [
        Explanation.of(each.slip, each.factor, attempt(each.undo, some, quick))
        for each in hypotheses
    ]
    return tried + fitting_counts(some, quick)


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


def _of_one_log(data: DataSet, quick: Estimator, before: Trial) -> list[Explanation]:
    """Look for a log that spoils all others, where all are spoiled."""
    return mass_of_one_log(data, quick) if before.misfit > FOLLOWED else []


def _grams() -> Finding:
    return Finding(
        kind=FindingKind.UNIT_ERROR, parameters=(UnitError.GRAMS,), number=1e-3, severity=Level.CARE
    )


def suspicious(data: DataSet, estimate: Estimate) -> bool:
    """Whether an estimate, or the sizes in its data, are those of a slip."""
    return (
        any(each.severity is Level.WARNING or each.kind in _TELLING for each in estimate.findings)
        or any(mass.arm > _LONGEST_ARM for mass in data.masses)
        or any(point.amplitude > math.pi for point in data.sines)
        or all(angle_step(log) >= _COARSEST for log in data.logs)
    )


def slow_clock(data: DataSet) -> bool:
    """Whether the stamps of a data set advance as those of no robot that is controlled."""
    steps = [log.mean_step for log in data.logs]
    spans = [log.time[-1] - log.time[0] for log in data.logs]
    return bool(np.median(steps) > _LONGEST_STEP or np.median(spans) > _LONGEST_LOG)


def too_heavy(masses: Sequence[AddedMass], estimate: Estimate) -> bool:
    """Whether a mass is too heavy for its place: so heavy, so large, or for such a motor.

    In grams all masses, and with them all parameters but the delay, are a thousand times too large,
    which the motion does not tell. A ball of steel that reaches halfway to the pivot is too large;
    a voltage-fed motor of almost no resistance is one whose torque is too large.
    """
    driven = any(each.kind is FindingKind.TORQUE_DRIVEN for each in estimate.findings)
    return any(
        mass.mass > min(_HEAVY if driven else _HEAVIEST, _ball(mass.arm / 2))
        for mass in masses
        if mass.arm > 0
    )


def _ball(radius: float) -> float:
    """Mass in kg of a ball of steel with a radius in m."""
    return _STEEL * 4 / 3 * math.pi * radius**3


def angle_step(log: Log) -> float:
    """Return the least distance in rad between readings of the angle in the middle of a log."""
    middle = log.angle.size // 2
    changes = np.abs(np.diff(log.angle[middle : middle + _LOOKED_AT]))
    return float(np.min(changes[changes > 0], initial=math.inf)) if changes.any() else 0.0
