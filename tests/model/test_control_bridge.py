from dataclasses import replace

import control
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from butterfly.errors import InputError
from butterfly.model.control_bridge import (
    frequency_response_data,
    linearised,
    nonlinear_system,
    transfer_function,
)
from butterfly.model.greybox import simulate
from butterfly.model.kinematics import coulomb_describing_function, gravity_describing_function
from butterfly.model.linear import Linearisation, frequency_response
from butterfly.model.parameters import AddedMass, LumpedParameters

ROBOT = LumpedParameters(p1=0.003, p2=1e-3, p3=0.05, p4=0.4, coulomb=1e-3, delay=0.01, drag=1e-4)
OMEGA = np.array([1.0, 3.0, 4.0, 8.0])


def test_the_linearisations_have_the_model_s_response():
    expected = frequency_response(ROBOT, OMEGA)
    late = [linearised(ROBOT, pade_order=4)(1j * w)[0, 0] for w in OMEGA]
    np.testing.assert_allclose(late, expected, rtol=1e-8)
    undelayed = expected * np.exp(1j * OMEGA * ROBOT.delay)
    np.testing.assert_allclose(transfer_function(ROBOT)(1j * OMEGA), undelayed, rtol=1e-12)
    system = linearised(ROBOT, pade_order=0)
    found = np.array([system(1j * w)[0, 0] for w in OMEGA])
    np.testing.assert_allclose(found, undelayed, rtol=1e-10)
    measured = frequency_response_data(OMEGA[::-1], expected[::-1])
    np.testing.assert_allclose(measured.complex, expected)


robots = st.builds(
    LumpedParameters,
    p1=st.floats(1e-3, 1e-2),
    p2=st.floats(3e-4, 5e-3),
    p3=st.floats(-0.02, 0.2),
    p4=st.floats(0.01, 10),
    p3_offset=st.floats(-0.02, 0.02),
    tilt=st.floats(-0.5, 0.5),
    delay=st.one_of(st.just(0.0), st.floats(1e-4, 0.1)),
    back_emf=st.floats(0, 3e-4),
    time_constant=st.one_of(st.just(0.0), st.floats(1e-4, 0.05)),
    cogging=st.floats(-5e-3, 5e-3),
    cogging_cosine=st.floats(-5e-3, 5e-3),
    cogging_periods=st.sampled_from([2.0, 7.0]),
    coulomb=st.floats(0, 1e-3),
    load=st.floats(0, 1e-3),
)
masses = st.builds(AddedMass, mass=st.floats(0, 0.2), arm=st.floats(0, 0.15))


@given(robots, masses, st.floats(-3, 3))
def test_the_state_space_has_the_linearisation_s_response_whatever_lag_and_delay(
    robot, mass, angle
):
    """To 1e-6 up to 1.4/delay rad/s, and without the delay at every frequency."""
    exact = Linearisation.of(robot.with_added_mass(mass), angle)
    omega = np.geomspace(0.1, 1.4 / max(robot.delay, 0.01), 30)
    system = linearised(robot, mass, angle=angle)
    assert system.name == "hand"
    found = system["angle", "command"](1j * omega)
    np.testing.assert_allclose(found, exact.response(omega), rtol=1e-6)
    undelayed = exact.response(omega) * np.exp(1j * omega * robot.delay)
    bare = linearised(robot, mass, angle=angle, pade_order=0)
    np.testing.assert_allclose(bare["angle", "command"](1j * omega), undelayed, rtol=1e-8)
    assert bare.name == ("hand_without_delay" if robot.delay else "hand")
    assert system.nstates == 2 + (robot.time_constant > 0) + 4 * (robot.delay > 0)


def test_the_velocity_is_the_angle_s_slope_and_states_are_named():
    robot = replace(ROBOT, back_emf=5e-4, time_constant=0.01)
    system = linearised(robot, AddedMass(mass=0.05, arm=0.1), pade_order=2)
    assert system.state_labels == ["angle", "velocity", "torque", "delay[0]", "delay[1]"]
    angle, velocity = system(4j)[:, 0]
    assert velocity == pytest.approx(4j * angle)


def test_a_negative_delay_is_left_out_and_the_name_says_so():
    ahead, none = (linearised(replace(ROBOT, delay=delay)) for delay in (-1e-3, 0.0))
    assert (ahead.name, none.name) == ("hand_without_delay", "hand")
    np.testing.assert_array_equal(ahead.A, none.A)
    with pytest.raises(InputError, match="order: got -1"):
        linearised(ROBOT, pade_order=-1)


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


def test_the_describing_function_of_gravity_is_that_of_a_sine_sampled():
    expected = control.describing_function(np.sin, [0.5, 1.5], num_points=500)
    np.testing.assert_allclose(gravity_describing_function([0.5, 1.5]), expected, rtol=1e-4)


def test_the_describing_function_of_coulomb_friction_falls_with_the_swing():
    assert coulomb_describing_function(0.5) == pytest.approx(4j / (np.pi * 0.5))
