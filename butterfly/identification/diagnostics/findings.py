"""What can be concluded from a fit, as data; `report.finding_texts` makes sentences of it."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass
from enum import StrEnum


class Ending(StrEnum):
    """How an estimation ended."""

    CONVERGED = "converged"
    STOPPED = "stopped"
    REFUSED = "refused"


class FindingKind(StrEnum):
    """What was found; the number that goes with it stands behind."""

    UNIT_ERROR = "slip"  # its name; the factor that undoes it
    # the same, of one that would not move the values beyond limits, or that no motion can tell
    SUSPECTED = "suspected-slip"
    POOR_FIT = "poor-fit"  # median FIT in per cent, so low that the model does not follow
    NO_INERTIA = "no-inertia"  # p1 with the least added inertia
    NEGATIVE = "negative"  # what cannot be
    EARLY = "early"  # a delay below 0
    NEGATIVE_GAIN = "negative-gain"
    TOLD_APART = "told-apart"  # standard uncertainties between two things that were told
    CONTRADICTED = "contradicted"  # physical parameters that would be below 0; standard errors
    KNOWN_APART = "known-apart"  # share by which the masses would have what was known larger
    PRIOR_APART = "prior-apart"  # standard errors between what was known and what the logs say
    LEFT_OUT = "left-out"  # how many logs there are, of which those named say nothing to a sine fit
    REST_APART = "rest-apart"  # rad between the rest angles with different masses
    ZERO_GUESSED = "zero-guessed"  # logs that do not tell where the encoder's angle is 0
    UNPREDICTABLE = "unpredictable"  # logs whose course no simulation from the start can follow
    SCANNED = "scanned"  # value of a parameter that was found by trying several
    HELD = "held"  # value of a parameter that was held there: the data hardly tell it
    NOT_HELPING = "not-helping"  # terms that were offered and did not help to predict
    INSEPARABLE = "inseparable"  # terms that were dropped: the data cannot tell them from the rest
    SEARCH_STOPPED = "search-stopped"  # seconds after which, without what stands for parameters
    OTHER_END = "other-end"  # cost of the next best end over that of the best
    COMBINATION = "combination"  # the same, of parameters known in one combination only
    ON_BOUND = "on-bound"
    PULLED = "pulled"  # on a bound that the data would cross
    FEW_MASSES = "few-masses"  # different added masses, too few to leave one out
    FEW_LOGS = "few-logs"  # how many there are, in blocks of which the scatter was taken
    SCATTER = "scatter"  # standard deviation from log to log, over the value
    CLOCK = "clock"  # share by which the inputs' sines run faster than their omega
    CLOCK_SET = "clock-set"  # the same where all stamps were multiplied by 1 more than it
    OMEGA_SET = "omega-set"  # or every omega
    LIKE_CLOCK = "like-clock"  # the same, of a clock that a term looks like
    SIGN_UNKNOWN = "sign-unknown"
    TORQUE_DRIVEN = "torque-driven"  # largest resistance in Ohm that the damping allows
    NOT_ESTIMATED = "not-estimated"
    UNDRIVEN = "undriven"
    NO_UNCERTAINTY = "no-uncertainty"  # equations there are
    ABSOLUTE = "absolute"
    RATIOS = "ratios"
    # terms that the model lacks, then parameters that they move by more than their intervals; share
    # of the squared residuals that they explain
    MISSING_TERM = "missing-term"
    FOLLOWED = "followed"  # rms of what free runs leave, over that of the motion
    MISFIT = "misfit"  # times what sensors explain, that free runs leave
    NO_MISFIT = "no-misfit"  # the same, where sensors explain it
    RESTS_ON = "rests-on"  # what no log can show, and was not told with an uncertainty


KINDS = frozenset(map(str, FindingKind))


@dataclass(frozen=True)
class Finding:
    """One thing that was found.

    It concerns ``parameters``, and ``logs`` by name (all if none is named); what the number is, its
    kind says.
    """

    kind: FindingKind
    parameters: tuple[str, ...] = ()
    _: KW_ONLY
    number: float | None = None
    logs: tuple[str, ...] = ()

    @property
    def impossible(self) -> bool:
        """Whether no joint has such values, or none that could be simulated."""
        if self.kind is FindingKind.POOR_FIT:
            return self.number is not None and not math.isfinite(self.number)
        return self.kind in {FindingKind.NO_INERTIA, FindingKind.NEGATIVE}

    @property
    def forbids(self) -> bool:
        """Whether values of which it is true are not to be used."""
        return self.impossible or self.kind in {FindingKind.POOR_FIT, FindingKind.UNIT_ERROR}
