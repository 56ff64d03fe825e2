"""What may be done with values follows from the gravest that was found."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from butterfly.identification.diagnostics.findings import Ending, Finding, FindingKind, Severity
from butterfly.identification.diagnostics.verdict import Standing, Verdict

NOTE = Finding(kind=FindingKind.PRECISE, parameters=("p1",))
CARE = Finding(kind=FindingKind.FEW_MASSES, number=2, severity=Severity.CARE)
WARNING = Finding(kind=FindingKind.POOR_FIT, number=20.0, severity=Severity.WARNING)
SLIP = Finding(kind=FindingKind.SLIP, parameters=("degrees",), number=57.3, severity=Severity.CARE)


@pytest.mark.parametrize(
    ("ending", "findings", "standing", "reasons"),
    [
        (Ending.CONVERGED, (), Standing.GOOD, ()),
        (Ending.CONVERGED, (NOTE,), Standing.GOOD, ()),
        (Ending.CONVERGED, (NOTE, CARE), Standing.CARE, (CARE,)),
        (Ending.CONVERGED, (WARNING, CARE, NOTE), Standing.NOT, (WARNING,)),
        (Ending.CONVERGED, (WARNING, CARE, SLIP), Standing.NOT, (SLIP, WARNING)),
        (Ending.CONVERGED, (SLIP, CARE), Standing.CARE, (SLIP, CARE)),
        (Ending.STOPPED, (NOTE, CARE), Standing.NOT, ()),
        (Ending.REFUSED, (NOTE,), Standing.NOT, ()),
    ],
)
def test_the_gravest_finding_decides_and_is_the_reason(ending, findings, standing, reasons):
    verdict = Verdict.of(ending, findings)
    assert verdict.standing is standing
    assert verdict.reasons == reasons
    assert verdict.standing.usable is (standing is not Standing.NOT)


@given(st.lists(st.sampled_from(Standing)))
def test_the_worst_allows_least(standings):
    worst = Standing.worst(standings)
    assert (worst is None) == (not standings)
    assert all(each.usable for each in standings) == (worst is None or worst.usable)
    assert (worst is Standing.GOOD) == (set(standings) == {Standing.GOOD})


@pytest.mark.parametrize(
    ("finding", "impossible"),
    [
        (Finding(kind=FindingKind.NO_INERTIA, number=-1.0, severity=Severity.WARNING), True),
        (Finding(kind=FindingKind.NEGATIVE, severity=Severity.WARNING), True),
        (Finding(kind=FindingKind.NEGATIVE, severity=Severity.CARE), False),
        (Finding(kind=FindingKind.POOR_FIT, number=-math.inf, severity=Severity.WARNING), True),
        (Finding(kind=FindingKind.POOR_FIT, number=30.0, severity=Severity.WARNING), False),
        (Finding(kind=FindingKind.ROUNDS, number=60, severity=Severity.WARNING), False),
    ],
)
def test_what_no_joint_can_have_is_told_from_what_is_not_to_be_used(finding, impossible):
    verdict = Verdict.of(Ending.CONVERGED, [finding])
    assert verdict.impossible is impossible
    assert verdict.standing is not Standing.GOOD
