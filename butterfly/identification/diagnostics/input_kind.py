"""Whether the input can be the voltage that the manifest says it is."""

from __future__ import annotations

from butterfly.identification.diagnostics.findings import Finding, FindingKind
from butterfly.identification.estimate import Estimate
from butterfly.logs.log import InputKind

LEAST_RESISTANCE = 0.01
"""Ohm; no motor of a robot's joint has less."""


def judge_input(estimate: Estimate, kind: InputKind) -> list[Finding]:
    """Tell whether a voltage-fed motor could have the damping and gain that were found.

    With one motor constant K for torque and back EMF, p4 = K/R and p2 >= K^2/R = p4^2 R (6): the
    damping bounds the resistance. If the bound is below what any motor has, the input can hardly
    be a voltage.

    Parameters
    ----------
    estimate
        With p2 and p4.
    kind
        What the data set says.
    """
    if kind is not InputKind.VOLTAGE or "p4" not in estimate.names:
        return []
    upper = {"p2": estimate.parameters.p2}  # where it is known
    upper |= dict(zip(estimate.names, estimate.upper.tolist(), strict=True))
    p4 = abs(estimate.parameters.p4)
    if not upper["p2"] >= 0 or not p4 > 0:
        return []
    resistance = upper["p2"] / p4**2
    if resistance >= LEAST_RESISTANCE:
        return []
    return [
        Finding(
            kind=FindingKind.TORQUE_DRIVEN,
            parameters=("p2", "p4"),
            number=resistance,
        )
    ]
