"""How well some logs determine the parameters, before a fit, and what would improve it.

The logs are fitted as `identify` begins: the first fit of the default estimator, in the terms of
its start. Parameters that are determined have the interval of a fit: cluster-robust over logs, with
the estimates without each added mass and rivals by conditions. Terms that are chosen after it may
widen or narrow it, and all that is checked afterwards may widen it.

With h the half-width of that interval over the value, a parameter is *identifiable* if h is at most
`GOOD_WITHIN`; *not identifiable* if h is 1 or more, so that it may be 0, or if the equations are
singular; *weak* between. A delay d turns a share w d of a torque at the frequency w by a quarter of
its period, as an error of p4 enlarges it by its own share: its h is w times the half-width, with w
of the fastest log. Where no log reverses, Coulomb friction is *weak* at best.

Intervals as they will be after more logs: standard errors times quantiles of Student's t.

Both follow from the derivatives of the logs alone, as `cluster_covariance` has them: an interval
shrinks with its standard error, and as the degrees of freedom grow. So a few more logs of the kind
that determine a parameter help more than many others. Predictions are scaled to the intervals that
the logs so far have: what errors that are not white, or other evidence, add stays in proportion.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from butterfly.arrays import ROUNDING, Samples, unit_diagonal
from butterfly.errors import ButterflyError, InputError
from butterfly.identification.agreement import pace_of
from butterfly.identification.consistency import is_driven
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators import DEFAULT_ESTIMATOR
from butterfly.identification.limits import (
    OTHER_LOGS,
    expected_covariance,
    half_widths,
    independent_cells_of,
)
from butterfly.identification.linearisation import compressed
from butterfly.identification.trust import (
    GOOD_WITHIN,
    MATTERS,
    meaning_of,
    or_none,
    unit_of,
)
from butterfly.logs.health import GLANCE, thinned
from butterfly.logs.log import Log
from butterfly.model.parameters import JointKind, LumpedParameters
from butterfly.model.prior import Prior
from butterfly.model.terms import PARAMETERS
from butterfly.progress import counted
from butterfly.verdict import SPREADS


class IntervalForecast:
    """Intervals of an estimate's n parameters after its logs and some more.

    ``logs``: (m, n) derivatives of the errors of each by the parameters; errors are taken to be
    white and alike in all logs.
    """

    def __init__(self, estimate: Estimate, logs: Sequence[Samples]) -> None:
        errors, names = estimate.standard_errors, estimate.names
        self._units = np.where(errors > 0, errors, 1.0)
        self._logs = [self.log(rows) for rows in logs]
        uncertain = estimate.known.uncertain
        given = [uncertain[n].uncertainty if n in uncertain else math.inf for n in names]
        precision = (self._units / np.array(given)) ** 2
        units = np.outer(self._units, self._units)
        shown = sum(np.sum(log.cut(1) ** 2, axis=(0, 1)) for log in self._logs)
        # of what no log shows, so little that it makes no difference elsewhere
        self._least = ROUNDING * np.where(shown > 0, shown, np.max(shown) or 1.0)
        self._weight = precision * _variance(estimate.covariance / units, self._logs, precision)
        self._before, freedom = self._expected(self._logs)
        known = np.isfinite(estimate.farther)
        self._shown = np.where(known, estimate.farther, SPREADS * errors) / half_widths(
            self._before, freedom
        )

    def log(self, rows: Samples) -> CutLog:
        """Return a log of (m, n) derivatives, as others are."""
        return CutLog(rows * self._units)

    def half_widths(self, more: CutLog, runs: int) -> Samples:
        """(n,) half-widths of the intervals after some runs of another log."""
        return self._shown * half_widths(*self._expected([*self._logs, *[more] * runs]))

    def errors(self, more: CutLog) -> Samples:
        """(n,) standard errors after one more log, over those before."""
        after, _ = self._expected([*self._logs, more])
        return np.asarray(np.sqrt(np.diag(after) / np.diag(self._before)))

    def _expected(self, logs: Sequence[CutLog]) -> tuple[Samples, Samples]:
        """Return (n, n) covariance over an error's variance, and (n,) freedom, of some logs."""
        cells = independent_cells_of(len(logs), self._units.size)
        rows = np.concatenate([log.cut(cells) for log in logs])
        return expected_covariance(rows, self._weight + self._least)


