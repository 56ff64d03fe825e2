"""Commands that a campaign plays, as functions of the readings alone."""

import math

import numpy as np
import pytest

from butterfly.campaigns.bench import LAG, RESERVE, STILL, Brake, LetGo, Push, Relay, Signal
from butterfly.plant.motor import Reading


def answers(law, times, angles):
    """Return the command for each reading, None where the run ends."""
    readings = zip(times, np.broadcast_to(angles, np.shape(times)), strict=True)
    return [law(Reading(time, angle, math.nan)) for time, angle in readings]


def test_a_push_grows_by_a_quarter_every_tenth_of_a_second_to_its_largest_command():
    times = np.arange(8) * 0.1 + 0.05
    commands = answers(Push(0.0, 0.01, -0.1, 0.3), times, 0.0)
    grown = [-0.1 * 1.25**k for k in range(5)]
    assert commands == [*map(pytest.approx, grown), pytest.approx(-0.3), None, None]


def test_a_push_ends_where_the_joint_has_moved_and_knows_in_what_time():
    push, times = Push(0.5, 0.01, 0.1, 0.3), np.arange(0, 0.1, 0.001)
    commands = answers(push, times, 0.5 + 0.2 * times)
    assert times[commands.index(None)] == pytest.approx(0.01 / 0.2, abs=0.0011)
    assert push.moved == pytest.approx(0.2 * times[-1])
    assert push.took == pytest.approx(times[-1] - 0.0025 / 0.2, abs=0.002)


def test_a_relay_pushes_with_a_swing_and_then_brakes_it_where_it_exceeds_its_reach():
    times = np.arange(STILL, STILL + 10, 0.002)
    swing = 3 * (times - STILL)
    within = answers(Relay(0.0, 1.0, 0.1, 0.1, 10.0), times, 0.4 * np.sin(swing))
    beyond = answers(Relay(0.0, 1.0, 0.1, 0.1, 10.0), times, 1.6 * np.sin(swing))
    late = times > STILL + 3
    assert np.mean((within * np.cos(swing))[late]) > 0  # works with the velocity
    assert np.mean((beyond * np.cos(swing))[late]) < 0  # against it
    assert np.abs(within).max() == pytest.approx(0.1)


def test_a_brake_is_a_spring_and_a_damper_within_its_command():
    times, speed = np.arange(0, 1, 0.001), 0.2
    angles = 0.1 + speed * times
    commands = np.array(answers(Brake(0.1, 0.5, 1.0, 2.0), times, angles))
    settled = times > 10 * LAG
    wanted = -0.5 * ((angles - 0.1) / 2.0 + speed / 1.0)
    assert commands[settled] == pytest.approx(wanted[settled], rel=0.02)
    assert answers(Brake(0.0, 0.5, 1.0, 0.2), [0.0], 3.0) == [-0.5]


def test_a_signal_waits_for_the_rest_to_end():
    law = Signal(lambda time: 1 + time)
    assert answers(law, [0.0, STILL - 1e-6, STILL, STILL + 2], 0.0) == [0, 0, 1, 3]


def test_a_joint_that_is_let_go_is_free_until_it_has_moved():
    assert answers(LetGo(0.1), [0.0, 1.0, 2.0], np.array([0.3, 0.39, 0.41])) == [0, 0, None]


def test_a_relay_is_silent_at_rest_and_when_its_time_is_over():
    relay, times = Relay(0.0, 1.0, 0.1, RESERVE, 2.0), np.arange(0, 4, 0.002)
    commands = np.array(answers(relay, times, 0.0))
    assert not commands[times < STILL].any()
    assert not commands[times > STILL + 2.1].any()
