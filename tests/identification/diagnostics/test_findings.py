"""What forbids the use of values, and what an older program found that is none now."""

import math

import pytest

from butterfly.identification.diagnostics.findings import Finding, FindingKind


@pytest.mark.parametrize(
    ("finding", "impossible", "forbids"),
    [
        (Finding(FindingKind.NO_INERTIA, number=-1.0), True, True),
        (Finding(FindingKind.NEGATIVE), True, True),
        (Finding(FindingKind.EARLY, ("delay",)), False, False),
        (Finding(FindingKind.POOR_FIT, number=-math.inf), True, True),
        (Finding(FindingKind.POOR_FIT, number=30.0), False, True),
        (Finding(FindingKind.UNIT_ERROR, ("degrees",), number=57.3), False, True),
        (Finding(FindingKind.SUSPECTED, ("mass", "50 g", "3"), number=0.051), False, False),
        (Finding(FindingKind.FEW_MASSES, number=2), False, False),
        (Finding(FindingKind.PRIOR_APART, ("p1",), number=4.0), False, False),
        (Finding(FindingKind.KNOWN_APART, ("p4",), number=0.03), False, False),
    ],
)
def test_only_what_no_joint_has_what_does_not_follow_and_slips_forbid(finding, impossible, forbids):
    assert (finding.impossible, finding.forbids) == (impossible, forbids)