class CutLog:
    """The (m, n) derivatives of a log, cut into cells as often as it is asked for."""

    def __init__(self, rows: Samples) -> None:
        self._rows, self._cut = rows, dict[int, Samples]()

    def cut(self, cells: int) -> Samples:
        """(cells, n + 1, n) triangular factors of the derivatives in stretches of time."""
        if cells not in self._cut:
            parts = np.array_split(self._rows, cells)
            self._cut[cells], _ = compressed([(part, np.zeros(len(part))) for part in parts])
        return self._cut[cells]


def _variance(covariance: Samples, logs: Sequence[CutLog], precision: Samples) -> float:
    """Return the mean variance of errors by which logs and known values have a covariance.

    C = (H/s + P)^-1 of n values, with H the information of logs and P the precision of what is
    known: so trace(CH)/s = n - trace(CP).
    """
    rows = np.concatenate([log.cut(1)[0] for log in logs])
    trace = precision.size - float(np.diag(covariance) @ precision)
    moved = float(np.einsum("kn,nm,km->", rows, covariance, rows))
    return moved / max(trace, ROUNDING)


_APART = {
    frozenset(pair.split()): text
    for text, pairs in {
        "a heavier added mass, or a known value": ("p1 p4", "p2 p4", "p3 p4", "coulomb p4"),
        "logs at other frequencies": ("p1 p3",),
        "logs at other speeds": ("p2 coulomb",),
        "motion in both directions": ("p3 coulomb",),
        "faster motion, faster sampling": ("p1 delay", "p2 delay", "coulomb delay", "p4 delay"),
    }.items()
    for pair in pairs
}


class Identifiability(StrEnum):
    """Whether logs determine a parameter."""

    KNOWN = "known"
    IDENTIFIABLE = "identifiable"
    WEAK = "weak"
    NOT = "not identifiable"


@dataclass(frozen=True, kw_only=True)
class Forecast:
    """What identification can be expected to say of a parameter; None where that is nothing."""

    name: str
    meaning: str
    unit: str
    word: Identifiability
    half_width: float | None = None  # of its 95 % interval, at least
    expected: float | None = None  # the same relative to the value, of a delay to 1/w (see above)
    why: str = ""  # why it is weak, or not identifiable
    mend: str = ""  # the remedy


def forecast(logs: Sequence[Log], known: Prior) -> tuple[Forecast, ...]:
    """Return a forecast of each parameter that every joint has; none without logs."""
    fit, fastest, why, mend = None, 0.0, "", ""
    small = dict[str, float]()  # torques that hardly matter beside the largest one, by name
    try:
        with counted(), np.errstate(all="ignore"):
            data = DataSet.of([thinned(log, GLANCE) for log in logs], known=known)
            known = data.known if is_driven(logs) else data.known.within({*known.values, "p3"})
            fit, fastest = expected(data), max(map(pace_of, data.logs))
            most = GOOD_WITHIN * largest_torque(fit.parameters, data.logs)
            small = {n: most / unit for n, unit in largest_motion(data.logs).items() if unit}
    except InputError as error:
        why, mend = f"{error.field} is {error.value}", f"expected: {error.expected}"
    except (ButterflyError, np.linalg.LinAlgError) as error:
        why, _, mend = str(error).partition(": ")
        if not known.scale() and not any(log.added_mass.mass for log in logs):
            mend = f"say in a manifest which masses the logs carried, or {mend}"
    rows = []
    for name in PARAMETERS if logs else ():
        kind, joint = logs[0].input_kind, logs[0].added_mass.joint
        meaning, unit = meaning_of(name, joint), unit_of(name, kind, joint)
        row = Forecast(
            name=name, meaning=meaning, unit=unit, word=Identifiability.NOT, why=why, mend=mend
        )
        if name in known.fixed:
            row = replace(
                row, word=Identifiability.KNOWN, half_width=0.0, expected=0.0, why="", mend=""
            )
        elif fit is not None and name in fit.names:
            row = _rated(row, fit, fastest, small.get(name, 0.0))
            if name == "coulomb" and not any(_reverses(log.angle) for log in logs):
                row = replace(
                    row,
                    word=max(row.word, Identifiability.WEAK, key=[*Identifiability].index),
                    why="no log reverses, so it looks like a constant torque",
                    mend="motion in both directions",
                )
        elif fit is not None:
            row = replace(row, why="the input is always zero", mend="add logs of the driven joint")
        rows.append(row)
    return tuple(rows)


