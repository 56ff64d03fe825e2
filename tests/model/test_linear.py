"""Linear models, against the nonlinear equation and closed forms."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize_scalar

from butterfly.errors import InputError
from butterfly.model import control_bridge as bridge
from butterfly.model import linear
from butterfly.model.greybox import simulate
from tests.model.joints import PENDULUM, WHOLE, instants, robots
from tests.signals.sines import fit_sine

THESIS = replace(PENDULUM, p4=10)
OMEGA = np.array([0.5, 3.0, 4.5, 9.0, 40.0])


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
