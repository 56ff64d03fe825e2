"""Physical parameters from lumped ones and what is known, against draws of all that is possible."""

import numpy as np
import pytest

from butterfly.identification.derived_quantities import WAYS, implied
from butterfly.identification.physical import Missing, physical_parameters
from butterfly.logs.log import InputKind
from butterfly.model.parameters import (
    NO_ADDED_MASS,
    AddedMass,
    Friction,
    Hand,
    JointKind,
    VoltageDrive,
)
from butterfly.model.prior import Prior
from butterfly.plant.robot import Robot
from tests.identification.simulated import estimate_of

HAND = Hand(mass=0.1, com_distance=0.05, inertia=0.003)
DRIVE = VoltageDrive(resistance=2.0, torque_constant=0.05, back_emf_constant=0.05)
TRUTH = Robot(hand=HAND, drive=DRIVE, friction=Friction(viscous=2e-4)).lumped
NAMES = ("p1", "p2", "p3", "p4")
VALUES = np.array([getattr(TRUTH, name) for name in NAMES])
MOTOR = {"hand_mass": (0.1, 0.002), "resistance": (2.1, 0.06), "torque_constant": (0.05, 0.001)}
MOTOR |= {"back_emf_constant": (0.05, 0.002), "rotor_inertia": (1e-4, 1e-5)}
UPRIGHT = AddedMass(gravity=0.0)
SLIDE = AddedMass(joint=JointKind.SLIDE)
DERIVED = {way.name for way in WAYS if way.symbol}


def _covariance(share):
    """All scaled by one unknown, as masses alone leave it, and errors of their own."""
    own = np.diag((0.3 * share * VALUES) ** 2)
    return own + share**2 * np.outer(VALUES, VALUES)


def _of_logs(told, values=VALUES, covariance=None, kind=InputKind.VOLTAGE, carrier=NO_ADDED_MASS):
    """Return what is told of an estimate that knows nothing but its logs."""
    covariance = _covariance(0.01) if covariance is None else covariance
    return physical_parameters(estimate_of(values, covariance), Prior.of(told), kind, carrier)


def _parts(found):
    """Return the names of motor and hand's parameters among all that follows."""
    return {each.name for each in found.parameters} - DERIVED


def _drawn(count=200_000):
    """Draw what was told, weigh it by the logs, and draw the rest from these: no first order."""
    rng = np.random.default_rng(0)
    covariance = _covariance(0.03)
    draw = {
        name: mean + error * rng.standard_normal(count) for name, (mean, error) in MOTOR.items()
    }
    p4 = draw["torque_constant"] / draw["resistance"]
    gap = p4 - VALUES[3]
    weight = np.exp(-0.5 * gap**2 / covariance[3, 3])
    slope = covariance[:3, 3] / covariance[3, 3]
    rest = covariance[:3, :3] - np.outer(slope, covariance[3, :3])
    p1, p2, p3 = (
        VALUES[:3, None]
        + slope[:, None] * gap
        + np.linalg.cholesky(rest) @ rng.standard_normal((3, count))
    )
    distance = p3 / (9.81 * draw["hand_mass"])
    about = p1 - draw["hand_mass"] * distance**2
    return weight / weight.sum(), {
        "resistance": draw["resistance"],
        "torque_constant": draw["torque_constant"],
        "viscous_friction": p2 - draw["back_emf_constant"] * p4,
        "com_distance": distance,
        "hand_inertia": p1 - draw["rotor_inertia"],
        "inertia": about - draw["rotor_inertia"],
    }


@pytest.mark.parametrize("used", [False, True])
def test_values_and_errors_are_those_of_all_that_is_possible(used):
    """Whether or not the estimate has used R and k_t as knowledge of p4."""
    covariance, told = _covariance(0.03), Prior.of(MOTOR)
    known = implied(told, InputKind.VOLTAGE)
    estimate = estimate_of(VALUES, covariance)
    if used:
        p4 = known.parameters["p4"]
        gain = covariance[:, 3] / (covariance[3, 3] + p4.uncertainty**2)
        values = VALUES + gain * (p4.value - VALUES[3])
        estimate = estimate_of(values, covariance - np.outer(gain, covariance[3]), known)
    found = physical_parameters(estimate, known, InputKind.VOLTAGE, NO_ADDED_MASS)
    weight, drawn = _drawn()
    assert _parts(found) == drawn.keys()
    for name, values in drawn.items():
        mean = weight @ values
        spread = np.sqrt(weight @ (values - mean) ** 2)
        assert found[name].standard_error == pytest.approx(spread, rel=0.03), name
        assert found[name].value == pytest.approx(mean, abs=0.1 * spread), name


def test_a_weighed_hand_is_separated_as_its_closed_form_says():
    covariance = np.zeros((4, 4))
    covariance[np.ix_([0, 2], [0, 2])] = [[4e-10, 1e-9], [1e-9, 1e-8]]
    found = _of_logs({"hand_mass": (0.1, 1e-3)}, covariance=covariance)
    assert found["com_distance"].value == pytest.approx(0.05)
    assert found["inertia_with_rotor"].value == pytest.approx(0.003)
    error = 0.05 * np.hypot(1e-4 / 0.04905, 0.01)
    assert found["com_distance"].standard_error == pytest.approx(error)
    reach = 0.05 * np.hypot(4 * 1e-4 / 0.04905, 1.96 * 0.01)
    assert found["com_distance"].half_width == pytest.approx(reach, rel=1e-4)


