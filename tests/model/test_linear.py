"""Linear models, against the nonlinear equation, python-control and closed forms."""

import math
from dataclasses import replace
from functools import partial

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize_scalar

from butterfly.errors import InputError
from butterfly.model import control_bridge as bridge
from butterfly.model import linear
from butterfly.model.greybox import simulate
from butterfly.model.parameters import AddedMass, LumpedParameters
from tests.model.joints import BRISTLES, LAG, PENDULUM, SLIDING, instants, some
from tests.signals.sines import fit_sine

THESIS = replace(PENDULUM, p4=10)
WHOLE = replace(
    SLIDING, delay=0.0, coulomb=0.0, load=0.0, stribeck=0.0, compression=0.3, dead_zone=0.0, **LAG
)
OTHERS = {
    "bristles": replace(SLIDING, delay=0.0, **BRISTLES),
    "friction that creeps at rest": replace(PENDULUM, coulomb=1e-4, drag=1e-4),
    "a gear": replace(PENDULUM, motor_friction=0.1, load_friction=0.05, **LAG),
}
OMEGA = np.array([0.5, 3.0, 4.5, 9.0, 40.0])
ARMS = {"p1": (1e-3, 1e-2), "p2": (3e-4, 5e-3), "p3": (-0.02, 0.2), "p4": (0.01, 10)}
TERMS = {"p3_offset": (-0.02, 0.02), "tilt": (-0.5, 0.5), "delay": (1e-4, 0.1)}
TERMS |= {"back_emf": (0, 3e-4), "time_constant": (1e-4, 0.05), "coulomb": (0, 1e-3)}
TERMS |= {"cogging": (-5e-3, 5e-3), "cogging_cosine": (-5e-3, 5e-3), "load": (0, 1e-3)}
robots = st.builds(
    lambda joint, arm: replace(joint, **arm),
    some(partial(LumpedParameters, p1=1, p2=1, p3=1, p4=1, cogging_periods=7.0), **TERMS),
    st.fixed_dictionaries({name: st.floats(*ends) for name, ends in ARMS.items()}),
)
masses = some(AddedMass, mass=(0, 0.2), arm=(0, 0.15))


def test_the_response_is_that_of_the_small_motion_about_rest():
    """By hand, with offset and cogging, delay, and back EMF behind the armature's lag."""
    p = replace(WHOLE, p2=2e-3, back_emf=1.5e-3, time_constant=0.08, delay=0.03)
    lag = 1 / (1 + 1j * OMEGA * 0.08)
    spring = p.p3 - p.cogging * 3 + p.spring
    below = spring - p.p1 * OMEGA**2 + 1j * OMEGA * (p.p2 - 1.5e-3 + 1.5e-3 * lag)
    undelayed = p.p4 * lag / below
    response = linear.LinearJoint.of(p).response(OMEGA)
    np.testing.assert_allclose(response, undelayed * np.exp(-0.03j * OMEGA), rtol=1e-12)
    np.testing.assert_allclose(bridge.transfer_function(p)(1j * OMEGA), undelayed, rtol=1e-10)


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


@settings(max_examples=20)
@given(robots.map(lambda robot: replace(robot, delay=0.0)))
def test_the_resonance_is_where_the_response_peaks(robot):
    spring = linear.LinearJoint.of(robot).stiffness
    grid = np.linspace(0.01, 3, 3000) * np.sqrt(max(spring, 1e-6) / robot.p1)
    gains = np.abs(linear.LinearJoint.of(robot).response(grid))
    inner = np.flatnonzero((gains[1:-1] > gains[:-2]) & (gains[1:-1] > gains[2:])) + 1
    found = linear.resonance_frequency(robot)
    if found == 0.0:
        assert inner.size == 0
        return
    peak = minimize_scalar(
        lambda w: -abs(complex(linear.LinearJoint.of(robot).response(w))),
        bounds=(found / 1.1, found * 1.1),
        method="bounded",
        options={"xatol": 1e-9},
    )
    assert found == pytest.approx(peak.x, rel=1e-4)


@given(
    delay=st.floats(1e-5, 10),
    order=st.integers(1, linear.HIGHEST_ORDER),
    turn=st.floats(1e-3, 2 * math.pi),
)
def test_a_delay_s_error_is_within_its_bound_no_frequency_is_damped_and_states_decay(
    delay, order, turn
):
    late, factorial = linear.DelayStates.of(delay, order), math.factorial
    resolvent = np.linalg.solve(1j * turn / delay * np.eye(order) - late.a, late.b)
    found = late.c @ resolvent + late.feedthrough
    bound = factorial(order) ** 2 / factorial(2 * order) / factorial(2 * order + 1)
    assert abs(found - np.exp(-1j * turn)) <= bound * turn ** (2 * order + 1) + 1e-12
    assert abs(found) == pytest.approx(1, rel=1e-12)
    assert max(np.linalg.eigvals(late.a * delay).real) < 0


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: bridge.discretised(WHOLE, 0), "step: got 0"),
        (lambda: linear.DelayStates.of(-0.01, 4), "delay"),
        (lambda: linear.DelayStates.of(0.01, 11), "from 1 to 10"),
        (lambda: bridge.linearised(replace(WHOLE, delay=0.01), pade_order=-1), "order: got -1"),
    ],
)
def test_what_makes_no_sense_is_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()


def test_the_quasi_linear_response_tends_to_the_linear_one():
    omega = np.array([1.0, 3.9, 9.0])
    small = linear.quasi_linear_response(THESIS, omega, np.full(3, 1e-5))
    np.testing.assert_allclose(small, linear.LinearJoint.of(THESIS).response(omega), rtol=1e-8)


SWINGING = replace(PENDULUM, p2=0.0014)
SLOWED = {"coulomb": 3e-4, "drag": 5e-4, "stribeck": 3e-4, "stribeck_velocity": 0.5}
MANY = replace(PENDULUM, cogging=2e-3, cogging_periods=3.0, **SLOWED)


@pytest.mark.parametrize(
    ("joint", "error"),
    [(SWINGING, 0.03), (replace(SWINGING, coulomb=5e-4), 0.03), (MANY, 0.02)],
    ids=["plain", "Coulomb", "drag, Stribeck, cogging"],
)
@pytest.mark.parametrize(
    ("omega", "amplitude"), [(2.0, 0.2), (3.5, 0.15), (4.0, 0.3), (6.0, 0.3), (9.0, 0.5)]
)
def test_the_predicted_swing_is_the_simulated_one(joint, error, omega, amplitude):
    time = np.arange(0, 80, 5e-3)
    angle, _ = simulate(joint, time, amplitude * np.sin(omega * instants(time)), 0.0)
    steady = fit_sine(time[time > 60], angle[time > 60], omega)
    assert linear.predicted_swing(joint, omega, amplitude) == pytest.approx(
        steady.amplitude, rel=error
    )


def test_a_drive_that_friction_holds_swings_nothing_and_one_beyond_all_balance_without_bound():
    assert linear.predicted_swing(replace(SWINGING, coulomb=0.01), 3.0, 0.2) == 0.0
    assert linear.predicted_swing(SWINGING, 1.0, 100.0) == np.inf


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
