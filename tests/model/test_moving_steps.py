"""Steps on a base that hardly gives, and with dry friction."""

from dataclasses import replace

import numpy as np
import pytest

from butterfly.plant.joints import GreyBoxJoint, MujocoJoint
from butterfly.plant.robot import Robot
from tests.model.bases import ADDED, BASE, JOINT, drive, simulated
from tests.plant.setting import mjcf


def test_a_base_that_hardly_gives_is_one_that_stands_still():
    joint = replace(JOINT, coulomb=0.02, stribeck=3e-3, base_compliance=0.0)
    still = simulated(joint)[0]
    for compliance in (1e-9, 1e-7):
        giving = simulated(replace(joint, base_compliance=compliance))[0]
        assert np.abs(giving - still).max() < 20 * compliance


@pytest.mark.parametrize("dry", [0.0, 2e-3, 2e-2])
def test_mujoco_moves_alike(dry):
    """Its dry friction is up to a step late."""
    robot = Robot.of_lumped(replace(JOINT, coulomb=dry))
    assert robot.base == BASE
    errors = []
    for step in (1e-3, 2e-4):
        commands = drive(np.arange(0.0, 1.5, step))
        joints = [kind(robot, ADDED, angle=0.1) for kind in (MujocoJoint, GreyBoxJoint)]
        joints[0].reset()
        ours, other = (each.follow(commands, np.full(commands.size, step)) for each in joints)
        errors.append(np.abs(ours - other).max())
    assert errors[0] < (1e-9 if not dry else 1e-3)
    assert errors[1] < 1e-9 or errors[1] < 0.3 * errors[0]
    assert 'name="base"' in mjcf(robot, ADDED)
