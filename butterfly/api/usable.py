"""What something is to be made of must be parameters that a joint can have."""

from __future__ import annotations

from butterfly.errors import UnusableError
from butterfly.identification.diagnostics.findings import is_impossible
from butterfly.identification.estimate import Estimate
from butterfly.report.finding_texts import estimate_verdict
from butterfly.verdict import Verdict


def require_possible(estimate: Estimate) -> Verdict:
    """Return the verdict on an estimate from which simulations or a model are to be made.

    Raises
    ------
    UnusableError
        If no joint has its values; the verdict is the message.
    """
    verdict = estimate_verdict(estimate)
    if any(is_impossible(each) for each in estimate.reasons):
        raise UnusableError(verdict.sentence, verdict.reasons)
    return verdict
