"""Steps that end where the velocity vanishes, against closed forms."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from butterfly.model.greybox import simulate
from butterfly.model.parameters import LumpedParameters
from tests.model.joints import instants


@settings(max_examples=40)
@given(coulomb=st.floats(0.01, 1.0), speed=st.floats(0.1, 5.0), step=st.floats(0.001, 0.05))
def test_a_free_slide_stops_where_the_closed_form_says_and_stays(coulomb, speed, step):
    parameters = LumpedParameters(p1=0.1, p2=0, p3=0, p4=1, coulomb=coulomb)
    stop = speed * parameters.p1 / coulomb
    time = np.linspace(0, 1.5 * stop, max(int(1.5 * stop / step), 3))
    angle, velocity = simulate(parameters, time, np.zeros((time.size - 1, 3)), 0.0, speed)
    distance = 0.5 * speed * stop
    assert angle[-1] == pytest.approx(distance, rel=1e-9)
    assert velocity[-1] == 0.0
    assert not velocity[time > stop * (1 + 1e-9)].any()


def test_a_coulomb_oscillation_loses_the_same_swing_in_each_half_cycle_until_it_sticks():
    scale = 1e-4  # small enough for sin th = th
    parameters = LumpedParameters(p1=0.01, p2=0, p3=1.0, p4=1, coulomb=0.1 * scale)
    time = np.arange(0, 8, 2e-3)
    angle, velocity = simulate(parameters, time, np.zeros((time.size - 1, 3)), 1.05 * scale)
    half = math.pi * math.sqrt(parameters.p1 / parameters.p3)
    peaks = np.interp(half * np.arange(5), time, angle) / scale
    np.testing.assert_allclose(peaks, [1.05, -0.85, 0.65, -0.45, 0.25], atol=2e-4)
    assert velocity[-1] == 0.0
    assert angle[-1] / scale == pytest.approx(-0.05, abs=1e-6)


@pytest.mark.parametrize("coulomb", [0.2, 0.0])
@pytest.mark.parametrize("step", [0.3, 0.13, 0.017])
def test_a_joint_breaks_loose_at_the_instant_at_which_the_drive_exceeds_friction(coulomb, step):
    """A ramp from rest: x = k (t - t0)^3 / 6 p1 from t0 = T_c/k on, whatever the steps."""
    parameters = LumpedParameters(p1=0.1, p2=0, p3=0, p4=1, coulomb=coulomb)
    time = np.arange(0, 2, step)
    angle, velocity = simulate(parameters, time, 0.37 * instants(time), 0.0)
    free = np.maximum(time - coulomb / 0.37, 0.0)
    np.testing.assert_allclose(angle, 0.37 * free**3 / 0.6, atol=1e-12)
    assert not velocity[free == 0].any()


@pytest.mark.parametrize("first", [-1.5, -1.05, -1.0, -0.95])
def test_a_joint_that_is_pushed_one_way_and_then_the_other_within_a_step_follows(first):
    """A parabola that stands for a step of the input overshoots before it."""
    joint = LumpedParameters(p1=0.1, p2=0.0, p3=0.0, p4=1.0, coulomb=0.2)
    drive = np.polynomial.Polynomial.fit([0.0, 0.5, 1.0], [first * 0.2, 3.0, 20.0], 2)
    whole, fine = np.array([0.0, 0.01]), np.linspace(0.0, 0.01, 1001)
    found, exact = (
        simulate(joint, time, drive(instants(time) / 0.01), 0.0) for time in (whole, fine)
    )
    assert exact[1][-1] > 0.5
    assert found[1][-1] == pytest.approx(exact[1][-1], rel=1e-6)
    assert found[0][-1] == pytest.approx(exact[0][-1], rel=1e-6)


@pytest.mark.parametrize("beside", [-1e-15, -1e-9, -1e-5])
def test_a_velocity_that_hardly_falls_below_0_within_a_step_does_so_where_it_should(beside):
    """It is (1 - t)^2 + beside; the friction is too small to hold the joint or to be seen."""
    parameters = LumpedParameters(p1=1.0, p2=0, p3=0, p4=1, coulomb=1e-13)
    time = np.linspace(0, 2, 11)
    inputs = 2.0 * (instants(time) - 1.0)
    angle, velocity = simulate(parameters, time, inputs, 0.0, 1.0 + beside)
    near = 1e-12 + 3 * abs(beside)
    np.testing.assert_allclose(angle, (1 - (1 - time) ** 3) / 3 + beside * time, atol=near)
    np.testing.assert_allclose(velocity, (1 - time) ** 2 + beside, atol=near)


def test_friction_that_holds_nothing_at_rest_brakes_what_slides():
    friction = {"coulomb": 0.2, "stribeck": -0.2, "stribeck_velocity": 1e-3}
    parameters = LumpedParameters(p1=0.1, p2=0, p3=0, p4=1, **friction)
    time = np.arange(0, 1, 0.01)
    angle, _ = simulate(parameters, time, np.zeros((time.size - 1, 3)), 0.0, 3.0)
    np.testing.assert_allclose(angle, 3 * time - time**2, atol=1e-12)
