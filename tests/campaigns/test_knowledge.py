"""What runs tell of the joint: whether its scale is open, how near the goal is, what to expect."""

from types import SimpleNamespace

import pytest

import butterfly as bf
from butterfly.campaigns.plan import Knowledge
from butterfly.identification.design import OF_GOAL
from butterfly.model.linear import resonance_frequency
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass

MASS = AddedMass(mass=0.05, arm=0.1)
BENCH = SimpleNamespace(braking=0.1, is_loaded_anew=False, home=0.02, near=0.1)


def _knowing(*masses, goal=0.01, known=None, model=None):
    steps = [SimpleNamespace(added_mass=mass) for mass in masses]
    folder = SimpleNamespace(journal=SimpleNamespace(steps=steps))
    knowledge = Knowledge(BENCH, folder, goal, masses, known or {})
    knowledge.model = model
    return knowledge


@pytest.fixture(scope="module")
def model(quick_data):
    return bf.identify(quick_data)


def test_the_scale_is_open_until_there_is_another_mass_or_a_known_value():
    assert _knowing(NO_ADDED_MASS).is_open
    assert not _knowing(NO_ADDED_MASS, MASS).is_open
    assert not _knowing(NO_ADDED_MASS, known={"p1": 0.004}).is_open


def test_without_a_model_nothing_is_expected_or_reached():
    knowledge = _knowing(NO_ADDED_MASS, MASS)
    assert knowledge.sound is None
    assert knowledge.expected(MASS) is None
    assert knowledge.shares == {}
    assert not knowledge.is_reached


def test_the_goal_is_reached_where_the_widest_interval_is_as_wanted(model):
    shares = _knowing(NO_ADDED_MASS, MASS, model=model).shares
    assert {*shares} == {*OF_GOAL} & {*model.estimate.names}
    widest = max(shares.values())
    for times, reached in ((1.1, True), (0.9, False)):
        knowledge = _knowing(NO_ADDED_MASS, MASS, goal=0.01 * widest * times, model=model)
        assert knowledge.is_reached is reached


def test_a_joint_is_expected_to_move_as_the_model_does_and_to_hang_where_it_rests(model):
    knowledge = _knowing(NO_ADDED_MASS, MASS, model=model)
    expected, loaded = knowledge.expected(MASS), model.parameters.with_added_mass(MASS)
    assert expected.hanging == BENCH.home
    assert expected.stiffness == pytest.approx(loaded.p3 / loaded.p1)
    assert expected.brake == pytest.approx(0.5 * BENCH.braking * loaded.p4 / loaded.p1)
    assert expected.resonance <= resonance_frequency(loaded)
    speed, near = knowledge.damping(model, MASS, 0.1)
    faster, _ = knowledge.damping(model, MASS, 0.2)
    assert near == BENCH.near
    assert 0 < speed < faster
