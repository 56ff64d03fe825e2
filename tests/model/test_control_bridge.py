"""Systems of python-control, against the equation and closed forms."""

from dataclasses import replace

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from butterfly.model import control_bridge as bridge
from butterfly.model import linear
from butterfly.model.greybox import simulate
from butterfly.model.parameters import AddedMass
from tests.model.joints import OTHERS, WHOLE, instants, masses, robots


@settings(max_examples=20)
@given(robots, masses, st.floats(-3, 3))
def test_the_state_space_has_the_linearisation_s_response_whatever_lag_and_delay(
    robot, mass, angle
):
    """To 1e-6 up to 1.4/delay rad/s, and without the delay at every frequency."""
    exact = linear.LinearJoint.of(robot.with_added_mass(mass), angle)
    omega = np.geomspace(0.1, 1.4 / max(robot.delay, 0.01), 30)
    system = bridge.linearised(robot, mass, angle=angle)
    assert system.name == "hand"
    found = system["angle", "command"](1j * omega)
    np.testing.assert_allclose(found, exact.response(omega), rtol=1e-6)
    undelayed = exact.response(omega) * np.exp(1j * omega * robot.delay)
    bare = bridge.linearised(robot, mass, angle=angle, pade_order=0)
    np.testing.assert_allclose(bare["angle", "command"](1j * omega), undelayed, rtol=1e-8)
    assert bare.name == ("hand_without_delay" if robot.delay else "hand")
    assert system.nstates == 2 + (robot.time_constant > 0) + 4 * (robot.delay > 0)


def test_states_are_named_and_a_negative_delay_is_left_out():
    late = bridge.linearised(
        replace(WHOLE, delay=0.01), AddedMass(mass=0.05, arm=0.1), pade_order=2
    )
    assert late.state_labels == ["angle", "velocity", "torque", "delay[0]", "delay[1]"]
    angle, velocity = late(4j)[:, 0]
    assert velocity == pytest.approx(4j * angle)
    ahead, none = (bridge.linearised(replace(WHOLE, delay=delay)) for delay in (-1e-3, 0.0))
    assert (ahead.name, none.name) == ("hand_without_delay", "hand")
    np.testing.assert_array_equal(ahead.A, none.A)


@pytest.mark.parametrize("angle", [0.0, 0.8, 3.0])
def test_it_is_the_slope_of_the_nonlinear_system(angle):
    found = control.linearize(bridge.nonlinear_system(WHOLE), [angle, 0.0, 0.0], [0.0])
    expected = bridge.linearised(WHOLE, angle=angle)
    for one, other in ((found.A, expected.A), (found.B, expected.B), (found.C, expected.C)):
        np.testing.assert_allclose(one, other, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("robot", [WHOLE, *OTHERS.values()], ids=["smooth", *OTHERS])
def test_the_nonlinear_system_is_the_whole_equation(robot):
    time = np.linspace(0, 0.8, 161)
    commands = 0.3 * np.sin(4 * time)
    system = bridge.nonlinear_system(robot)
    start = np.eye(1, system.nstates)[0] * 0.3
    finely = {"rtol": 1e-7, "atol": 1e-9, "max_step": 2e-2}
    moved = control.input_output_response(
        system, time, commands, start, solve_ivp_method="LSODA", solve_ivp_kwargs=finely
    )
    straight = np.interp(instants(time), time, commands)
    angle, _ = simulate(robot, time, robot.delivered(straight), 0.3)
    assert np.ptp(angle) > 0.3
    np.testing.assert_allclose(moved.outputs[0], angle, atol=2e-4)


@pytest.mark.parametrize("delay", [0.0, 2e-3, 0.01, 0.0137, 0.03])
@pytest.mark.parametrize("constant", [0.0, 4e-3])
def test_a_discrete_system_has_the_exact_delay(delay, constant):
    """Against the continuous system, simulated with a finely held command that comes later."""
    robot = replace(WHOLE, delay=delay, time_constant=constant)
    mass, step, fine = AddedMass(mass=0.05, arm=0.1), 0.01, 1e-4
    commands = np.random.default_rng(0).standard_normal(40)
    system = bridge.discretised(robot, step, mass, angle=0.3)
    found = control.forced_response(system, inputs=commands).outputs
    ahead = bridge.discretised(replace(robot, delay=0.0), fine, mass, angle=0.3)
    held = np.concatenate([np.zeros(round(delay / fine)), np.repeat(commands, round(step / fine))])
    expected = control.forced_response(ahead, inputs=held).outputs[:, :: round(step / fine)]
    np.testing.assert_allclose(found, expected[:, : found.shape[1]], rtol=1e-9, atol=1e-12)
    assert system.dt == step
    slow = np.abs(1j * np.linspace(1, 20, 5))
    late = bridge.linearised(robot, mass, angle=0.3).frequency_response(slow).complex[0, 0]
    sampled = system.frequency_response(slow).complex[0, 0]
    hold = np.sinc(slow * step / 2 / np.pi) * np.exp(-1j * slow * step / 2)
    np.testing.assert_allclose(sampled, late * hold, rtol=0.02)
