"""Each friction term in MuJoCo and in the grey box, against independent integrators."""

import math
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from butterfly.errors import InputError
from butterfly.model.parameters import AddedMass, Friction, Hand, TorqueDrive, VoltageDrive
from butterfly.plant.joints import GreyBoxJoint, MujocoJoint
from butterfly.plant.mjcf import mjcf
from butterfly.plant.motor import ControlLoop
from butterfly.plant.rig import SimulatedMotor
from butterfly.plant.robot import Clutch, Robot
from butterfly.plant.sensors import Clock, Encoder

ADDED = AddedMass(mass=0.05, arm=0.104)
HAND = Hand(mass=0.1, com_distance=0.05, com_offset=0.01, inertia=0.003, tilt=0.1)
DRIVE = VoltageDrive(resistance=2, torque_constant=0.05, back_emf_constant=0.03)
SMOOTH = Friction(
    viscous=2e-4, drag=1e-4, bias=-2e-3, cogging=3e-3, cogging_cosine=1e-3, cogging_periods=7
)
STRIBECK = Friction(coulomb=4e-3, stribeck=3e-3, stribeck_velocity=0.3, viscous=1e-4)
LUGRE = replace(STRIBECK, bristle_stiffness=5.0, bristle_damping=0.01, load=1e-3)
JOINTS = [MujocoJoint, GreyBoxJoint]


def _robot(friction, hand=HAND, drive=DRIVE):
    return Robot(hand=hand, drive=drive, friction=friction)


def _run(joint, duration=10.0, amplitude=0.5, step=0.01):
    motor = SimulatedMotor(joint, encoder=Encoder(steps=2**45))
    with ControlLoop(motor, clock=Clock(step=step)) as loop:
        return loop.play(lambda time: amplitude * np.sin(4 * time), duration)


def _reference(log, rhs, start):
    """Angle at the log's stamps, each held voltage integrated on its own to 1e-12."""
    state, angles = np.array(start), [start[0]]
    for begin, end, voltage in zip(log.time, log.time[1:], log.input, strict=False):
        piece = solve_ivp(
            rhs, (begin, end), state, "DOP853", args=(voltage,), rtol=1e-12, atol=1e-14
        )
        state = piece.y[:, -1]
        angles.append(state[0])
    return np.array(angles)


def _pull(x):
    """Gravity of hand and added mass on the tilted axis, from their places."""
    weight = 9.81 * math.cos(HAND.tilt)
    hand = 0.1 * weight * (0.05 * math.sin(x) + 0.01 * math.cos(x))
    return -hand - ADDED.mass * ADDED.arm * weight * math.sin(x)


INERTIA = 0.003 + 0.1 * (0.05**2 + 0.01**2) + 0.05 * 0.104**2


@pytest.mark.parametrize("joint", JOINTS)
def test_drag_bias_cogging_offset_and_tilt_are_right_to_1e_9(joint):
    def rhs(_, state, voltage):
        x, v = state
        motor = 0.05 / 2 * (voltage - 0.03 * v)
        ripple = 3e-3 * math.sin(7 * x) + 1e-3 * math.cos(7 * x)
        brake = 2e-4 * v + 1e-4 * abs(v) * v
        return [v, (motor + _pull(x) - 2e-3 + ripple - brake) / INERTIA]

    log = _run(joint(_robot(SMOOTH), ADDED, angle=0.3))
    np.testing.assert_allclose(log.angle, _reference(log, rhs, [0.3, 0.0]), atol=1e-9)
    assert np.ptp(log.angle) > 0.5


@pytest.mark.parametrize(("joint", "error"), [(GreyBoxJoint, 1e-6), (MujocoJoint, 1e-3)])
def test_bristles_equal_an_independent_integrator(joint, error):
    """MuJoCo integrates its bristles with first order."""

    robot = _robot(LUGRE)
    coulomb = 4e-3 + 1e-3 * 0.05 * 9.81

    def rhs(_, state, voltage):
        x, v, z = state
        level = coulomb + 3e-3 * math.exp(-((v / 0.3) ** 2))
        slip = v - 5.0 * abs(v) / level * z
        torque = 0.05 / 2 * (voltage - 0.03 * v) - 5.0 * z - 0.01 * slip - 1e-4 * v
        return [v, (torque + _pull(x)) / INERTIA, slip]

    log = _run(joint(robot, ADDED, angle=0.2), duration=5.0)
    np.testing.assert_allclose(log.angle, _reference(log, rhs, [0.2, 0.0, 0.0]), atol=error)
    assert np.ptp(log.angle) > 0.2


@pytest.mark.parametrize("joint", JOINTS)
def test_far_below_breakaway_bristles_bend_like_a_spring(joint):
    hand = Hand(mass=0.1, com_distance=0.0, inertia=0.003)
    bent = joint(_robot(LUGRE, hand, TorqueDrive(gain=1.0)))
    for _ in range(200):
        bent.advance(1e-6, 0.05)
    assert bent.angle == pytest.approx(1e-6 / 5.0, rel=0.01)


@pytest.mark.parametrize("joint", JOINTS)
@pytest.mark.parametrize(("torque", "moves"), [(6.9e-3, False), (7.1e-3, True)])
def test_the_joint_breaks_loose_beyond_coulomb_and_stribeck_torque(joint, torque, moves):
    hand = Hand(mass=0.1, com_distance=0.0, inertia=0.003)
    pushed = joint(_robot(STRIBECK, hand, TorqueDrive(gain=1.0)))
    pushed.advance(torque, 3.0)
    assert (pushed.angle > 0.4) == moves


