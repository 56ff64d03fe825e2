"""Whether what is known of motor and hand agrees with itself, and with an estimate."""

from __future__ import annotations

from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.findings import Finding, FindingKind
from butterfly.identification.estimate import Estimate
from butterfly.identification.implied import apart
from butterfly.identification.physical import physical_parameters
from butterfly.verdict import Level

_CLEARLY = 3.0  # standard errors, or uncertainties, apart


def judge_knowledge(estimate: Estimate, data: DataSet) -> list[Finding]:
    """Tell what cannot all be true: p4 of two sources, friction or inertia that would be negative.

    So p2 is at least the back EMF's share N^2 k_emf k_t/R, p1 at least the rotor's N^2 J_r, and
    with the hand weighed at least that of its centre of mass besides.

    Parameters
    ----------
    estimate
        The lumped parameters.
    data
        What they were found from, and what is known.
    """
    carrier = data.logs[0].added_mass
    sources = apart(data.told, data.input_kind, carrier.joint)
    found = [
        Finding(kind=FindingKind.TOLD_APART, parameters=(name,), number=far, severity=Level.CARE)
        for name, far in sources.items()
        if far > _CLEARLY
    ]
    physical = physical_parameters(estimate, data.known, data.input_kind, carrier)
    below = {each.name: each.below_zero for each in physical.found if each.below_zero > _CLEARLY}
    if below:
        found.append(
            Finding(
                kind=FindingKind.CONTRADICTED,
                parameters=tuple(below),
                number=max(below.values()),
                severity=Level.CARE,
            )
        )
    return found
