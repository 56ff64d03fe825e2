"""The report of an orbit."""

import math
from dataclasses import replace

import pytest

from butterfly.experiment.record import AlsoRecord, OrbitRecord
from butterfly.identification.trust import Ending
from butterfly.report.orbit_page import orbit_document, orbit_headline, orbit_page
from butterfly.verdict import Level
from tests.orbit.setting import hanging_study


@pytest.fixture(scope="module")
def study():
    return hanging_study()


def test_why_the_rounds_ended_is_told_beside_how_the_estimate_did(study):
    told = orbit_document(study, None)
    assert told["rounds_ending"] == study.calibration.ending
    assert told["ending"] == Ending.CONVERGED


def record(**changes):
    """Return the record of an orbit of 60 degrees that was reached in the second round."""
    about = {"target_rad": math.radians(60), "amplitudes_rad": (1.7, math.radians(59.95))}
    about |= {"ending": "the amplitude error is within its bound", "reached": True}
    more = {"absolute": True, "free_run_rms_rad": {}, "cross_orbit": {}}
    return OrbitRecord(**(about | more | changes))


def test_first_it_is_said_whether_the_orbit_that_was_asked_for_is_held():
    (text,) = orbit_headline(record())
    assert text == "Held: an orbit of 60°. Reached 59.95° in 2 rounds; before, 97.4°."


def test_of_an_orbit_that_is_not_held_it_is_said_what_to_do():
    (text,) = orbit_headline(
        record(amplitudes_rad=(None, 1.2), reached=False, ending="all 2 rounds are done")
    )
    assert text.startswith("Not held: an orbit of 60°. Reached 68.75° in 2 rounds; before, turned")
    assert text.endswith(
        "Ended as all 2 rounds are done: give it more rounds (control: rounds), or other terms "
        "(recalibration: candidates)."
    )


def test_another_orbit_is_said_in_its_own_unit_and_whether_both_agree():
    speed = {"target_rad_s": 8.0, "speeds_rad_s": (8.01,), "ending": "", "reached": True}
    differences = {"p1": (-1.0, 1.0), "p3": (0.1, 0.2)}
    also = AlsoRecord(**speed, absolute=True, differences=differences)
    assert orbit_headline(record(also=also))[1:] == (
        "Held: an orbit of 8 rad/s mean speed. Reached 8.01 rad/s in 1 round.",
        "Both orbits agree within their 95 % intervals on p1, not on p3.",
    )


def test_the_page_begins_with_whether_the_orbit_is_held(study):
    held = study.calibration.reached
    page = orbit_page(study)
    assert page.headed.text == ("Orbit held" if held else "Orbit not held")
    assert page.headed.reasons[: len(page.headed.reasons) - len(page.verdict.lines)] == [
        *orbit_headline(OrbitRecord.of(study))
    ]
    worse = replace(study, calibration=replace(study.calibration, reached=False))
    assert orbit_page(worse).headed.level is not Level.GOOD
