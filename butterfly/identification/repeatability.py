"""Whether two logs that are said to carry the same mass move alike: compared directly.

A mass that is mounted and not said changes the inertia and the gravity moment; what the input does
(p4) and friction (p2, Coulomb) stay. One log alone gives all of these over its inertia: with p1
held at 1 the ratios p4/p1, p2/p1 and coulomb/p1 then differ by one factor. So two logs contradict
each other if

- p4/p1 differs by more than both of its intervals, and by a share that matters;
- one factor explains most of the error that common values would leave, by the equations about both
  fits (p3, zero and initial velocity are free): friction that differs from run to run, or a model
  that lacks a term, moves the ratios each in its own way;
- a fit of both logs with common values leaves much more of either, which no fit does that ended at
  another minimum alone;
- and one of them is followed with the input, friction and delay of the other, by another inertia
  and gravity alone: slow runs, whose inertia hardly acts, may end at other ratios too.

No model of all logs is asked, which the wrong mass may have spoilt. A steady sine is left out: at
one frequency gain, inertia and gravity are known in combination only.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from butterfly.arrays import Samples
from butterfly.errors import ButterflyError
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators.output_error import OutputError
from butterfly.identification.problem import Start
from butterfly.identification.trust import MATTERS, Finding, FindingKind
from butterfly.logs.log import Log
from butterfly.model.prior import Prior
from butterfly.model.terms import CHANGING
from butterfly.progress import counted

_MOSTLY = 0.5  # share of what differs that a change of inertia explains
_HALF_RMS = 0.25  # of a squared error, which is half of its root

_RATIOS = Prior.of({"p1": 1.0})
_SCALED = CHANGING[::-1]  # what an added mass leaves as it is
_COMPARED = (*_SCALED, "delay")  # in the equations, p3 being free


@dataclass(frozen=True, kw_only=True, eq=False)
class RunRatios:
    """What one log alone says of its joint, over its inertia."""

    log: Log
    bare: Log  # the same without its added mass, which is part of the inertia
    estimate: Estimate  # with p1 = 1
    names: tuple[str, ...]  # of `_COMPARED`, the n that it determines, p4 first
    values: Samples  # (n,)
    spread: Samples  # (n, n) inverse curvature of the squared error by them
    error: float  # squared error of its free run, over that of the motion

    def interval(self, name: str) -> tuple[float, float]:
        """Return value and half width of the interval of a ratio; NaN where it has none."""
        if name not in self.estimate.names:
            return float("nan"), float("nan")
        place = self.estimate.names.index(name)
        return float(self.estimate.values[place]), float(self.estimate.farther[place])


class Contradiction(NamedTuple):
    """Two logs that are said to carry the same mass, and do not move so."""

    earlier: Log
    later: Log
    gains: tuple[float, float]  # p4/p1 of both, in units of the input
    stiffness: tuple[float, float]  # p3/p1 of both in 1/s^2
    odd: Log | None = None  # the one of both that moves like a log of another mass
    like: Log | None = None  # that log

    @property
    def change(self) -> float:
        """Share by which p4/p1 of the later log is above that of the earlier one."""
        return self.gains[1] / self.gains[0] - 1

    @property
    def finding(self) -> Finding:
        """The finding that names both logs, then the odd one and that which it moves like."""
        logs = [self.earlier, self.later]
        logs += [self.odd, self.like] if self.odd and self.like else []
        names = tuple(log.name for log in logs)
        return Finding(FindingKind.UNREPEATED, ("p4",), number=self.change, logs=names)


@dataclass(kw_only=True, eq=False)
class Repeatability:
    """Compares logs of data sets that grow, by their names; ratios are computed once for each."""

    _known: dict[str, RunRatios | None] = field(default_factory=dict)  # by the name of the log

    def contradiction(self, data: DataSet, number: int) -> Contradiction | None:
        """Return how a log contradicts one of those before it with the same mass, or None.

        The logs of other masses show which of the two moves as with another mass.
        """
        logs, latest = data.logs, data.logs[number]
        earlier = [log for log in logs[:number] if log.added_mass == latest.added_mass]
        new = self._ratios(latest) if earlier else None
        if new is None:
            return None
        for old in filter(None, map(self._ratios, earlier)):
            if (
                _differ(old, new)
                and not _have_common_values(old, new)
                and (_has_other_inertia(old, new) or _has_other_inertia(new, old))
            ):
                others = [log for log in logs if log.added_mass != latest.added_mass]
                return _named(old, new, filter(None, map(self._ratios, others)))
        return None

    def _ratios(self, log: Log) -> RunRatios | None:
        if log.name not in self._known:
            self._known[log.name] = ratios_of(log)
        return self._known[log.name]


def contradicting_runs(data: DataSet) -> Contradiction | None:
    """Return the first log of a data set that contradicts an earlier one of its mass, or None."""
    repeatability = Repeatability()
    contradictions = (repeatability.contradiction(data, k) for k in range(len(data.logs)))
    return next(filter(None, contradictions), None)


def contradiction_text(finding: Finding) -> str:
    """Return the sentence on two logs of one mass that contradict each other."""
    earlier, later, *both = finding.logs
    change = finding.number or 0.0
    text = (
        f"{earlier} and {later} are declared with the same mass, but p4/p1 is "
        f"{100 * abs(change):.2g} % {'larger' if change > 0 else 'smaller'} in {later}"
    )
    if both:
        odd, like = both
        text += f". {odd} moves like {like}, which is declared with another mass"
    return f"{text}. Check what was mounted, and correct the manifest or repeat the run."


def ratios_of(log: Log) -> RunRatios | None:
    """Return what a log alone says over its inertia; None if it does not determine that."""
    if log.closed or log.excitation is not None:
        return None
    bare = replace(log, added_mass=replace(log.added_mass, mass=0.0))
    try:
        data = DataSet.of([bare]).knowing(_RATIOS)
        with counted():
            estimator = OutputError(terms=(), workers=1)
            problem, fit = estimator.fit(data)
            fit = estimator.weigh(problem, fit)
            estimate = estimator.infer(problem, fit)
    except (ButterflyError, np.linalg.LinAlgError):
        return None
    equations = fit.plain.linearisation
    free = {name for name, is_free in zip(equations.names, equations.free, strict=True) if is_free}
    names = tuple(name for name in _COMPARED if name in free)
    places = [equations.names.index(name) for name in names]
    error = _error(data, estimate)[0]
    if "p4" not in names or estimate.unsettled or not np.isfinite(error):
        return None
    return RunRatios(
        log=log,
        bare=bare,
        estimate=estimate,
        names=names,
        values=equations.values[places],
        spread=equations.inverse[np.ix_(places, places)],
        error=max(float(equations.residuals @ equations.residuals), float(error)),
    )


def _error(data: DataSet, estimate: Estimate) -> Samples:
    """Return the (logs,) squared errors of the free runs of whole logs over their motion."""
    return (1 - data.simulations.fits(estimate) / 100) ** 2


def _differ(old: RunRatios, new: RunRatios) -> bool:
    """Whether p4/p1 differs, and a change of inertia explains most of all that differs."""
    (was, is_now), widths = zip(old.interval("p4"), new.interval("p4"), strict=True)
    change = abs(is_now - was)
    if not change > max(sum(widths), 2 * MATTERS * max(abs(was), abs(is_now))):
        return False
    names = [name for name in old.names if name in new.names]
    (before, after), spreads = zip(*(_part(run, names) for run in (old, new)), strict=True)
    scaled = np.array([name in _SCALED for name in names])
    direction = np.where(scaled, before + after, 0.0) / 2
    weights = np.linalg.pinv(sum(spreads), hermitian=True)
    pull = direction @ weights @ (after - before)
    explained = pull**2 / (direction @ weights @ direction)
    whole = (after - before) @ weights @ (after - before)
    return bool(explained > _MOSTLY * (whole + old.error + new.error))


def _part(run: RunRatios, names: Sequence[str]) -> tuple[Samples, Samples]:
    """Return the (m,) values and (m, m) spread of some of the values of a log."""
    places = [run.names.index(name) for name in names]
    return run.values[places], run.spread[np.ix_(places, places)]


def _have_common_values(old: RunRatios, new: RunRatios) -> bool:
    """Whether one joint follows at least one of two logs nearly as well as that log's own does."""
    data = DataSet.of([old.bare, new.bare]).knowing(_RATIOS)
    first = [Start.at(run.estimate, data) for run in (old, new)]
    try:
        with counted():
            estimate = OutputError(terms=(), workers=1).of_logs(data.logs, first, data.known)
    except (ButterflyError, np.linalg.LinAlgError):
        return True  # nothing shows that they have none
    errors = _error(data, estimate)
    return bool((_HALF_RMS * errors <= [old.error, new.error]).any())  # half of the rms


