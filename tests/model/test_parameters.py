import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from butterfly.errors import InputError
from butterfly.model.parameters import (
    AddedMass,
    Friction,
    Hand,
    JointKind,
    LumpedParameters,
    TorqueDrive,
    VoltageDrive,
)
from butterfly.plant.robot import Robot

positive = st.floats(1e-4, 10)


def test_the_thesis_synthetic_hand_lumps_to_its_published_parameters():
    hand = Hand(mass=0.1, com_distance=0.05, inertia=0.003)
    robot = Robot(hand=hand, drive=TorqueDrive(gain=10), friction=Friction(viscous=0.001))
    assert robot.lumped == LumpedParameters(
        p1=pytest.approx(0.00325), p2=0.001, p3=pytest.approx(0.04905), p4=10
    )


def test_back_emf_adds_to_the_damping_as_in_6():
    drive = VoltageDrive(resistance=2, torque_constant=0.05, back_emf_constant=0.04)
    hand, friction = Hand(mass=1, com_distance=0, inertia=1), Friction(viscous=2e-4, coulomb=3e-4)
    lumped = Robot(hand=hand, drive=drive, friction=friction).lumped
    assert lumped.p2 == pytest.approx(2e-4 + 0.04 * 0.05 / 2)
    assert lumped.p4 == pytest.approx(0.05 / 2)
    assert lumped.coulomb == 3e-4


@given(mass=positive, arm=positive, first=positive)
def test_added_masses_on_one_arm_add_up(mass, arm, first):
    bare = LumpedParameters(p1=1, p2=1, p3=1, p4=1)
    one, other, sum_ = (AddedMass(mass=each, arm=arm) for each in (first, mass, first + mass))
    both, together = bare.with_added_mass(one).with_added_mass(other), bare.with_added_mass(sum_)
    assert both.p1 == pytest.approx(together.p1)
    assert both.p3 == pytest.approx(together.p3)


@pytest.mark.parametrize("bad", [-1.0, math.nan, math.inf])
def test_impossible_values_are_refused_by_name(bad):
    with pytest.raises(InputError, match="mass: got"):
        AddedMass(mass=bad, arm=0.1)
    with pytest.raises(InputError, match="coulomb: got"):
        Friction(coulomb=bad)
    with pytest.raises(InputError, match="resistance: got"):
        VoltageDrive(resistance=bad, torque_constant=1, back_emf_constant=1)


TERMS = dict.fromkeys(("p1", "p2", "p4", "coulomb"), positive)
TERMS |= dict.fromkeys(("p3", "p3_offset"), st.floats(-1, 1))
MOTORS = [{}, {"back_emf": 1.0}, {"back_emf": 1.0, "time_constant": 0.01}]


@given(st.fixed_dictionaries(TERMS), st.floats(1.1, 100), st.sampled_from(MOTORS))
def test_a_hand_found_for_lumped_parameters_has_them(terms, share, motor):
    wanted = LumpedParameters(**terms, **motor)
    wanted = replace(wanted, back_emf=wanted.back_emf * wanted.p2)
    least = (math.hypot(wanted.p3, wanted.p3_offset) / 9.81) ** 2 / wanted.p1
    found = Robot.of_lumped(wanted, mass=max(share * least, 1e-3)).lumped
    assert vars(found) == pytest.approx(vars(wanted), rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("mass", [0.0, -1.0, 0.01, math.nan])
def test_a_hand_too_light_for_its_parameters_is_refused(mass):
    with pytest.raises(InputError, match=r"mass .*: got"):
        Robot.of_lumped(LumpedParameters(p1=0.001, p2=0, p3=0.5, p4=1), mass)


def test_a_disc_has_an_inertia_of_its_own_and_no_more_moment():
    point, disc = (AddedMass(mass=0.2, arm=0.1, own_inertia=own) for own in (0.0, 1e-4))
    assert disc.inertia - point.inertia == pytest.approx(1e-4)
    assert disc.inertia_and_moment == pytest.approx((2.1e-3, point.gravity_moment))
    assert str(disc) == "200 g at 100 mm with 0.0001 kg m²"
    assert AddedMass(mass=0.0, own_inertia=1e-4) == AddedMass()
    assert AddedMass(mass=0.2, own_inertia=1e-4, joint=JointKind.SLIDE).own_inertia == 0
    with pytest.raises(InputError, match="own_inertia: got -1"):
        AddedMass(mass=0.2, arm=0.1, own_inertia=-1.0)


def test_a_slide_carries_masses_and_an_upright_axis_no_moments_but_weight():
    slide = AddedMass(mass=0.2, arm=0.3, joint=JointKind.SLIDE)
    assert slide.inertia_and_moment == (0.2, 0.0)
    assert str(slide) == "200 g"
    upright = AddedMass(mass=0.2, arm=0.3, gravity=0.0)
    assert upright.inertia_and_moment == (pytest.approx(0.018), 0.0)
    assert (upright.weight, upright.gravity_moment) == (pytest.approx(0.2 * 9.81), 0)
    assert AddedMass(mass=0.2, arm=0.1, gravity=4.0).weight == pytest.approx(0.8)
    assert AddedMass(mass=0.0, arm=0.3) == AddedMass()


def test_one_added_mass_is_one_in_every_spelling():
    kilograms = AddedMass(mass=0.052, arm=0.15)
    for other in (
        AddedMass(mass=52 * 1e-3 * (1 + 1e-15), arm=15 * 1e-2),
        AddedMass(mass=0.052, arm=0.15, mass_uncertainty=1e-12, arm_uncertainty=1e-3),
    ):
        assert other == kilograms
        assert hash(other) == hash(kilograms)
        assert other.inertia_and_moment == kilograms.inertia_and_moment
        assert str(other) == str(kilograms)
    assert sorted([AddedMass(mass=0.1, arm=0.1), kilograms])[0] is kilograms
    others = {"mass": 0.0521, "arm": 0.1501, "own_inertia": 1e-6, "gravity": 0.0}
    for name, value in (others | {"joint": JointKind.SLIDE}).items():
        assert AddedMass(**{"mass": 0.052, "arm": 0.15, name: value}) != kilograms
    assert kilograms != 0.052
