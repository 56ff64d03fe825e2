"""For how long a simulation stays near: not long about the upright, for ever where a hand hangs."""

import math
from dataclasses import replace

import numpy as np
import pytest

from butterfly.identification.prediction_horizon import GROWTH, horizon_of
from butterfly.logs.log import Log
from butterfly.model.parameters import NO_ADDED_MASS, LumpedParameters
from tests.independent.integrator import Joint, motion

TIME = np.arange(0, 20, 0.005)
ROBOT = LumpedParameters(p1=0.19, p2=0.0, p3=3.7, p4=1.0)
ZEROS = {NO_ADDED_MASS: 0.1}


def _horizon(angle, robot=ROBOT):
    log = Log(TIME, np.sin(TIME), 0.1 + angle, input_kind="torque")
    return horizon_of([log], robot, ZEROS)


def test_a_balance_at_the_upright_has_a_short_horizon():
    """There an error grows as cosh(t sqrt(p3/p1)); the horizon is rounded down to two digits."""
    exact = math.acosh(GROWTH) / math.sqrt(3.7 / 0.19)
    assert 0.8 * exact < _horizon(math.pi + 0.02 * np.sin(5 * TIME)) <= exact


def test_a_hand_that_hangs_or_turns_without_gravity_has_none():
    assert _horizon(1.5 * np.sin(4 * TIME)) == math.inf
    assert _horizon(2.0 * TIME, LumpedParameters(p1=0.19, p2=0.0, p3=0.0, p4=1.0)) == math.inf


@pytest.mark.parametrize("height", [1.8, 2.4])
def test_swings_that_decay_from_beyond_the_horizontal_have_none(height):
    joint = Joint(inertia=0.19, viscous=0.05, gravity=3.7, gain=1.0)
    angle, _ = motion(joint, TIME, np.zeros(TIME.size), height)
    assert _horizon(angle, replace(ROBOT, p2=0.05)) == math.inf


def test_one_log_that_diverges_tells_for_all():
    calm = Log(TIME, np.sin(TIME), 0.1 + 0.3 * np.sin(4 * TIME), input_kind="torque")
    wild = Log(TIME, np.sin(TIME), 0.1 + math.pi + 0.01 * np.sin(TIME), input_kind="torque")
    assert horizon_of([calm], ROBOT, ZEROS) == math.inf
    assert horizon_of([calm, wild], ROBOT, ZEROS) < 1.1