def _stribeck_reference(log, robot):
    """Sliding, integrated to each reversal; the drive is so strong that the joint never sticks."""
    p = robot.lumped.with_added_mass(ADDED)

    def rhs(_, state, voltage, sign):
        x, v = state
        level = p.coulomb + p.stribeck * math.exp(-((v / p.stribeck_velocity) ** 2))
        torque = p.p4 * voltage - p.p2 * v + _pull(x) - sign * level
        return [v, torque / p.p1]

    def reversal(_, state, *_args):
        return state[1]

    reversal.terminal = True
    state, angles, sign = np.array([0.0, 0.0]), [0.0], -1.0
    for begin, end, voltage in zip(log.time, log.time[1:], log.input, strict=False):
        now = begin
        while now < end:
            reversal.direction = -sign
            options = {"rtol": 1e-12, "atol": 1e-14, "events": reversal, "max_step": 5e-3}
            piece = solve_ivp(rhs, (now, end), state, "DOP853", args=(voltage, sign), **options)
            now, state = piece.t[-1], piece.y[:, -1]
            if piece.status == 1:
                sign = -sign
                state[1] = 1e-15 * sign
        angles.append(state[0])
    return np.array(angles)


@pytest.mark.parametrize(("joint", "error"), [(GreyBoxJoint, 1e-7), (MujocoJoint, 2e-3)])
def test_stribeck_friction_equals_an_integrator_that_stops_at_each_reversal(joint, error):
    friction = Friction(coulomb=5e-4, stribeck=5e-4, stribeck_velocity=0.3)
    robot = _robot(friction)
    log = _run(joint(robot, ADDED), duration=5.0, amplitude=0.6)
    np.testing.assert_allclose(log.angle, _stribeck_reference(log, robot), atol=error)


def test_the_added_weight_raises_coulomb_friction():
    friction = Friction(coulomb=1e-3, load=2e-3)
    loaded = _robot(friction).lumped.with_added_mass(ADDED)
    assert loaded.coulomb == pytest.approx(1e-3 + 2e-3 * 0.05 * 9.81)
    heavy, light = (
        _run(MujocoJoint(_robot(f), ADDED, angle=0.6), amplitude=0.0).angle
        for f in (friction, replace(friction, coulomb=loaded.coulomb, load=0.0))
    )
    np.testing.assert_array_equal(heavy, light)


@pytest.mark.parametrize("joint", JOINTS)
def test_a_weight_cannot_relieve_the_bearing_of_more_friction_than_there_is(joint):
    robot = _robot(Friction(coulomb=1e-3, load=-5e-3))
    with pytest.raises(InputError, match="load"):
        joint(robot, ADDED)
    joint(robot, AddedMass(mass=0.01, arm=0.1))
    bends = _robot(replace(LUGRE, coulomb=4.905e-4, load=-1e-3))
    assert bends.lumped.with_added_mass(ADDED).coulomb == 0
    with pytest.raises(InputError, match="load"):
        joint(bends, ADDED)


@pytest.mark.parametrize("friction", [SMOOTH, LUGRE, replace(SMOOTH, coulomb=1e-3)])
@pytest.mark.parametrize("drive", [DRIVE, TorqueDrive(gain=0.02)])
def test_every_term_is_in_the_exported_model(friction, drive):
    robot = _robot(friction, drive=drive)
    model = mujoco.MjModel.from_xml_string(mjcf(robot, ADDED, scene=True))
    data = mujoco.MjData(model)
    data.qpos[0] = 0.4
    joint = MujocoJoint(robot, ADDED, angle=0.4)
    joint.reset()
    # Slowly enough for the bristles to need no shorter steps than the model's.
    for k in range(1000):
        command = 0.1 * math.sin(4e-3 * k)
        data.ctrl[0] = command
        mujoco.mj_step(model, data)
        joint.advance(command, 1e-3)
    tolerance = 1e-12 if friction.bristle_stiffness == 0 else 1e-5
    assert data.qpos[0] == pytest.approx(joint.angle, abs=tolerance)


def test_a_model_that_mujoco_cannot_hold_is_not_exported():
    with pytest.raises(InputError, match="bristle_stiffness"):
        mjcf(_robot(STRIBECK))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("drag", -1.0),
        ("bias", math.nan),
        ("stribeck_velocity", 0.0),
        ("cogging_periods", 2.5),
        ("cogging_cosine", math.inf),
        ("bristle_stiffness", 5.0),
    ],
)
def test_an_impossible_term_is_refused_by_name(field, value):
    with pytest.raises(InputError, match=r"Friction: \w+: got"):
        Friction(**{field: value})


def test_a_clutch_lets_the_hand_lag_behind_its_shaft_by_the_play_at_most():
    hand = Hand(mass=0.1, com_distance=0.05, inertia=0.003)
    robot = replace(
        _robot(Friction(viscous=1e-3), hand, TorqueDrive(gain=1.0)),
        clutch=Clutch(backlash=0.1, rotor_inertia=1e-3),
    )
    with pytest.raises(InputError, match="clutch"):
        GreyBoxJoint(robot)
    joint = MujocoJoint(robot)
    joint.advance(0.01, 0.02)
    alone = (0.01 * 0.02**2 / 2) / 1e-3  # the shaft turns without the hand, inside the play
    assert joint.angle == pytest.approx(alone, rel=0.02)
    rigid = GreyBoxJoint(replace(robot, clutch=None))
    tight = MujocoJoint(replace(robot, clutch=Clutch(backlash=1e-4, rotor_inertia=1e-3)))
    for _ in range(200):
        for each in (joint, tight, rigid):
            each.advance(0.01, 0.01)
    assert tight.angle == pytest.approx(rigid.angle, abs=2e-3)
