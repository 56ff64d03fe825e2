"""Joints that other laboratories have: slides, flywheels, decays, drives wired the other way."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from butterfly.api.changed import Changed
from butterfly.comparison.three_way import compare_three
from butterfly.errors import IdentifiabilityError, InputError
from butterfly.identification.data import DataSet
from butterfly.identification.design import next_experiments
from butterfly.identification.estimators import OutputError, WeakForm
from butterfly.identification.identify import identify
from butterfly.identification.inference.identifiability import Conditioning
from butterfly.identification.parameters_by_hand import given_estimate
from butterfly.logs.health import examine
from butterfly.logs.log import InputKind
from butterfly.model.parameters import AddedMass, JointKind
from butterfly.model.prior import Prior
from butterfly.plant.robot import Robot
from butterfly.report.inspection import health_rows
from butterfly.report.summary import summary
from tests.identification.simulated import driven, noisy
from tests.independent.integrator import Joint

FIT = OutputError(terms=(), workers=1)
SLIDE = AddedMass(joint=JointKind.SLIDE)


def _logs(joint, *inputs, angle=0.0, added=SLIDE, noise=1e-5):
    exact = [
        driven(joint, 4e-3 * np.arange(each.size), each, angle, added_mass=added) for each in inputs
    ]
    return noisy(exact, noise, np.random.default_rng(3))


@pytest.fixture(scope="module")
def slide():
    levels = np.repeat([0.8, -1.0, 0.3, 1.0, -0.9, -0.4, 0.7, -0.6], 190)
    logs = _logs(Joint(2.0, 4.0, 0.0, 3.0, coulomb=0.5), levels, levels[::-1].copy())
    return DataSet.of(logs, known=Prior.of({"p4": 3.0}))


def test_a_wheel_that_runs_on_is_identified_from_steps_of_one_sign():
    """It never turns back, and where Stribeck friction would act is not among its speeds."""
    steps = np.repeat([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0], 250)
    logs = _logs(Joint(1.2e-4, 6.57e-4, 0.0, 0.01565, coulomb=2e-3), steps, added=AddedMass())
    known = Prior.of({"p3": 0.0, "p4": 0.01565})
    estimate = FIT(DataSet.of(logs, known=known))
    assert estimate.parameters.p1 == pytest.approx(1.2e-4, rel=0.01)
    assert estimate.parameters.coulomb == pytest.approx(2e-3, rel=0.01)


def test_a_small_mass_on_a_heavy_slide_tells_the_scale_to_simulations():
    """Of a tenth of what moves; a closed form takes it for noise, and finds no inertia."""
    rng = np.random.default_rng(0)
    joint = Joint(4.0, 0.9, 0.0, 0.15, coulomb=4e-4)
    logs = []
    for added in (SLIDE, replace(SLIDE, mass=0.4)):
        loaded = joint._replace(inertia=joint.inertia + added.mass)
        wave = np.cumsum(rng.standard_normal((2, 3000)), axis=1) * 0.02
        logs += _logs(loaded, *wave, added=added, noise=1e-3)
    data = DataSet.of(logs)
    closed = WeakForm(terms=())(data).parameters
    assert not closed.p1 > 0
    found = FIT(data).parameters
    assert found.p1 == pytest.approx(4.0, rel=0.02)
    assert found.p4 == pytest.approx(0.15, rel=0.02)


def test_logs_that_tell_nothing_of_a_parameter_are_refused():
    rows = np.zeros((8, 2))
    with pytest.raises(IdentifiabilityError, match="add logs at other speeds"):
        Conditioning.of(rows, ("p1", "p4")).refuse_singular()


def test_a_known_gain_of_the_wrong_sign_is_named(slide):
    told = slide.knowing(Prior.of({"p4": -3.0}))
    with pytest.raises(IdentifiabilityError, match=r"inertia would be -.*sign.*p4 = -3"):
        FIT(told)


def test_free_decays_need_no_delay_to_be_known():
    joint, still = Joint(7.6e-3, 2.4e-3, 0.21, 1.0, 1.5e-3), np.zeros(2000)
    logs = [
        *_logs(joint, still, angle=0.9, added=AddedMass()),
        *_logs(joint, still, angle=-0.6, added=AddedMass()),
    ]
    for gain in (1.0, 0.0):
        known = Prior.of({"p3": 0.21, "p4": gain})
        estimate = FIT(DataSet.of(logs, known=known))
        assert estimate.parameters.p1 == pytest.approx(7.6e-3, rel=1e-3)
        assert estimate.fixed["delay"] == 0.0
    free = [replace(log, input_kind=InputKind.NONE) for log in logs]
    found = identify(DataSet.of(free, known=Prior.of({"p3": 0.21})), FIT)
    np.testing.assert_array_equal(found.estimate.values, estimate.values)
    assert "p4, delay cannot be estimated" in " ".join(summary(found))
    assert {row.name for row in found.estimate.table()} == {"p1", "p2", "coulomb", "p3"}
    for use in (
        partial(Robot.of_lumped, found.parameters),
        partial(next_experiments, DataSet.of(free), found.estimate),
    ):
        with pytest.raises(InputError, match=r"p4: got 0 \(no log is driven\)"):
            use()
    (seen,) = compare_three(DataSet.of(free[:1]), found.estimate, [0])
    assert seen.fits["MuJoCo"] > 99


def test_given_parameters_are_completed_by_what_is_known_of_the_data(slide):
    given = given_estimate({"p1": 2.0, "p2": 4.0, "coulomb": 0.5}, "test", data=slide)
    assert (given.parameters.p3, given.parameters.p4) == (0.0, 3.0)


def test_a_slide_is_told_in_metres(slide):
    log = slide.logs[0]
    rows = dict(health_rows(*examine(log)))
    assert rows["angle"].endswith(" m")
    assert "rad" not in rows["amplitude"]


def test_what_has_changed_of_a_slide_is_told_in_kilograms(slide):
    found = identify(slide, WeakForm(terms=()))
    units = {row["parameter"]: row["unit"] for row in Changed.of(found, found).rows()}
    assert (units["p1"], units["p2"], units["coulomb"]) == ("kg", "N s/m", "N")


def test_a_slide_is_not_driven_further_than_its_logs_have_shown(slide):
    way = max(np.ptp(log.angle) for log in slide.logs) / 2
    ranked = next_experiments(slide, WeakForm(terms=())(slide))
    assert not any("decay" in each.what for each in ranked)
    trusted = [each for each in ranked if not each.warning]
    assert trusted
    assert all(each.swing <= way for each in trusted)
    assert all(each.warning.endswith(" m") for each in ranked if "swings" in each.warning)
