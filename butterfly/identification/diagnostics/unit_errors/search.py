"""Look for the slip that explains what is wrong with an identification, or with its refusal."""

from __future__ import annotations

import math
from collections.abc import Iterable

from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.findings import Finding, FindingKind
from butterfly.identification.diagnostics.unit_errors.counts import fitting_counts
from butterfly.identification.diagnostics.unit_errors.hypotheses import CLOCKS, OTHERS, Hypothesis
from butterfly.identification.diagnostics.unit_errors.inputs import slips_of_omega
from butterfly.identification.diagnostics.unit_errors.masses import (
    mass_of_one_log,
    mass_of_unfollowed,
    wrong_masses,
)
from butterfly.identification.diagnostics.unit_errors.names import Slip
from butterfly.identification.diagnostics.unit_errors.suspicion import (
    slow_clock,
    suspicious,
    too_heavy,
)
from butterfly.identification.diagnostics.unit_errors.trial import (
    FOLLOWED,
    NOTHING,
    Explanation,
    Trial,
    attempt,
    judged,
    thinned,
)
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators import Estimator, HarmonicBalance, WeakForm
from butterfly.identification.inference.mass_consistency import disagreeing
from butterfly.verdict import Level

_CLEARLY = 0.5  # share of the misfit that a slip undone must leave at most
_FAR_MORE = 0.3  # share of the misfit that a far-fetched slip must leave at most to come first
_AS_GOOD = 1.3  # times the least misfit, below which a slip explains as much
_LONGEST_TRIAL = 50_000.0  # s that may be simulated to see whether seconds are right
_EXPLAINED = 0.2  # misfit of logs that a joint explains as they are: a method refused, no slip
_ROOM = 0.005  # misfit that makes no difference


def find_slips(data: DataSet, estimator: Estimator, estimate: Estimate) -> list[Finding]:
    """Name the slips that explain what speaks against an estimate; cheap where nothing does.

    Parameters
    ----------
    data
        The logs.
    estimator
        What the estimate is from.
    estimate
        With all other findings on it.
    """
    told = slips_of_omega(data.logs, data.points)
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


def find_slips_of_refused(data: DataSet, estimator: Estimator) -> list[Finding]:
    """Name the slips but for which there would be an estimate."""
    quick = _quick(data, estimator)
    before = attempt(lambda same: same, thinned(data), quick)
    if before.misfit < _EXPLAINED:
        return []
    return _best(_tried(data, quick, (*CLOCKS, *OTHERS)), before)


def find_slips_of_clock(data: DataSet, estimator: Estimator) -> list[Finding]:
    """Name the slip that makes stamps advance slowly, before they are simulated for ages."""
    if not slow_clock(data):
        return []
    quick, some = _quick(data, estimator), thinned(data)
    span = sum(float(log.time[-1] - log.time[0]) for log in some.logs)
    before = attempt(lambda same: same, some, quick) if span < _LONGEST_TRIAL else NOTHING
    return _best(_tried(data, quick, CLOCKS), before)


def _before(data: DataSet, estimator: Estimator, estimate: Estimate, quick: Estimator) -> Trial:
    """Return how well a joint explains the logs as they are: a poor method is no slip of theirs."""
    found = judged(data, estimate)
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
        kind=FindingKind.SLIP, parameters=(Slip.GRAMS,), number=1e-3, severity=Level.CARE
    )