def test_one_part_of_the_motor_tells_another():
    def told(name, **known):
        return _of_logs(known)[name]

    assert told("resistance", torque_constant=0.05).value == pytest.approx(2.0)
    assert told("resistance", torque_constant=0.05, gear_ratio=2.0).value == pytest.approx(4.0)
    found = told("torque_constant", resistance=(2.0, 0.02), gear_ratio=2.0)
    assert found.value == pytest.approx(0.025)
    assert found.standard_error / found.value == pytest.approx(np.hypot(0.01, np.sqrt(1.09) * 0.01))
    friction = told("viscous_friction", back_emf_constant=0.025, gear_ratio=2.0)
    assert friction.value == pytest.approx(2e-4)


def test_a_command_in_amperes_shows_in_its_current_and_hides_the_rest():
    told = {"torque_constant": 0.05, "gear_ratio": 10.0, "resistance": 2.0}
    found = _of_logs(told, np.array([1.0, 0.1, 3.0, 0.5]), kind=InputKind.TORQUE)
    assert _parts(found) == {"motor_current"}
    assert found["motor_current"].value == pytest.approx(1.0)
    missing = {each.missing: each for each in found.unidentified}
    assert missing[Missing.UNUSED].names == ("resistance",)
    assert Missing.COMMAND in missing
    assert Missing.BACK_EMF not in missing


def test_a_current_tells_the_torque_constant_and_a_duty_nothing_of_the_motor():
    told = {"gear_ratio": 10.0, "resistance": 2.0}
    found = _of_logs(told, np.array([1.0, 0.1, 3.0, 0.5]), kind=InputKind.CURRENT)
    assert found["torque_constant"].value == pytest.approx(0.05)
    missing = {each.missing for each in found.unidentified}
    assert Missing.UNUSED in missing
    assert not missing & {Missing.COMMAND, Missing.GAIN, Missing.BACK_EMF}
    known = Prior.of({"gear_ratio": 10.0, "torque_constant": 0.05})
    assert implied(known, InputKind.CURRENT).fixed["p4"] == pytest.approx(0.5)
    assert "p4" not in implied(known, InputKind.DUTY).values
    found = _of_logs({}, kind=InputKind.DUTY)
    assert Missing.SUPPLY in {each.missing for each in found.unidentified}


def test_a_slide_has_a_mass_and_no_centre_of_it():
    values = np.array([0.6, 0.1, 0.0, 2.0])
    rotor = {"rotor_inertia": (1e-5, 1e-6), "gear_ratio": 100.0}
    found = _of_logs(rotor, values, np.diag([1e-4, 0, 0, 0]), carrier=SLIDE)
    assert _parts(found) == {"hand_mass"}
    assert found["hand_mass"].value == pytest.approx(0.5)
    assert found["hand_mass"].standard_error == pytest.approx(np.hypot(0.01, 0.01))
    found = _of_logs({"hand_mass": 0.5, "gear_ratio": 100.0}, values, carrier=SLIDE)
    assert found["rotor_inertia"].value == pytest.approx(1e-5)
    found = _of_logs({"hand_mass": 0.5, "torque_constant": 0.1}, values, carrier=SLIDE)
    assert _parts(found) == set()
    assert Missing.GEAR in {each.missing for each in found.unidentified}


def test_what_is_left_open_is_named_with_its_remedy():
    def missing(told, **setting):
        return [each.missing for each in _of_logs(told, **setting).unidentified]

    assert missing({}) == [Missing.MASS, Missing.ROTOR, Missing.GAIN, Missing.BACK_EMF]
    assert missing(MOTOR) == []
    assert missing(MOTOR, carrier=UPRIGHT) == [Missing.GRAVITY]
    assert "com_distance" not in {each.name for each in _of_logs(MOTOR, carrier=UPRIGHT).parameters}
    (most,) = [each.most for each in _of_logs({}).unidentified if each.most]
    assert most.value == pytest.approx(TRUTH.p2 / TRUTH.p4)


def test_a_centre_of_mass_beside_its_line_and_a_tilted_axis_are_taken_into_account():
    hand = Hand(mass=0.1, com_distance=0.05, com_offset=0.02, inertia=0.003, tilt=0.4)
    lumped = Robot(hand=hand, drive=DRIVE, friction=Friction()).lumped
    names = (*NAMES, "p3_offset", "tilt")
    values = np.array([getattr(lumped, name) for name in names])
    estimate = estimate_of(values, np.diag((1e-3 * values) ** 2), names=names)
    told = Prior.of({"hand_mass": 0.1})
    found = physical_parameters(estimate, told, InputKind.TORQUE, NO_ADDED_MASS)
    assert found["com_distance"].value == pytest.approx(0.05)
    assert found["com_offset"].value == pytest.approx(0.02)
    assert found["inertia_with_rotor"].value == pytest.approx(0.003)


def test_an_estimate_without_uncertainties_has_values_only():
    found = _of_logs(MOTOR, covariance=np.full((4, 4), np.nan))
    assert found["com_distance"].value == pytest.approx(0.05)
    assert np.isnan(found["com_distance"].standard_error)
    assert "resistance" not in {each.name for each in found.parameters}
