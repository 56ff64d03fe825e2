import control
import numpy as np
import pytest

from butterfly.model.control_bridge import (
    GravityNonlinearity,
    frequency_response_data,
    friction_gain,
    linearised,
    nonlinear_system,
    transfer_function,
)
from butterfly.model.greybox import simulate
from butterfly.model.linear import frequency_response
from butterfly.model.parameters import LumpedParameters

ROBOT = LumpedParameters(p1=0.003, p2=1e-3, p3=0.05, p4=0.4, coulomb=1e-3, delay=0.01, drag=1e-4)
OMEGA = np.array([1.0, 3.0, 4.0, 8.0])


def test_the_linearisations_have_the_model_s_response():
    expected = frequency_response(ROBOT, OMEGA)
    late = transfer_function(ROBOT, pade_order=4)(1j * OMEGA)
    np.testing.assert_allclose(late, expected, rtol=1e-8)
    undelayed = expected * np.exp(1j * OMEGA * ROBOT.delay)
    np.testing.assert_allclose(transfer_function(ROBOT)(1j * OMEGA), undelayed, rtol=1e-12)
    system = linearised(ROBOT, pade_order=0)
    found = np.array([system(1j * w)[0, 0] for w in OMEGA])
    np.testing.assert_allclose(found, undelayed, rtol=1e-10)
    measured = frequency_response_data(OMEGA[::-1], expected[::-1])
    np.testing.assert_allclose(measured.complex, expected)


def test_upside_down_it_is_unstable():
    assert max(linearised(ROBOT, angle=np.pi).poles().real) > 0


def test_the_nonlinear_system_moves_as_the_grey_box_does():
    time = np.linspace(0, 5, 2501)
    drive = 0.15 * np.sin(4 * time)
    moved = control.input_output_response(
        nonlinear_system(ROBOT),
        time,
        drive,
        [0.3, 0.0],
        solve_ivp_method="LSODA",
        solve_ivp_kwargs={"rtol": 1e-7, "atol": 1e-9},
    )
    middles = (drive[1:] + drive[:-1]) / 2
    inputs = np.column_stack([drive[:-1], middles, drive[1:]])
    angle, _ = simulate(ROBOT, time, inputs, 0.3)
    assert np.ptp(angle) > 0.5
    np.testing.assert_allclose(moved.outputs[0], angle, atol=5e-3)


def test_the_describing_functions_are_python_control_s():
    numeric = control.describing_function(GravityNonlinearity(), [0.5, 1.5], num_points=500)
    expected = control.describing_function(np.sin, [0.5, 1.5], num_points=500)
    np.testing.assert_allclose(numeric, expected, rtol=1e-4)
    assert friction_gain(ROBOT, 0.5) == pytest.approx(1e-3 * 4j / (np.pi * 0.5))
