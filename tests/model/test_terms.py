"""The table of terms against itself, the compiled kernel and MuJoCo, all rows in one test each."""

from dataclasses import fields, replace

import mujoco
import numpy as np
import pytest

from butterfly.model.greybox import constants_of
from butterfly.model.kernel.equation import friction_at
from butterfly.model.parameters import Friction, Hand, LumpedParameters, TorqueDrive
from butterfly.model.terms import DRIVE, GEAR, LOOP_TERMS, TERMS, DriveTerms
from butterfly.plant.mjcf import compile_model
from butterfly.plant.robot import Robot
from tests.model.rows import ADDED, COMMAND, LOAD, PLAIN, SETTINGS, STATES, STATIC, VALUE, motion_at

STATEFUL = [name for name, row in TERMS.items() if row.state]
SETTING = ["p1", "delay", "slow_delay", "slow_interval", "stribeck_velocity", "cogging_periods"]
SETTING += ["tilt", "mass_inertia", *LOOP_TERMS]


def test_every_parameter_of_the_model_has_a_row_and_every_row_a_parameter():
    of_what_swings = {"gravity", "carried_moment"}  # not parameters: an experiment sets them
    assert {*TERMS, *of_what_swings} == {field.name for field in fields(LumpedParameters)}
    assert sorted(STATIC + STATEFUL + SETTING) == sorted(TERMS)
    for row in TERMS.values():
        assert row.symbol
        assert row.unit
        assert row.meaning


def test_all_but_velocity_frequency_and_periods_may_be_0():
    above = {name for name, row in TERMS.items() if row.lower > 0}
    assert above == {"stribeck_velocity", "base_frequency", "cogging_periods"}


@pytest.mark.parametrize("name", [n for n, row in TERMS.items() if row.potential])
def test_a_potential_has_the_basis_for_slope_and_is_0_at_angle_0(name):
    row, step = TERMS[name], 1e-6
    assert row.potential(0.0, 3.0) == 0
    for angle, velocity in STATES:
        slope = (row.potential(angle + step, 3.0) - row.potential(angle - step, 3.0)) / (2 * step)
        assert row.basis(motion_at(angle, velocity)) == pytest.approx(slope, abs=1e-8)


@pytest.mark.parametrize("name", [n for n in STATIC if n not in {"p4", *DRIVE}])
@pytest.mark.parametrize(("angle", "velocity"), STATES)
def test_mujoco_has_the_torque_of_every_row(name, angle, velocity):
    """Accelerations of a hand with the term, less those of the same hand without it."""
    motion = motion_at(angle, velocity, weight=ADDED.weight, mass=ADDED.mass)
    if name in GEAR:
        motion = replace(PLAIN, **{name: VALUE}, bias=LOAD).motion(angle, velocity, motor=COMMAND)
    expected = -VALUE * float(TERMS[name].basis(motion))
    with_term, without = (
        _mujoco_torque(_robot(each), ADDED, angle, velocity) for each in (name, None)
    )
    if name == "coulomb_slope":
        expected -= (3 * VALUE - 1e-3) * float(motion.direction)
    soft = 2e-3 * VALUE * ADDED.weight if TERMS[name].dry else 1e-9  # frictionloss is a soft one
    assert with_term - without == pytest.approx(expected, abs=soft)


def _robot(name):
    hand = Hand(mass=0.2, com_distance=0.0, inertia=0.004)
    coulomb = 3 * VALUE if name == "coulomb_slope" else 1e-3  # which stays above 0
    friction = dict(SETTINGS, coulomb=coulomb, bias=LOAD)
    if name in {"p3", "p3_offset"}:
        moved = {"p3": "com_distance", "p3_offset": "com_offset"}[name]
        hand = replace(hand, **{moved: VALUE / (0.2 * 9.81)})
        own = 0.2 * getattr(hand, moved) ** 2
        hand = replace(hand, inertia=hand.inertia - own)
    elif name is not None:
        field = "viscous" if name == "p2" else name
        friction[field] = friction.get(field, 0.0) + VALUE
    return Robot(hand=hand, drive=TorqueDrive(gain=1.0), friction=Friction(**friction))


def _mujoco_torque(robot, added, angle, velocity):
    model = compile_model(robot, added)
    data = mujoco.MjData(model)
    data.ctrl[0] = COMMAND
    if robot.friction.sticks_harder:  # the joint sets it for each step
        constants = constants_of(robot.loaded(added))
        model.dof_frictionloss[0] = friction_at(angle, velocity, COMMAND, constants)
    data.qpos[0], data.qvel[0] = angle, velocity
    mujoco.mj_forward(model, data)
    return float(data.qacc[0]) * 0.004


def test_a_drive_loses_its_dead_zone_and_then_saturates():
    both = DriveTerms(dead_zone=0.1, compression=0.5)
    command = np.array([-0.6, -0.05, 0.0, 0.1, 1.1])
    np.testing.assert_allclose(both.delivered(command), [-0.4, 0.0, 0.0, 0.0, 2 / 3], atol=1e-15)
    for name, slope in both.slopes(command).items():
        more = replace(both, **{name: getattr(both, name) + 1e-7}).delivered(command)
        np.testing.assert_allclose(slope, (more - both.delivered(command)) / 1e-7, atol=1e-6)


def test_friction_is_refused_below_the_bounds_of_the_table():
    for name in {field.name for field in fields(Friction)} & {*TERMS}:
        if TERMS[name].lower == 0:
            with pytest.raises(ValueError, match=name):
                Friction(**{"coulomb": 1.0, name: -1e-3})
