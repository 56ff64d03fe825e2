"""Each friction term in MuJoCo and in the grey box, against independent integrators."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.optimize import brentq

from butterfly.errors import InputError
from butterfly.model.parameters import AddedMass, Friction, Hand, TorqueDrive
from butterfly.plant.joints import GreyBoxJoint, MujocoJoint
from butterfly.plant.robot import Clutch
from tests.independent.integrator import Joint, motion
from tests.plant.setting import ADDED, JOINTS, MOTOR, integrated, mjcf, mujoco_alone, play, robot

TILTED = Hand(mass=0.1, com_distance=0.05, com_offset=0.01, inertia=0.003, tilt=0.1)
BALANCED = Hand(mass=0.1, com_distance=0.0, inertia=0.003)
UNIT = TorqueDrive(gain=1.0)
SMOOTH = {"drag": 1e-4, "bias": -2e-3, "cogging": 3e-3, "cogging_cosine": 1e-3}
SMOOTH |= {"cogging_periods": 7}
STRIBECK = {"coulomb": 4e-3, "stribeck": 3e-3, "stribeck_velocity": 0.3, "viscous": 1e-4}
LUGRE = STRIBECK | {"bristle_stiffness": 5.0, "bristle_damping": 0.01, "load": 1e-3}
INERTIA = 0.003 + 0.1 * (0.05**2 + 0.01**2) + 0.05 * 0.104**2


def _pull(x):
    """Gravity of hand and added mass on the tilted axis, from their places."""
    weight = 9.81 * math.cos(TILTED.tilt)
    hand = 0.1 * weight * (0.05 * math.sin(x) + 0.01 * math.cos(x))
    return -hand - ADDED.mass * ADDED.arm * weight * math.sin(x)


@pytest.mark.parametrize("joint", JOINTS)
def test_drag_bias_cogging_offset_and_tilt_are_right_to_1e_9(joint):
    def rhs(_, state, voltage):
        x, v = state
        motor = 0.05 / 2 * (voltage - 0.03 * v)
        ripple = 3e-3 * math.sin(7 * x) + 1e-3 * math.cos(7 * x)
        brake = 2e-4 * v + 1e-4 * abs(v) * v
        return [v, (motor + _pull(x) - 2e-3 + ripple - brake) / INERTIA]

    log = play(joint(robot(hand=TILTED, **SMOOTH), ADDED, angle=0.3), 2.0)
    np.testing.assert_allclose(log.angle, integrated(log, rhs, [0.3, 0.0]), atol=1e-9)
    assert np.ptp(log.angle) > 0.5


@pytest.mark.parametrize(("joint", "error"), [(GreyBoxJoint, 1e-6), (MujocoJoint, 1e-3)])
def test_bristles_equal_an_independent_integrator(joint, error):
    """MuJoCo integrates its bristles with first order."""
    coulomb = 4e-3 + 1e-3 * 0.05 * 9.81

    def rhs(_, state, voltage):
        x, v, z = state
        level = coulomb + 3e-3 * math.exp(-((v / 0.3) ** 2))
        slip = v - 5.0 * abs(v) / level * z
        torque = 0.05 / 2 * (voltage - 0.03 * v) - 5.0 * z - 0.01 * slip - 1e-4 * v
        return [v, (torque + _pull(x)) / INERTIA, slip]

    log = play(joint(robot(hand=TILTED, **LUGRE), ADDED, angle=0.2), 1.2)
    np.testing.assert_allclose(log.angle, integrated(log, rhs, [0.2, 0.0, 0.0]), atol=error)
    assert np.ptp(log.angle) > 0.2


@pytest.mark.parametrize("joint", JOINTS)
def test_far_below_breakaway_bristles_bend_like_a_spring(joint):
    bent = joint(robot(UNIT, BALANCED, **LUGRE))
    for _ in range(200):
        bent.advance(1e-6, 0.05)
    assert bent.angle == pytest.approx(1e-6 / 5.0, rel=0.01)


@pytest.mark.parametrize("joint", JOINTS)
@pytest.mark.parametrize(("torque", "moves"), [(6.9e-3, False), (7.1e-3, True)])
def test_the_joint_breaks_loose_beyond_coulomb_and_stribeck_torque(joint, torque, moves):
    pushed = joint(robot(UNIT, BALANCED, **STRIBECK))
    pushed.advance(torque, 3.0)
    assert (pushed.angle > 0.4) == moves


@pytest.mark.parametrize(("joint", "error"), [(GreyBoxJoint, 1e-7), (MujocoJoint, 2e-3)])
def test_stribeck_friction_equals_an_integrator_that_stops_at_each_reversal(joint, error):
    friction = {"coulomb": 5e-4, "stribeck": 5e-4, "stribeck_velocity": 0.3}
    driven = robot(hand=TILTED, **friction)
    log, p = play(joint(driven, ADDED), amplitude=0.6), driven.loaded(ADDED)
    beside = {"gravity_beside": p.p3_offset, "excess": p.stribeck}
    alone = Joint(p.p1, p.p2, p.p3, p.p4, p.coulomb, excess_velocity=0.3, **beside)
    exact, _ = motion(alone, log.time, log.input)
    np.testing.assert_allclose(log.angle, exact, atol=error)


def test_a_fine_joint_is_nearer_to_set_valued_friction_where_it_slides():
    swung, stamps = robot(UNIT, coulomb=1e-3), np.linspace(0, 3, 3001)
    kinds = GreyBoxJoint, MujocoJoint, partial(MujocoJoint, fine=True)
    exact, rough, fine = (
        kind(swung, angle=1.5).angles_under(stamps, np.zeros(stamps.size), stamps) for kind in kinds
    )
    assert np.abs(fine - exact).max() < 0.2 * np.abs(rough - exact).max()


@pytest.mark.parametrize("joint", JOINTS)
def test_a_weight_cannot_relieve_the_bearing_of_more_friction_than_there_is(joint):
    relieved = robot(coulomb=1e-3, load=-5e-3)
    joint(relieved, AddedMass(mass=0.01, arm=0.1))
    bends = robot(**LUGRE | {"coulomb": 4.905e-4, "load": -1e-3})
    assert bends.lumped.with_added_mass(ADDED).coulomb == 0
    for each in (relieved, bends):
        with pytest.raises(InputError, match="load"):
            joint(each, ADDED)


@pytest.mark.parametrize("friction", [SMOOTH, LUGRE, SMOOTH | {"coulomb": 1e-3}])
@pytest.mark.parametrize("drive", [MOTOR, TorqueDrive(gain=0.02)])
def test_every_term_is_in_the_exported_model(friction, drive):
    written = robot(drive, TILTED, **friction)
    joint = MujocoJoint(written, ADDED, angle=0.4)
    joint.reset()
    commands = 0.1 * np.sin(4e-3 * np.arange(1000))  # as slow as bristles allow at steps of 1 ms
    states, _ = mujoco_alone(mjcf(written, ADDED, scene=True), commands, 0.4)
    joint.follow(commands, np.full(commands.size, 1e-3))
    tolerance = 1e-5 if "bristle_stiffness" in friction else 1e-12
    assert states[-1, 0] == pytest.approx(joint.angle, abs=tolerance)


def test_a_model_that_mujoco_cannot_hold_is_not_exported_and_an_impossible_term_refused():
    with pytest.raises(InputError, match="bristle_stiffness"):
        mjcf(robot(**STRIBECK))
    values = {"drag": -1.0, "bias": math.nan, "stribeck_velocity": 0.0, "cogging_periods": 2.5}
    for name, value in (values | {"cogging_cosine": math.inf, "bristle_stiffness": 5.0}).items():
        with pytest.raises(InputError, match=r"Friction: \w+: got"):
            Friction(**{name: value})


def test_a_clutch_lets_the_hand_lag_behind_its_shaft_by_the_play_at_most():
    loose, tight = (Clutch(backlash=play, rotor_inertia=1e-3) for play in (0.1, 1e-4))
    free = robot(UNIT, clutch=loose, viscous=1e-3)
    with pytest.raises(InputError, match="clutch"):
        GreyBoxJoint(free)
    joint = MujocoJoint(free)
    joint.advance(0.01, 0.02)
    alone = (0.01 * 0.02**2 / 2) / 1e-3  # the shaft turns without the hand, inside the play
    assert joint.angle == pytest.approx(alone, rel=0.02)
    hardly = MujocoJoint(replace(free, clutch=tight))
    rigid = GreyBoxJoint(replace(free, clutch=None))
    for _ in range(200):
        for each in (hardly, rigid):
            each.advance(0.01, 0.01)
    assert hardly.angle == pytest.approx(rigid.angle, abs=2e-3)


GEAR = {"coulomb": 4e-4, "stribeck": 3e-4, "stribeck_velocity": 0.3, "viscous": 1e-4}
GEAR |= {"load_friction": 0.1, "motor_stribeck": 0.1, "load_stribeck": 0.08}
GEAR |= {"lifting_stribeck": 1.5, "lowering_stribeck": 1.0, "motor_friction": 0.15}
UNEVEN = {"coulomb": 2e-3, "load_drag": 0.05, "coulomb_slope": 3e-3}


@pytest.mark.parametrize(("inductance", "friction"), [(0.0, GEAR), (0.01, GEAR), (0.0, UNEVEN)])
def test_friction_by_torque_or_angle_is_mujoco_s_as_its_steps_shrink(inductance, friction):
    """And otherwise than without the last of its terms."""
    drive, plainer = replace(MOTOR, inductance=inductance), friction | {[*friction][-1]: 0.0}
    wanted, plain = (_swing(GreyBoxJoint, drive, each, 1e-3) for each in (friction, plainer))
    coarse, fine = (
        np.abs(_swing(MujocoJoint, drive, friction, step) - wanted).max() for step in (1e-3, 1e-4)
    )
    assert fine < min(2e-3, 0.5 * coarse)
    assert np.abs(plain - wanted).max() > 20 * fine
    assert np.ptp(wanted) > 0.5


def _swing(kind, drive, friction, step):
    """Angles in 0.85 s of a swing that the motor drives, and is driven by."""
    joint, angles = kind(robot(drive, **friction), ADDED, angle=0.3), []
    joint.reset()
    for k in range(85):
        for _ in range(round(0.01 / step)):
            joint.advance(1.5 * math.sin(0.08 * k), step)
        angles.append(joint.angle)
    return np.array(angles)


def _net(motor, load, moving):
    """What friction leaves of both torques, as BAM's M6 has it (arXiv 2410.08650)."""
    e = math.exp(-((moving / GEAR["stribeck_velocity"]) ** 2))
    budget = GEAR["coulomb"] + abs(GEAR["motor_friction"] * motor - GEAR["load_friction"] * load)
    budget += e * GEAR["stribeck"]
    budget += e * abs(GEAR["motor_stribeck"] * motor - GEAR["load_stribeck"] * load)
    if motor * load < 0:
        drives = abs(motor) > abs(load)
        budget += e * (GEAR["lifting_stribeck"] * load**2 if drives else motor**2)
    return motor + load - math.copysign(budget, moving)


@pytest.mark.parametrize("joint", JOINTS)
@pytest.mark.parametrize("load", [-0.02, 0.02])
@pytest.mark.parametrize("way", [1, -1])
def test_a_steady_torque_moves_a_gear_from_where_friction_of_motor_and_load_is_overcome(
    joint, load, way
):
    edge = brentq(lambda motor: way * _net(motor, load, 1e-9 * way), -load, way * 0.1)
    for share, moves in ((0.98, False), (1.02, True)):
        pushed = joint(robot(UNIT, BALANCED, **GEAR, bias=load))
        pushed.advance(-load + share * (edge + load), 1.0)
        assert (way * pushed.angle > 1e-2) == moves
