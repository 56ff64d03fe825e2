"""Which parameters some logs can tell, before they are identified, and what would mend it.

The free runs of the logs are fitted, starting at the values of the weak form, with the common terms
that it has. Parameters that are determined have the interval of a fit: cluster-robust over logs,
with the estimates without each added mass and rivals by conditions. Other terms, and all that is
checked afterwards, may widen it: it is a lower limit.

With h the half-width of that interval over the value, a parameter is *identifiable* if h is at most
`PRECISE`; *not identifiable* if h is 1 or more, so that it may be 0, or if the equations are
singular; *weak* between. A delay d turns a share w d of a torque at the frequency w by a quarter of
its period, as an error of p4 enlarges it by its own share: its h is w times the half-width, with w
of the fastest log. Where no log reverses, Coulomb friction is *weak* at best.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from butterfly.arrays import Samples, unit_diagonal
from butterfly.errors import ButterflyError, InputError
from butterfly.identification.data import DataSet
from butterfly.identification.estimators import OutputError
from butterfly.identification.estimators.start import starts
from butterfly.identification.inference.agreement import pace_of
from butterfly.identification.inference.consistency import is_driven, prior_of_fit
from butterfly.identification.inference.estimate import Estimate
from butterfly.identification.inference.limits import OTHER_LOGS
from butterfly.identification.levels import MATTERS, PASSES, SHOWS
from butterfly.identification.parameter import meaning_of, or_none, unit_of
from butterfly.identification.trust import PRECISE
from butterfly.logs.log import Log
from butterfly.logs.thinning import GLANCE, thinned
from butterfly.model.prior import Prior
from butterfly.model.terms import COMMON, PARAMETERS
from butterfly.progress import counted

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
    """Whether logs can tell a parameter."""

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
    mend: str = ""  # what would mend it


def forecast(logs: Sequence[Log], known: Prior) -> tuple[Forecast, ...]:
    """Return a forecast of each parameter that every joint has; none without logs."""
    fit, fastest, why, mend = None, 0.0, "", ""
    try:
        with counted(), np.errstate(all="ignore"):
            data = DataSet.of([thinned(log, GLANCE) for log in logs], known=known)
            known = data.known if is_driven(logs) else data.known.within({*known.values, "p3"})
            fit, fastest = expected(data), max(map(pace_of, data.logs))
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
            row = _told(row, fit, fastest)
            if name == "coulomb" and not any(_reverses(log.angle) for log in logs):
                why = "no log reverses, so it cannot be told from a constant torque"
                row = replace(
                    row,
                    word=max(row.word, Identifiability.WEAK, key=[*Identifiability].index),
                    why=why,
                )
                row = replace(row, mend="motion in both directions")
        elif fit is not None:
            row = replace(row, why="the input is always zero", mend="add logs of the driven joint")
        rows.append(row)
    return tuple(rows)


def expected(data: DataSet) -> Estimate:
    """Return the estimate of a fit that starts at the weak form's values, with all its terms."""
    first, *_ = starts(data, None)
    terms = tuple(name for name in COMMON if getattr(first.parameters, name))
    estimator = OutputError(terms=terms)
    known = prior_of_fit(data.logs, data.known)
    problem = estimator.problem(data.logs, first, known)
    return estimator.infer(problem, problem.descend(most=PASSES, enough=SHOWS))


def _reverses(angle: Samples) -> bool:
    """Whether (n,) angles go both ways, by more than a negligible share of their range."""
    back = [np.max(np.maximum.accumulate(way * angle) - way * angle) for way in (1, -1)]
    return bool(min(back) > MATTERS * np.ptp(angle))


def _told(row: Forecast, fit: Estimate, fastest: float) -> Forecast:
    """Add to a row its word, its half-widths, and what would mend it."""
    place = fit.names.index(row.name)
    half, value = float(fit.farther[place]), abs(float(fit.values[place]))
    share = fastest if row.name == "delay" else 1 / value if value else np.inf
    row = replace(row, half_width=or_none(half), expected=or_none(share * half))
    if share * half <= PRECISE:
        return replace(row, word=Identifiability.IDENTIFIABLE)
    word = Identifiability.WEAK if share * half < 1 else Identifiability.NOT
    common = abs(unit_diagonal(fit.covariance)[0][place])
    common[[name == row.name or name not in PARAMETERS for name in fit.names]] = 0.0
    other = fit.names[int(common.argmax())]
    alone = share * half * (max(1 - float(common.max()) ** 2, 0.0)) ** 0.5
    if row.name in fit.on_bound:
        why, mend = "it may be 0", "none needed if it is 0"
    elif alone <= PRECISE:
        why = f"{row.name} and {other} are hard to tell apart"
        mend = _APART.get(frozenset((row.name, other)), OTHER_LOGS)
    else:
        why, mend = "the motion shows little of it", "a larger motion"
        if alone < 1:
            count = math.ceil((alone / PRECISE) ** 2)
            times = {2: "twice"}.get(count, f"{count} times")
            mend = f"{times} as many such logs, or {mend}"
    return replace(row, word=word, why=why, mend=mend)
