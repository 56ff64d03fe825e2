"""One joint of a robot moved while the others are held, beside an integrator of its own."""

import mujoco
import numpy as np
import pytest

from butterfly.files import shipped
from butterfly.logs.model_facts import LinkMasses
from butterfly.twin.joint_of_model import JointOfModel
from butterfly.twin.written_back import JointAlone
from tests.independent.integrator import Joint, motion

MODELS = {name: shipped(f"models/{name}/{name}.xml") for name in ("arm", "leg", "linkage")}
SECONDS, PERIOD, STEP = 2.0, 4e-3, 5e-4  # s
FRICTION, DAMPING = 0.11, 0.07
_STIFF = (-1.0, -2.0 / (0.12 * STEP))


def _robot(name, joint):
    """A robot whose joint has friction that is as stiff as the step allows."""
    robot = JointOfModel.of(MODELS[name], joint)
    model, dof = robot.model, int(robot.model.jnt_dofadr[robot.joint])
    model.opt.timestep = STEP
    model.dof_damping[dof], model.dof_frictionloss[dof] = DAMPING, FRICTION
    model.dof_solref[dof] = _STIFF
    return robot


def _commands():
    time = np.arange(0.0, SECONDS, PERIOD)
    torque = 0.7 * np.sin(6.0 * time) + 0.5 * np.sin(17.0 * time)
    return time, np.where(
        time < 1.2, torque, 0.05
    )  # at last it sticks, or creeps to where it hangs


def _by_hand(robot, pose, time, torques, angle):
    facts, model = robot.pose_facts(pose), robot.model
    dof = int(model.jnt_dofadr[robot.joint])
    rotors = robot.facts([robot.pose_facts(pose)], LinkMasses()).rotors
    joint = Joint(
        inertia=facts.inertia + float(model.dof_armature[dof]) + rotors,
        viscous=DAMPING,
        gravity=facts.moment,
        gain=1.0,
        coulomb=FRICTION,
    )
    return facts.zero + motion(joint, time, torques, angle - facts.zero)[0]


@pytest.mark.parametrize(
    ("name", "joint", "pose"),
    [
        ("arm", "pan", {"shoulder": 0.8, "elbow": -1.0}),
        ("arm", "elbow", {"shoulder": 0.4, "wrist": -0.7, "roll": 2.0}),
        ("arm", "wrist", {"shoulder": -0.9, "elbow": 1.1}),
        ("leg", "hip", {"abduction": 0.5, "knee": -1.9}),
        ("leg", "knee", {"abduction": -0.4, "hip": 0.8}),
        ("linkage", "turn", {"tip": 1.0}),
    ],
)
def test_it_moves_as_its_equation_integrated_between_stick_and_slip_says(name, joint, pose):
    robot, (time, torques) = _robot(name, joint), _commands()
    start = robot.pose_facts(pose).zero + 0.2
    by_hand = _by_hand(robot, pose, time, torques, start)
    every = round(PERIOD / STEP)
    moved = JointAlone(robot, pose).moved(np.repeat(torques, every), start, 0.0)
    assert np.ptp(by_hand) > 0.1
    assert np.max(np.abs(moved[::every][: time.size] - by_hand)) < 1e-3 * np.ptp(by_hand)


def test_the_others_do_not_move():
    robot = _robot("arm", "elbow")
    alone = JointAlone(robot, {"shoulder": 0.4, "wrist": -0.7})
    time, torques = _commands()
    alone.moved(np.repeat(torques, 8), 1.0, 0.0)
    again = JointAlone(_robot("arm", "elbow"), {"shoulder": 0.4, "wrist": -0.7})
    first = alone.moved(np.repeat(torques, 8), 1.0, 0.0)
    assert np.max(np.abs(first - again.moved(np.repeat(torques, 8), 1.0, 0.0))) < 1e-8
    assert time.size * 8 + 1 == first.size


def test_a_velocity_at_the_start_is_the_joints():
    robot = _robot("arm", "elbow")
    moved = JointAlone(robot, {}).moved(np.zeros(2), 0.3, 1.5)
    assert moved[0] == 0.3
    assert (moved[1] - moved[0]) / STEP == pytest.approx(1.5, rel=0.03)


def test_its_actuator_drives_it_by_ctrl():
    """A motor of gear 100 makes of ctrl .004 a torque of .4 N m."""
    ctrl = np.full(400, 0.004)
    by_ctrl = JointAlone(_robot("arm", "elbow"), {}, "elbow").moved(ctrl, 0.5, 0.0)
    by_torque = JointAlone(_robot("arm", "elbow"), {}).moved(100.0 * ctrl, 0.5, 0.0)
    assert np.max(np.abs(by_ctrl - by_torque)) < 1e-12
    assert np.ptp(by_ctrl) > 0.01


def test_a_limit_of_the_joint_and_an_equality_of_others_do_not_act():
    robot = _robot("linkage", "tip")
    high = float(robot.model.jnt_range[robot.joint, 1])
    alone = JointAlone(robot, {"lift": 0.3})
    assert alone.step == STEP
    moved = alone.moved(np.full(1500, 0.6), high - 0.1, 0.0)
    assert moved[-1] > high + 0.2
    assert robot.model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_EQUALITY)