def expected(data: DataSet) -> Estimate:
    """Return the estimate of the fit that `identify` begins with, before it chooses terms.

    Terms that these logs cannot tell from others are left out, as `identify` leaves them out.
    """
    estimator = DEFAULT_ESTIMATOR()
    return estimator.infer(*estimator.fit(data))


def largest_torque(parameters: LumpedParameters, logs: Sequence[Log]) -> float:
    """Return the largest torque in N m by which some logs were driven, or fell without a drive."""
    driven = max(float(np.max(np.abs(log.input))) for log in logs) * abs(parameters.p4)
    if driven > 0:
        return driven
    falls = (abs(parameters.with_added_mass(log.added_mass).p3) * _swing(log) for log in logs)
    return max(falls)


def largest_motion(logs: Sequence[Log]) -> dict[str, float]:
    """Return the largest torque per unit of p2 (a speed in rad/s), p3 and Coulomb friction (1)."""
    speed = math.sqrt(2) * max(log.rms_speed for log in logs)  # amplitude, of a sine
    return {"p2": speed, "p3": 1.0, "coulomb": 1.0}


def _swing(log: Log) -> float:
    """Return the sine of the largest swing of a log; the swing itself in m on a slide way."""
    swing = float(np.ptp(log.angle)) / 2
    return swing if log.added_mass.joint is JointKind.SLIDE else math.sin(min(swing, math.pi / 2))


def _reverses(angle: Samples) -> bool:
    """Whether (n,) angles go both ways, by more than a negligible share of their range."""
    back = [np.max(np.maximum.accumulate(way * angle) - way * angle) for way in (1, -1)]
    return bool(min(back) > MATTERS * np.ptp(angle))


def _rated(row: Forecast, fit: Estimate, fastest: float, small: float) -> Forecast:
    """Add to a row its word, its half-widths, and the remedy; a ``small`` value hardly matters."""
    place = fit.names.index(row.name)
    half, value = float(fit.farther[place]), abs(float(fit.values[place]))
    share = fastest if row.name == "delay" else 1 / value if value else np.inf
    row = replace(row, half_width=or_none(half), expected=or_none(share * half))
    if share * half <= GOOD_WITHIN:
        return replace(row, word=Identifiability.IDENTIFIABLE)
    word = Identifiability.WEAK if share * half < 1 else Identifiability.NOT
    common = abs(unit_diagonal(fit.covariance)[0][place])
    common[[name == row.name or name not in PARAMETERS for name in fit.names]] = 0.0
    other = fit.names[int(common.argmax())]
    alone = share * half * (max(1 - float(common.max()) ** 2, 0.0)) ** 0.5
    if row.name in fit.on_bound or value <= half <= small - value:
        why, mend = "it may be 0", "none needed if it is 0"
    elif alone <= GOOD_WITHIN:
        why = f"{row.name} and {other} are hard to tell apart"
        mend = _APART.get(frozenset((row.name, other)), OTHER_LOGS)
    else:
        why, mend = "the motion shows little of it", "a larger motion"
        if alone < 1:
            count = math.ceil((alone / GOOD_WITHIN) ** 2)
            times = {2: "twice"}.get(count, f"{count} times")
            mend = f"{times} as many such logs, or {mend}"
    return replace(row, word=word, why=why, mend=mend)
