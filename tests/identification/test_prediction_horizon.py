"""For how long a simulation stays near: upright, hanging, or where nothing brings it back."""

import math
from dataclasses import replace

import numpy as np
import pytest

from butterfly.identification.data import DataSet
from butterfly.identification.estimators import Suitable
from butterfly.identification.segments import GROWTH, horizon_of
from butterfly.logs.log import InputKind, Intersample, Log
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass, JointKind, LumpedParameters
from butterfly.model.prior import Prior
from tests.independent.integrator import Joint, motion

TIME = np.arange(0, 20, 0.005)
ROBOT = LumpedParameters(p1=0.19, p2=0.0, p3=3.7, p4=1.0)
ZEROS = {NO_ADDED_MASS: 0.1}
STEP, SUB = 1e-3, 10
MASS, DAMPING, FRICTION, GAIN = 95.0, 200.0, 20.0, 35.0
SLIDE = AddedMass(joint=JointKind.SLIDE)


def _horizon(*angles, robot=ROBOT):
    logs = [Log(TIME, np.sin(TIME), 0.1 + each, input_kind="torque") for each in angles]
    return horizon_of(logs, robot, ZEROS)


def test_a_balance_at_the_upright_has_a_short_horizon():
    """There an error grows as cosh(t sqrt(p3/p1)); the horizon is rounded down to two digits."""
    exact = math.acosh(GROWTH) / math.sqrt(3.7 / 0.19)
    assert 0.8 * exact < _horizon(math.pi + 0.02 * np.sin(5 * TIME)) <= exact


def test_a_hand_that_hangs_or_turns_without_gravity_has_none_but_one_log_tells_for_all():
    assert _horizon(1.5 * np.sin(4 * TIME)) == math.inf
    assert _horizon(2.0 * TIME, robot=replace(ROBOT, p3=0.0)) == math.inf
    assert _horizon(0.3 * np.sin(4 * TIME), math.pi + 0.01 * np.sin(TIME)) < 1.1


@pytest.mark.parametrize("height", [1.8, 2.4])
def test_swings_that_decay_from_beyond_the_horizontal_have_none(height):
    joint = Joint(inertia=0.19, viscous=0.05, gravity=3.7, gain=1.0)
    angle, _ = motion(joint, TIME, np.zeros(TIME.size), height)
    assert _horizon(angle, robot=replace(ROBOT, p2=0.05)) == math.inf


def _program(count):
    """Positions in m of a table that goes to and fro in trapezoids of velocity."""
    time = np.arange(count) * STEP
    pace = np.clip(3 * np.sin(2 * np.pi * time / 3.1), -1, 1) * (0.08 + 0.03 * np.sin(0.9 * time))
    return np.cumsum(pace) * STEP


def _followed(ripple, noise, seconds=20.0):
    """Record a slide that follows a program by a cascade, friction changing along its way.

    Semi-implicit Euler of steps of 0.1 ms, friction taking no more than all of the velocity.
    """
    rng = np.random.default_rng(1)
    wanted = _program(int(seconds / STEP))
    x, v, before = 0.0, 0.0, 0.0
    commands, positions = np.empty(wanted.size), np.empty(wanted.size)
    for k in range(wanted.size):
        speed, before = (x - before) / STEP, x
        commands[k] = np.clip(240 * (150 * (wanted[k] - x) - speed), -10, 10)
        positions[k] = x + noise * rng.standard_normal()
        uneven = ripple * np.sin(2 * np.pi * x / 0.017 + 0.4)
        for _ in range(SUB):
            free = v + STEP / SUB * (GAIN * commands[k] - DAMPING * v) / MASS
            held = STEP / SUB * (FRICTION + uneven) / MASS
            v = np.sign(free) * max(abs(free) - held, 0.0)
            x += STEP / SUB * v
    return Log(
        time=np.arange(wanted.size) * STEP,
        input=commands,
        angle=positions,
        input_kind=InputKind.VOLTAGE,
        intersample=Intersample.ZERO_ORDER_HOLD,
        added_mass=SLIDE,
        source="slide",
    )


def _data(log):
    return DataSet.of([log], known=Prior.of({"p4": GAIN}))


def _covers(found, names=("p1", "p2", "coulomb", "delay")):
    truth = {"p1": MASS, "p2": DAMPING, "coulomb": FRICTION, "delay": 0.0}
    rows = zip(found.names, found.lower, found.upper, strict=True)
    return all(lower <= truth[name] <= upper for name, lower, upper in rows if name in names)


@pytest.mark.parametrize("ripple", [4.0, 0.0])
def test_friction_that_changes_along_the_way_is_not_taken_for_mass_or_delay(ripple):
    found = Suitable()(_data(_followed(ripple=ripple, noise=2e-5)))
    assert found.method == "output error"
    assert found.horizon is None
    assert _covers(found)
