"""Robots of given parameters, and their parameters."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from butterfly.errors import InputError
from butterfly.model.parameters import (
    Friction,
    Hand,
    LumpedParameters,
    TorqueDrive,
    VoltageDrive,
)
from butterfly.plant.robot import Robot
from tests.model.joints import positive


def test_noise_that_makes_more_back_emf_than_damping_is_no_joint_that_is_driven_by_its_friction():
    found = LumpedParameters(p1=0.01, p2=0.03, p3=0.3, p4=0.1, back_emf=0.031)
    assert Robot.of_lumped(found).lumped.p2 == pytest.approx(0.03)


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
