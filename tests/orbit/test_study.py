"""A study of an orbit, on a rig that cannot hold the hand at an angle."""

import math
from dataclasses import replace

import numpy as np
import pytest

from butterfly.identification.findings import Ending, FindingKind
from butterfly.model.terms import lower_bounds
from butterfly.orbit.loop import PERIODS, beside_orbit, calibrate, study_orbit
from butterfly.orbit.recalibration import RecalibrationOptions
from butterfly.plant.rig import Simulator
from butterfly.report.orbit_page import orbit_document
from tests.orbit.setting import grey_rig, plant, sixty_degrees, wrong

ROUGH = plant({"coulomb": 1e-4}, step=5e-3)
TRUE = ROUGH.robot.lumped


@pytest.fixture(scope="module")
def study():
    rng = np.random.default_rng(0)
    held = grey_rig(ROUGH, rng)

    def rig(law, start, duration, added):  # noqa: ARG001 - all runs begin where the hand hangs
        return held(law, 0.0, duration, added)

    options = RecalibrationOptions(candidates=("coulomb",))
    plan = sixty_degrees(starts=(0.0, 0.0), kick=2e-3, dither=0.3, rounds=2, recalibration=options)
    return study_orbit(rig, wrong(TRUE, rng), 0.0, plan, rng=rng)


def test_an_orbit_is_studied_from_runs_that_begin_hanging(study):
    assert study.calibration.rounds[-1].reached == pytest.approx(math.radians(60), abs=0.02)
    assert study.errors["re-calibrated"] < study.errors["generic"]


def test_a_free_run_from_hanging_lasts_some_periods_of_small_swings(study):
    run = beside_orbit(study.held_out, TRUE, 0.0)
    period = 2 * math.pi * math.sqrt(TRUE.p1 / TRUE.p3)
    assert np.ptp(run.log.time) == pytest.approx(PERIODS * period, rel=1e-3)


def test_why_the_rounds_ended_is_told_beside_how_the_estimate_did(study):
    told = orbit_document(study, None)
    assert told["rounds_ending"] == study.calibration.ending
    assert told["ending"] == Ending.CONVERGED


def test_intervals_include_the_simulator_s_own_error_and_without_it_miss_the_truth():
    """MuJoCo's dry friction reverses a step early, for which p3 is too small by 0.004 %."""
    spec = plant({"coulomb": 4e-4}, step=2e-3)
    true = spec.robot.lumped
    rough, fine = spec.rig.rough_and_fine(0)
    plan = sixty_degrees(starts=(0.9, 1.4), duration=16.0, rounds=1)
    alone, whole = (
        calibrate(rough, true, 0.0, plan, plants=plants, rng=np.random.default_rng(0))
        .rounds[-1]
        .recalibration.estimate
        for plants in (None, (rough, fine))
    )
    at, ratio = alone.names.index("p3"), true.p3 / true.p1
    np.testing.assert_array_equal(alone.values, whole.values)
    assert not alone.lower[at] <= ratio <= alone.upper[at]
    assert whole.lower[at] <= ratio <= whole.upper[at]
    (told,) = (each for each in whole.findings if each.kind is FindingKind.PLANT)
    error = whole.values[at] / ratio - 1
    assert (told.parameters, told.number) == (("p3",), pytest.approx(-error, rel=0.2))
    assert not any(each.kind is FindingKind.PLANT for each in alone.findings)


@pytest.mark.parametrize("share", [0.0, 1e-3, 1e3])
def test_a_simulator_s_error_adds_to_each_interval_in_quadrature(study, share):
    found = study.estimate
    error = share * found.standard_errors * np.where(np.arange(found.values.size) % 2, 1, -1)
    wider = found.resting_on(error)
    limits = np.stack([found.lower, found.upper])
    by = np.hypot(limits - found.values, 1.96 * np.abs(error))
    lower = np.maximum(found.values - by[0], lower_bounds(found.names))
    np.testing.assert_allclose(wider.lower, lower, rtol=1e-4)
    np.testing.assert_allclose(wider.upper, found.values + by[1], rtol=1e-4)
    spread = wider.standard_errors**2 - found.standard_errors**2
    np.testing.assert_allclose(spread, error**2, rtol=1e-6, atol=1e-9 * found.covariance.max())


def test_the_grey_box_has_no_error_of_its_own():
    assert replace(ROUGH.rig, simulator=Simulator.GREY_BOX).rough_and_fine(0) is None
