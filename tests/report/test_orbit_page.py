"""The report of an orbit."""

import pytest

from butterfly.identification.findings import Ending
from butterfly.report.orbit_page import orbit_document
from tests.orbit.setting import hanging_study


@pytest.fixture(scope="module")
def study():
    return hanging_study()


def test_why_the_rounds_ended_is_told_beside_how_the_estimate_did(study):
    told = orbit_document(study, None)
    assert told["rounds_ending"] == study.calibration.ending
    assert told["ending"] == Ending.CONVERGED
