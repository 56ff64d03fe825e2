"""A study of an orbit, from runs that begin hanging; what a log of one says of swing and speed."""

import math
from dataclasses import replace

import numpy as np
import pytest

from butterfly.identification.trust import FindingKind
from butterfly.model.terms import lower_bounds
from butterfly.orbit.loop import PERIODS, beside_orbit, calibrate, mean_speed, swing
from butterfly.plant.rig import Simulator
from tests.orbit.setting import ROUGH, hanging_study, plant, runs, sixty_degrees

TRUE = ROUGH.robot.lumped


@pytest.fixture(scope="module")
def study():
    return hanging_study()


def test_an_orbit_is_studied_from_runs_that_begin_hanging(study):
    assert study.calibration.rounds[-1].reached == pytest.approx(math.radians(60), abs=0.02)
    assert study.errors["re-calibrated"] < study.errors["generic"]


def test_a_free_run_from_hanging_lasts_some_periods_of_small_swings(study):
    run = beside_orbit(study.held_out, TRUE, 0.0)
    period = 2 * math.pi * math.sqrt(TRUE.p1 / TRUE.p3)
    assert np.ptp(run.log.time) == pytest.approx(PERIODS * period, rel=1e-3)


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


def test_the_swing_of_a_log_is_its_amplitude_or_says_that_there_is_none():
    rng = np.random.default_rng(0)
    log = runs(plant({"coulomb": 4e-4}), rng, starts=(0.9,), duration=3.0)[0]
    sine = replace(log, angle=0.1 + 0.7 * np.cos(4 * log.time))
    assert swing(sine, 0.1, 0.0) == pytest.approx(0.7, rel=1e-4)
    assert math.isnan(swing(replace(log, angle=4 * log.time), 0.0, 0.0))
    assert swing(replace(log, angle=0.1 + 0 * log.time), 0.0, 0.0) == 0.0


def test_the_mean_speed_of_a_log_is_that_of_its_whole_turns_or_there_is_none():
    spec = plant()
    log = runs(spec, np.random.default_rng(0), starts=(0.9,), duration=3.0)[0]
    ripple = 0.3 * np.sin(-7.0 * log.time)
    turning = replace(log, angle=0.2 - 7.0 * log.time + ripple)
    assert mean_speed(turning, 0.2, 0.5) == pytest.approx(-7.0, rel=1e-5)
    assert math.isnan(mean_speed(log, 0.0, 0.5))
    assert math.isnan(mean_speed(replace(log, angle=0 * log.time), 0.0, 0.5))
