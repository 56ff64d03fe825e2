"""Every estimator recovers every term that it offers, size and sign, from simulated logs."""

from dataclasses import replace

import numpy as np
import pytest

from butterfly.errors import IdentifiabilityError
from butterfly.identification.data import DataSet
from butterfly.identification.estimators import HarmonicBalance, OutputError, WeakForm
from butterfly.identification.problem import Start
from butterfly.identification.trust import FindingKind
from butterfly.model.prior import Prior
from butterfly.model.terms import BASE_TERMS, LOOP_TERMS, PARAMETERS, TERMS, offered
from butterfly.orbit.recalibration import RecalibrationOptions, recalibrate
from butterfly.report.finding_texts import finding_text
from tests.conftest import MASSES
from tests.identification.simulated import ROBOT, SLOW, SWINGS, noisy, simulated, steady, wild

BESIDE = {"coulomb_slope": {"coulomb": 2e-3}, "stribeck": {"coulomb": 2e-4}}
BESIDE |= {"stribeck_velocity": {"stribeck": 5e-4, "coulomb": 2e-4}}
BESIDE |= {key: {"cogging_periods": 3.0} for key in ("cogging", "cogging_cosine")}
PRESENT = {name: {name: row.size} | BESIDE.get(name, {}) for name, row in TERMS.items() if row.size}
"""What the robot has of each term: several per cent of the torque of its motor."""

TOLERANCE = {"harmonic-balance": 0.06, "weak-form": 0.04, "output-error": 0.01}
"""Relative, where the interval is not to be asked: each method leaves out something of its own."""

ZEROS = dict.fromkeys(MASSES, 0.0)
START = [Start(replace(ROBOT, p1=0.0031, p3=0.041, p4=0.49, coulomb=1e-3), ZEROS)]
SIMULATED = OutputError(terms=(), workers=1)


def _assert_recovered(found, term, truth, tolerance):
    at = found.names.index(term)
    value, inside = float(found.values[at]), found.lower[at] <= truth <= found.upper[at]
    assert np.sign(value) == np.sign(truth)
    assert inside or value == pytest.approx(truth, rel=tolerance)
    assert value == pytest.approx(truth, rel=3 * tolerance)


def _known(robot, term):
    """Return what closed forms are told: the velocity of Stribeck friction."""
    return Prior.of({"stribeck_velocity": robot.stribeck_velocity} if term == "stribeck" else {})


def _balanced(robot, term, terms):
    swings, duration = (SLOW, 30.0) if term == "stribeck" else (SWINGS, 12.0)
    logs = steady(robot, swings, MASSES[::2], duration)
    return HarmonicBalance(terms=terms)(DataSet.of(logs, known=_known(robot, term)))


def _averaged(robot, term, terms):
    estimator = WeakForm(terms=terms, cogging_periods=robot.cogging_periods)
    return estimator.of_logs(wild(robot, MASSES[::2]), ZEROS, _known(robot, term))


def _simulated(robot, term, terms):
    terms = ("stribeck", term) if term == "stribeck_velocity" else terms
    estimator = replace(SIMULATED, terms=terms, cogging_periods=robot.cogging_periods)
    return estimator.of_logs(wild(robot, duration=6.0), START)


ELSEWHERE = {"tilt", "back_emf", "slow_delay", *LOOP_TERMS, *BASE_TERMS}
"""Terms with a test of their own: the first below, those of servos in test_servo_drive.py, that of
clocks in test_real_logs.py."""

METHODS = {"harmonic-balance": _balanced, "weak-form": _averaged, "output-error": _simulated}


@pytest.mark.parametrize(
    ("method", "term"),
    [(method, term) for method in METHODS for term in offered(method) if term not in ELSEWHERE],
)
def test_a_term_is_recovered(method, term):
    robot, truth = replace(ROBOT, **PRESENT[term]), PRESENT[term][term]
    found = METHODS[method](robot, term, (term,))
    _assert_recovered(found, term, truth, TOLERANCE[method])
    if method != "harmonic-balance":
        assert found.parameters.cogging_periods == robot.cogging_periods
    if method == "weak-form":
        for speed in (robot.stribeck_velocity, 0.3, 2.0):
            assert found.parameters.level(speed) == pytest.approx(robot.level(speed), rel=0.05)


@pytest.mark.parametrize("estimator", [HarmonicBalance(terms=()), WeakForm(terms=()), SIMULATED])
def test_unit_sign_clock_and_order_change_p4_alone_and_fewer_samples_nothing(estimator):
    robot, balanced = replace(ROBOT, delay=0.004), isinstance(estimator, HarmonicBalance)
    clean = steady(robot, SWINGS) if balanced else wild(robot)
    logs = noisy(clean, 5e-4, np.random.default_rng(0))
    moved = [replace(log, time=log.time + 7.0, input=-3.0 * log.input) for log in reversed(logs)]
    coarse = [log.take(np.arange(0, log.time.size, 2)) for log in logs]
    before, after, thinned = (estimator(DataSet.of(each)) for each in (logs, moved, coarse))
    unit, errors = np.where(np.array(before.names) == "p4", -3.0, 1.0), before.standard_errors
    np.testing.assert_array_less(abs(after.values * unit - before.values), 0.1 * errors)
    np.testing.assert_array_less(abs(thinned.values - before.values), 5 * errors)
    np.testing.assert_allclose(thinned.values[[0, 2, 3]], before.values[[0, 2, 3]], rtol=0.01)


