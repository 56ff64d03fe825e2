"""What may be done with values follows from the gravest that was found."""

from __future__ import annotations

import pytest

from butterfly.identify.judgement.findings import Ending, Finding, FindingKind, Severity
from butterfly.identify.judgement.verdict import Standing, Verdict

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
    assert verdict.usable is (standing is not Standing.NOT)
