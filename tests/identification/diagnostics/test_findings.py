"""What may be done with values follows from the gravest that was found."""

from __future__ import annotations

import math

import pytest

from butterfly.identification.diagnostics.findings import (
    Ending,
    Finding,
    FindingKind,
    grade,
    is_impossible,
)
from butterfly.verdict import Level

NOTE = Finding(FindingKind.PRECISE, ("p1",))
CARE = Finding(FindingKind.FEW_MASSES, number=2, severity=Level.CARE)
WARNING = Finding(FindingKind.POOR_FIT, number=20.0, severity=Level.WARNING)
SLIP = Finding(FindingKind.UNIT_ERROR, ("degrees",), number=57.3, severity=Level.CARE)


@pytest.mark.parametrize(
    ("ending", "findings", "level", "reasons"),
    [
        (Ending.CONVERGED, (), Level.GOOD, ()),
        (Ending.CONVERGED, (NOTE,), Level.GOOD, ()),
        (Ending.CONVERGED, (NOTE, CARE), Level.CARE, (CARE,)),
        (Ending.CONVERGED, (WARNING, CARE, NOTE), Level.WARNING, (WARNING,)),
        (Ending.CONVERGED, (WARNING, CARE, SLIP), Level.WARNING, (SLIP, WARNING)),
        (Ending.CONVERGED, (SLIP, CARE), Level.CARE, (SLIP, CARE)),
        (Ending.STOPPED, (NOTE, CARE), Level.WARNING, ()),
        (Ending.REFUSED, (NOTE,), Level.WARNING, ()),
    ],
)
def test_the_gravest_finding_decides_and_is_the_reason(ending, findings, level, reasons):
    assert grade(ending, findings) == (level, reasons)


@pytest.mark.parametrize(
    ("finding", "impossible"),
    [
        (Finding(FindingKind.NO_INERTIA, number=-1.0, severity=Level.WARNING), True),
        (Finding(FindingKind.NEGATIVE, severity=Level.WARNING), True),
        (Finding(FindingKind.NEGATIVE, severity=Level.CARE), False),
        (Finding(FindingKind.POOR_FIT, number=-math.inf, severity=Level.WARNING), True),
        (Finding(FindingKind.POOR_FIT, number=30.0, severity=Level.WARNING), False),
        (Finding(FindingKind.ROUNDS, number=60, severity=Level.WARNING), False),
    ],
)
def test_what_no_joint_can_have_is_told_from_what_is_not_to_be_used(finding, impossible):
    assert is_impossible(finding) is impossible
