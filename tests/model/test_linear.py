"""One linearisation, against differences of the nonlinear equation and against python-control."""

from dataclasses import replace

import control
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize_scalar

from butterfly.model.control_bridge import linearised, nonlinear_system, transfer_function
from butterfly.model.greybox import simulate
from butterfly.model.linear import Linearisation, frequency_response, resonance_frequency
from butterfly.model.parameters import LumpedParameters

WHOLE = LumpedParameters(
    p1=0.003,
    p2=2e-3,
    p3=0.05,
    p4=0.4,
    p3_offset=0.004,
    cogging=5e-3,
    cogging_cosine=1e-3,
    cogging_periods=3.0,
    back_emf=1.2e-3,
    time_constant=0.02,
    compression=0.3,
    drag=1e-4,
)
OMEGA = np.array([0.5, 3.0, 4.5, 9.0, 40.0])


def test_responses_transfer_function_and_state_space_are_one():
    expected = frequency_response(WHOLE, OMEGA)
    np.testing.assert_allclose(transfer_function(WHOLE)(1j * OMEGA), expected, rtol=1e-10)
    system = linearised(WHOLE)
    assert system.nstates == 3  # the motor's torque lags
    found = np.array([system(1j * w)[0, 0] for w in OMEGA])
    np.testing.assert_allclose(found, expected, rtol=1e-10)


@pytest.mark.parametrize("angle", [0.0, 0.8, 3.0])
def test_it_is_the_slope_of_the_nonlinear_system(angle):
    found = control.linearize(nonlinear_system(WHOLE), [angle, 0.0, 0.0], [0.0])
    expected = linearised(WHOLE, angle=angle)
    for one, other in ((found.A, expected.A), (found.B, expected.B), (found.C, expected.C)):
        np.testing.assert_allclose(one, other, rtol=1e-4, atol=1e-6)


robots = st.builds(
    LumpedParameters,
    p1=st.floats(1e-3, 1e-2),
    p2=st.floats(1e-4, 5e-3),
    p3=st.floats(0.01, 0.2),
    p4=st.just(1.0),
    back_emf=st.floats(0, 1e-4),
    time_constant=st.one_of(st.just(0.0), st.floats(1e-3, 0.05)),
    cogging=st.floats(-2e-3, 2e-3),
    cogging_periods=st.just(2.0),
)


@given(robots)
def test_the_resonance_is_where_the_response_peaks(robot):
    found = resonance_frequency(robot)
    scale = np.sqrt(Linearisation.of(robot).stiffness / robot.p1)
    grid = np.linspace(0.01, 3, 3000) * scale
    gains = np.abs(frequency_response(robot, grid))
    inner = np.flatnonzero((gains[1:-1] > gains[:-2]) & (gains[1:-1] > gains[2:])) + 1
    if found == 0.0:
        assert inner.size == 0
        return
    peak = minimize_scalar(
        lambda w: -abs(complex(frequency_response(robot, w))),
        bounds=(found / 1.1, found * 1.1),
        method="bounded",
        options={"xatol": 1e-9},
    )
    assert found == pytest.approx(peak.x, rel=1e-4)


@pytest.mark.parametrize(
    "robot",
    [
        WHOLE,
        LumpedParameters(
            p1=0.003,
            p2=1e-3,
            p3=0.05,
            p4=0.4,
            coulomb=2e-3,
            stribeck=1e-3,
            bristle_stiffness=2.0,
            bristle_damping=5e-3,
            compression=0.5,
        ),
    ],
    ids=["lag, compression, cogging", "bristles"],
)
def test_the_nonlinear_system_is_the_whole_equation(robot):
    time = np.linspace(0, 4, 4001)
    drive = 0.3 * np.sin(4 * time)
    delivered = drive / (1 + robot.compression * np.abs(drive))
    middles = 0.3 * np.sin(4 * (time[1:] + time[:-1]) / 2)
    middles = middles / (1 + robot.compression * np.abs(middles))
    inputs = np.column_stack([delivered[:-1], middles, delivered[1:]])
    system = nonlinear_system(robot)
    moved = control.input_output_response(
        system,
        time,
        drive,
        np.eye(1, system.nstates)[0] * 0.3,
        solve_ivp_method="LSODA",
        solve_ivp_kwargs={"rtol": 1e-8, "atol": 1e-10, "max_step": 5e-3},
    )
    angle, _ = simulate(robot, time, inputs, 0.3)
    assert np.ptp(angle) > 0.5
    np.testing.assert_allclose(moved.outputs[0], angle, atol=2e-4)


def test_the_response_is_that_of_the_small_motion_about_rest():
    """By hand, with offset and cogging, delay, and back EMF behind the armature's lag."""
    p = replace(WHOLE, p2=2e-3, back_emf=1.5e-3, time_constant=0.08, delay=0.03)
    omega = np.array([0.7, 3.0, 9.0])
    lag = 1 / (1 + 1j * omega * 0.08)
    spring = p.p3 - p.cogging * 3
    below = spring - p.p1 * omega**2 + 1j * omega * (p.p2 - 1.5e-3 + 1.5e-3 * lag)
    expected = p.p4 * np.exp(-0.03j * omega) * lag / below
    linear = Linearisation.of(p)
    np.testing.assert_allclose(linear.response(omega), expected, rtol=1e-12)
    fine = np.linspace(0.5, 10, 200_001)
    peak = fine[np.argmax(np.abs(linear.response(fine)))]
    assert linear.resonance == pytest.approx(peak, abs=1e-4)
