"""What is known of motor and hand says something of p4, and of a slide's p1."""

import numpy as np
import pytest

from butterfly.errors import InputError
from butterfly.identification.data import DataSet
from butterfly.identification.implied import apart, implied
from butterfly.logs.log import InputKind
from butterfly.model.known import Knowledge, Known
from butterfly.model.parameters import JointKind

MOTOR = {"torque_constant": (0.05, 0.002), "resistance": (2.3, 0.12), "gear_ratio": 4}


def _implied(told, kind=InputKind.VOLTAGE, joint=JointKind.HINGE):
    return implied(Knowledge.told(told), kind, joint).parameters


def test_a_motor_s_data_sheet_tells_the_gain():
    """By the closed form of a quotient, and by drawing."""
    p4 = _implied(MOTOR)["p4"]
    assert p4.value == pytest.approx(4 * 0.05 / 2.3)
    assert p4.uncertainty / p4.value == pytest.approx(np.hypot(0.002 / 0.05, 0.12 / 2.3))
    rng = np.random.default_rng(0)
    torque, resistance = (
        mean + spread * rng.standard_normal(100_000)
        for mean, spread in (MOTOR["torque_constant"], MOTOR["resistance"])
    )
    drawn = 4 * torque / resistance
    assert p4.value == pytest.approx(np.mean(drawn), rel=0.005)
    assert p4.uncertainty == pytest.approx(np.std(drawn), rel=0.02)


def test_a_hinge_without_a_gear_is_driven_directly_and_a_slide_is_not():
    told = {"torque_constant": 0.05, "resistance": 2.0}
    assert _implied(told)["p4"] == Known(value=0.025)
    assert not _implied(told, joint=JointKind.SLIDE)


def test_a_slide_s_mass_and_rotor_tell_its_inertia():
    told = {"hand_mass": (0.5, 0.003), "gear_ratio": 100.0, "rotor_inertia": (1e-5, 4e-7)}
    p1 = _implied(told, joint=JointKind.SLIDE)["p1"]
    assert p1.value == pytest.approx(0.6)
    assert p1.uncertainty == pytest.approx(0.005)
    assert "p1" not in _implied(told)


def test_of_a_torque_command_nothing_of_the_motor_tells_the_gain():
    assert not _implied(MOTOR, InputKind.TORQUE)


def test_two_sources_weigh_by_their_variances():
    told = {"p4": (0.0250, 0.0005), "torque_constant": (0.05, 0.001), "resistance": 2.1}
    follows = (0.05 / 2.1, 0.001 / 2.1)
    weights = np.array([0.0005**-2, follows[1] ** -2])
    p4 = _implied(told)["p4"]
    assert p4.value == pytest.approx(weights @ [0.025, follows[0]] / weights.sum())
    assert p4.uncertainty == pytest.approx(weights.sum() ** -0.5)
    far = apart(Knowledge.told(told), InputKind.VOLTAGE)
    assert far == {"p4": pytest.approx((0.025 - follows[0]) / np.hypot(0.0005, follows[1]))}


def test_what_is_exact_counts_alone_and_two_exact_values_agree_or_are_refused():
    sheet = {"torque_constant": 0.05, "resistance": 2.0}
    assert _implied(sheet | {"p4": (0.03, 0.001)})["p4"] == Known(value=0.025)
    uncertain = {"torque_constant": (0.05, 0.01), "resistance": 2.0}
    assert _implied(uncertain | {"p4": 0.03})["p4"] == Known(value=0.03)
    assert _implied(sheet | {"p4": 0.025001})["p4"] == Known(value=0.025001)
    with pytest.raises(InputError, match=r"p4: got 0.03; expected 0.025, which follows"):
        _implied(sheet | {"p4": 0.03})


def test_a_data_set_knows_what_follows_however_often_it_is_told_more(sine_log):
    data = DataSet.of([sine_log], known=Knowledge.told({"torque_constant": (0.05, 0.001)}))
    assert "p4" not in data.known.parameters
    data = data.knowing(Knowledge.told({"resistance": 2.0, "p4": (0.025, 0.0005)}))
    for more in ({}, {"hand_mass": 0.1}, {"p2": 0.01}):
        data = data.knowing(Knowledge.told(more)).take([0])
        assert data.known.parameters["p4"].uncertainty == pytest.approx(0.0005 / np.sqrt(2))
        assert data.told.parameters["p4"].uncertainty == 0.0005