def _has_other_inertia(run: RunRatios, other: RunRatios) -> bool:
    """Whether the other log is followed with the torques of a run, by another inertia.

    Input, friction and delay are held; inertia, gravity and start are free. Where that follows the
    log not nearly as well as its own fit does, something else than a mass has changed.
    """
    values = run.estimate.parameters
    held = Prior.of({name: getattr(values, name) for name in _COMPARED})
    data = DataSet.of([other.bare]).knowing(held)
    try:
        with counted():
            first = [Start.at(ratios.estimate, data) for ratios in (run, other)]
            estimate = OutputError(terms=(), workers=1).of_logs(data.logs, first, data.known)
    except (ButterflyError, np.linalg.LinAlgError):
        return False
    inertia, (gain, width) = estimate.named["p1"], run.interval("p4")
    unlike = abs(inertia - 1) > max(2 * MATTERS, width / gain)
    return unlike and bool(_HALF_RMS * _error(data, estimate)[0] <= other.error)


def _named(old: RunRatios, new: RunRatios, others: Iterable[RunRatios]) -> Contradiction:
    """Return the contradiction of two logs, and which log of another mass one of them is like."""
    gains, stiffness = ((old.interval(name)[0], new.interval(name)[0]) for name in ("p4", "p3"))
    contradiction = Contradiction(old.log, new.log, gains, stiffness)
    for other in others:
        alike = [run for run in (old, new) if _agree(run, other)]
        if len(alike) == 1:
            return contradiction._replace(odd=alike[0].log, like=other.log)
    return contradiction


def _agree(run: RunRatios, other: RunRatios) -> bool:
    """Whether the ratios of two logs are the same, by their intervals or for all that matters."""
    for name in ("p3", "p4"):
        (value, width), (second, more) = run.interval(name), other.interval(name)
        if abs(value - second) > max(width + more, MATTERS * abs(value)):
            return False
    return True
