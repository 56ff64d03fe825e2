"""Whether a joint can have the parameters that were found."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from butterfly.identify.judgement.findings import Finding, FindingKind, Severity
from butterfly.model.terms import TERMS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from butterfly.identify.estimate import ParameterEstimate
    from butterfly.model.parameters import AddedMass

_CLEARLY = 1.0  # half-widths below 0 that are more than a fluke


def judge_physics(estimate: ParameterEstimate, masses: Sequence[AddedMass]) -> list[Finding]:
    """Tell what no joint can have: no inertia, friction that drives, torque before its command.

    A negative p4 is possible: the angle or the input may count the other way.

    Parameters
    ----------
    estimate
        The parameters.
    masses
        What the hand carried.
    """
    found = estimate.parameters
    judged = []
    least = min((found.p1 + mass.inertia for mass in masses), default=found.p1)
    if not least > 0:
        judged.append(
            Finding(
                kind=FindingKind.NO_INERTIA,
                parameters=("p1",),
                number=least,
                severity=Severity.WARNING,
            )
        )
    negative = [
        name
        for name, value, error in _rows(estimate)
        if (name == "delay" or TERMS[name].lower == 0) and value < -_CLEARLY * error
    ]
    levels = [found.with_added_mass(mass).level(0.0) for mass in masses]
    if min(levels, default=0.0) < 0 and "load" in estimate.names:
        negative.append("load")
    if negative:
        severity = Severity.CARE if negative == ["delay"] else Severity.WARNING
        judged.append(
            Finding(kind=FindingKind.NEGATIVE, parameters=tuple(negative), severity=severity)
        )
    if found.p4 < 0:
        judged.append(
            Finding(kind=FindingKind.NEGATIVE_GAIN, parameters=("p4",), severity=Severity.CARE)
        )
    return judged


def _rows(estimate: ParameterEstimate) -> list[tuple[str, float, float]]:
    """Names, values and half-widths."""
    reach = np.nan_to_num((estimate.upper - estimate.lower) / 2)
    return list(zip(estimate.names, estimate.values.tolist(), reach.tolist(), strict=True))
