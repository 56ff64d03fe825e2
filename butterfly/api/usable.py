"""What something is to be made of must be parameters that a joint can have."""

from __future__ import annotations

from butterfly.errors import UnusableError
from butterfly.identification.estimate import Estimate
from butterfly.report.verdict import SaidVerdict
from butterfly.report.words import verdict_on


def require_possible(estimate: Estimate) -> SaidVerdict:
    """Return the verdict on an estimate from which simulations or a model are to be made.

    Raises
    ------
    UnusableError
        If no joint has its values; the verdict is the message.
    """
    verdict = verdict_on(estimate)
    if estimate.verdict.impossible:
        raise UnusableError(verdict.sentence, verdict.reasons)
    return verdict
