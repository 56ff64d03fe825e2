"""The velocity that an observer sees, against a simulated truth and closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from butterfly.model.greybox import simulate
from butterfly.model.parameters import LumpedParameters
from butterfly.orbit.controller import Observer

ROBOT = LumpedParameters(p1=0.00325, p2=0.001, p3=0.04905, p4=10.0)
PRESENT = {"p3_offset": 0.1 * 9.81 * 0.003, "bias": -2e-3, "coulomb": 8e-4, "stribeck": 3e-3}
PRESENT |= {"drag": 4e-4, "motor_friction": 0.2, "load_friction": 0.1, "cogging": 3e-3}
PRESENT |= {"spring": 5e-3, "dead_zone": 3e-4, "compression": 400.0}
BESIDE = {"stribeck": {"stribeck_velocity": 1.0}, "cogging": {"cogging_periods": 3.0}}
STEP = 5e-4


def _observed(robot, believed, zero=0.0):
    """Velocity that an observer sees of a driven swing, and the true one."""
    time = np.arange(0, 2, STEP)
    held = 1e-3 * np.sin(3 * time[:-1])
    delivered = robot.delivered(held)
    angle, velocity = simulate(robot, time, np.column_stack([delivered] * 3), 1.0)
    observer = Observer(believed, zero=zero)
    commands = np.concatenate([[0.0], held])
    found = [observer.update(*row) for row in zip(time, angle + zero, commands, strict=True)]
    settled = time > 0.5
    return np.array(found)[settled], velocity[settled]


@pytest.mark.parametrize("name", PRESENT)
def test_an_observer_that_believes_what_is_true_of_a_term_has_no_lag_and_no_bias(name):
    robot = replace(ROBOT, **{name: PRESENT[name]} | BESIDE.get(name, {}))
    right, truth = _observed(robot, robot)
    wrong, _ = _observed(robot, replace(robot, **{name: 0.0}))
    error, missed = (np.sqrt(np.mean((found - truth) ** 2)) for found in (right, wrong))
    assert error < min(0.004 * np.std(truth), 0.5 * missed)
    if name == "p3_offset":
        assert abs(np.mean(right - truth)) < 1e-3
        assert abs(np.mean(wrong - truth)) > 5e-3


def test_the_encoder_s_zero_is_taken_off():
    found, truth = _observed(ROBOT, ROBOT, zero=0.7)
    assert np.abs(found - truth).max() < 0.02


def test_both_poles_of_the_observer_are_at_its_bandwidth():
    """A step of the angle of a joint that nothing acts on: e'' + 2 b e' + b^2 e = 0."""
    free = LumpedParameters(p1=1.0, p2=0.0, p3=0.0, p4=1.0)
    observer, b, step = Observer(free, bandwidth=20.0), 20.0, 1e-4
    observer.update(0.0, 0.0, 0.0)
    times = step * np.arange(1, 4000)
    found = np.array([observer.update(t, 0.1, 0.0) for t in times])
    np.testing.assert_allclose(found, 0.1 * b**2 * times * np.exp(-b * times), atol=0.01)