def test_output_error_recovers_the_size_of_a_tilt_and_says_that_its_sign_is_unknown():
    found = _simulated(replace(ROBOT, **PRESENT["tilt"]), "tilt", ("tilt",))
    assert found.parameters.tilt == pytest.approx(0.5, rel=0.01)
    (said,) = [each for each in found.findings if each.kind is FindingKind.SIGN_UNKNOWN]
    assert said.parameters == ("tilt",)


@pytest.mark.parametrize("term", offered("re-calibration"))
@pytest.mark.parametrize("absolute", [True, False])
def test_recalibration_finds_a_term_and_no_other_of_its_size(term, absolute):
    robot = replace(ROBOT, coulomb=0.0)
    robot = replace(robot, **PRESENT[term])
    masses = MASSES if absolute else MASSES[1:2] * 3
    besides = {"cogging_cosine": ("cogging",), "stribeck": ("coulomb",)}.get(term, ())
    options = RecalibrationOptions(
        candidates=(*besides, term), cogging_periods=robot.cogging_periods
    )
    found = recalibrate(wild(robot, masses), 0.0, options)
    loaded = robot.with_added_mass(masses[0])
    ratio = found.is_ratio(term)
    assert absolute is (not found.estimate.ratios)
    assert ratio is (not absolute and not TERMS[term].of_gain)
    truth = PRESENT[term][term] / (loaded.p1 if ratio else 1.0)
    _assert_recovered(found.estimate, term, truth, 0.03)


def test_what_kept_the_start_s_value_or_was_held_is_part_of_the_estimate():
    robot = replace(ROBOT, bias=-2e-3, drag=8e-4)
    start = [Start(replace(robot, p1=0.0031, coulomb=1e-3), ZEROS)]
    logs = wild(robot, duration=8.0)
    free, fixed = (
        replace(SIMULATED, fixed=names).of_logs(logs, start) for names in ((), ("p4", "p3"))
    )
    assert free.names == PARAMETERS
    assert not {"p3", "p4"} & set(fixed.names)
    assert (fixed.parameters.p3, fixed.parameters.p4) == (ROBOT.p3, ROBOT.p4)
    for found in (free, fixed):
        assert {"bias", "drag"} <= {*found.fixed}
        assert (found.parameters.bias, found.parameters.drag) == (-2e-3, 8e-4)
        assert found.parameters.p1 == pytest.approx(robot.p1, rel=1e-3)


def test_cogging_of_one_period_a_turn_is_dropped_and_said_since_it_is_what_p3_is():
    robot = replace(ROBOT, cogging=-2e-3)
    logs = wild(robot, duration=8.0)
    with pytest.raises(IdentifiabilityError, match="p3 and cogging cannot be identified"):
        WeakForm(terms=("cogging",)).of_logs(logs, ZEROS)
    found = replace(SIMULATED, terms=("cogging",)).of_logs(logs, [Start(ROBOT, ZEROS)])
    assert found.names == PARAMETERS
    (said,) = [each for each in found.findings if each.kind is FindingKind.INSEPARABLE]
    assert said.parameters == ("cogging",)
    assert found.parameters.p3 == pytest.approx(robot.p3 - robot.cogging, rel=2e-3)


def test_with_one_load_friction_by_it_is_coulomb_friction_and_another_mass_is_asked_for():
    """A winch: a pull that is the same everywhere."""
    robot = replace(ROBOT, p3=0.0, bias=2e-3, load_friction=0.2)
    masses = [replace(mass, gravity=0.0) for mass in MASSES[:2]]
    logs = [simulated(robot, mass, lambda t: 0.03 * np.sin(4 * t) - 4e-3, 8.0) for mass in masses]
    start = replace(robot, p1=0.0031, load_friction=0.0)
    fit = replace(SIMULATED, terms=("bias", "load_friction"))
    zeros = dict.fromkeys(masses, 0.0)
    found = fit.of_logs(logs, [Start(start, zeros)], Prior.of({"p3": 0.0}))
    assert "load_friction" not in found.names
    coulomb = robot.coulomb + robot.load_friction * robot.bias
    assert found.parameters.coulomb == pytest.approx(coulomb, rel=1e-3)
    (said,) = [each for each in found.findings if each.kind is FindingKind.INSEPARABLE]
    assert "With one load, load friction and Coulomb friction are one number: add a run" in (
        finding_text(said, {})
    )
