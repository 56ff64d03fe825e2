"""What can be concluded from a fit, as data; `butterfly.report.words` makes sentences of it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable


class Ending(StrEnum):
    """How an estimation ended."""

    CONVERGED = "converged"
    STOPPED = "stopped"
    REFUSED = "refused"


class Severity(StrEnum):
    """How much a finding matters to somebody who wants to use the values."""

    NOTE = "note"
    CARE = "care"
    WARNING = "warning"


class FindingKind(StrEnum):
    """What was found; the number that goes with it stands behind."""

    PRECISE = "precise"  # half-width over value that counts as known
    ROUGH = "rough"
    NOT_FROM_ZERO = "not-from-zero"
    CONDITION = "condition"  # condition number of the scaled regression
    COMBINATION = "combination"  # the same, of parameters known in one combination only
    ROUNDS = "rounds"  # of an iteration that stopped
    SIMULATIONS = "simulations"  # of every log, that a fit took
    ON_BOUND = "on-bound"
    FEW_MASSES = "few-masses"  # different added masses, too few to leave one out
    UNCHECKED = "unchecked"  # not checked by leaving masses out, as asked
    SIGN_UNKNOWN = "sign-unknown"
    TORQUE_DRIVEN = "torque-driven"  # largest resistance in Ohm that the damping allows
    NOT_ESTIMATED = "not-estimated"
    NO_UNCERTAINTY = "no-uncertainty"  # equations there are
    ABSOLUTE = "absolute"
    RATIOS = "ratios"
    MISFIT = "misfit"  # times what sensors explain, that free runs leave over
    NO_MISFIT = "no-misfit"  # the same, where sensors explain it
    LEFT_OVER = "left-over"  # share of it that a missing term explains


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One thing that was found.

    Parameters
    ----------
    kind
        What.
    parameters
        Whom it concerns.
    number
        See `FindingKind`.
    severity
        How much it matters.
    """

    kind: FindingKind
    parameters: tuple[str, ...] = ()
    number: float | None = None
    severity: Severity = Severity.NOTE


def usable(ending: Ending, findings: Iterable[Finding]) -> bool:
    """Whether values may be used: their estimator converged, and no finding warns of them."""
    warned = any(each.severity is Severity.WARNING for each in findings)
    return ending is Ending.CONVERGED and not warned
