"""The armature's current as a state, against an independent integrator of (2)-(4)."""

import math
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from butterfly.model.linear import frequency_response
from butterfly.model.parameters import AddedMass, Friction, Hand, VoltageDrive
from butterfly.plant.joints import GreyBoxJoint, MujocoJoint
from butterfly.plant.mjcf import mjcf
from butterfly.plant.motor import ControlLoop
from butterfly.plant.rig import SimulatedMotor
from butterfly.plant.robot import Clutch, Robot
from butterfly.plant.sensors import Clock, Encoder
from tests.signals.sines import fit_sine

pytestmark = pytest.mark.slow

FINE = Encoder(steps=2**45)
ADDED = AddedMass(mass=0.05, arm=0.104)
CLOCK = Clock(step=0.01)


def _robot(time_constant, back_emf=0.03, coulomb=0.0):
    drive = VoltageDrive(
        resistance=2, torque_constant=0.05, back_emf_constant=back_emf, inductance=2 * time_constant
    )
    friction = Friction(viscous=2e-4, coulomb=coulomb)
    return Robot(
        hand=Hand(mass=0.1, com_distance=0.05, inertia=0.003), drive=drive, friction=friction
    )


def _voltage(time):
    return 0.5 * np.sin(4 * time)


def _run(joint, duration=5.0, clock=CLOCK):
    with ControlLoop(SimulatedMotor(joint, encoder=FINE), clock=clock) as loop:
        return loop.play(_voltage, duration)


@cache
def _reference(robot, cycle, samples):
    """Angle at the stamps, each held voltage integrated on its own to 1e-13."""
    loaded, drive = robot.lumped.with_added_mass(ADDED), robot.drive

    def rhs(_, state, voltage):
        x, v, i = state
        torque = drive.torque_constant * i - robot.friction.viscous * v - loaded.p3 * math.sin(x)
        back = drive.back_emf_constant * v
        return [v, torque / loaded.p1, (voltage - drive.resistance * i - back) / drive.inductance]

    state, angles = [0.0, 0.0, 0.0], [0.0]
    for start in cycle * np.arange(samples - 1):
        held = {"args": (_voltage(start),), "rtol": 1e-13, "atol": 1e-15}
        solution = solve_ivp(rhs, (start, start + cycle), state, "DOP853", **held)
        state = solution.y[:, -1]
        angles.append(state[0])
    return np.array(angles)


@pytest.mark.parametrize("joint", [MujocoJoint, GreyBoxJoint])
@pytest.mark.parametrize("back_emf", [0.03, 0.0])
@pytest.mark.parametrize(("cycle", "duration"), [(0.01, 5.0), (0.001, 2.0)])
def test_the_angle_is_right_to_1e_8_at_a_time_constant_of_1_ms(joint, back_emf, cycle, duration):
    robot = _robot(1e-3, back_emf)
    log = _run(joint(robot, ADDED), duration, Clock(step=cycle))
    np.testing.assert_allclose(log.angle, _reference(robot, cycle, log.time.size), atol=1e-8)
    assert np.ptp(log.angle) > 0.1


@pytest.mark.parametrize("joint", [MujocoJoint, GreyBoxJoint])
def test_a_vanishing_inductance_is_the_reduced_model(joint):
    limit = _run(joint(_robot(0.0), ADDED)).angle
    gaps = [np.abs(_run(joint(_robot(te), ADDED)).angle - limit).max() for te in (4e-3, 2e-3, 1e-3)]
    assert gaps[0] / gaps[1] == pytest.approx(2, abs=0.1)
    assert gaps[1] / gaps[2] == pytest.approx(2, abs=0.1)


def test_the_current_read_is_the_state_and_obeys_the_armature():
    for joint in (MujocoJoint, GreyBoxJoint):
        motor = SimulatedMotor(joint(_robot(0.01, back_emf=0.0)), encoder=FINE)
        motor.start()
        motor.command(1.0)
        assert motor.read().current == 0.0
        motor.wait(0.005)
        assert motor.read().current == pytest.approx(0.5 * (1 - math.exp(-0.5)), rel=1e-6)


def test_with_coulomb_friction_both_joints_still_agree():
    robot = _robot(2e-3, coulomb=5e-4)
    first, second = (
        _run(joint(robot, ADDED), duration=4.0).angle for joint in (MujocoJoint, GreyBoxJoint)
    )
    assert np.abs(first - second).max() < 2e-3


def test_the_frequency_response_has_the_armature_s_lag():
    robot = replace(_robot(0.02), hand=Hand(mass=0.01, com_distance=0.0, inertia=0.003))
    clock = Clock(step=1e-3)
    with ControlLoop(SimulatedMotor(GreyBoxJoint(robot), encoder=FINE), clock=clock) as loop:
        log = loop.play(lambda time: 0.05 * np.sin(9 * time), 40.0)
    rows = log.time > 40 - 10 * 2 * np.pi / 9
    angle, voltage = (
        fit_sine(log.time[rows], x[rows], 9.0).fundamental for x in (log.angle, log.input)
    )
    hold = np.exp(-0.5j * 9 * 1e-3)
    assert angle / (voltage * hold) == pytest.approx(
        complex(frequency_response(robot.lumped, 9.0)), rel=1e-4
    )


def test_two_robots_with_inductance_do_not_disturb_each_other():
    slow, fast = (MujocoJoint(_robot(te), ADDED) for te in (5e-3, 1e-3))
    together = [], []
    for _ in range(100):
        for joint, angles in zip((slow, fast), together, strict=True):
            joint.advance(0.4, 0.005)
            angles.append(joint.angle)
    for te, angles in zip((5e-3, 1e-3), together, strict=True):
        alone = MujocoJoint(_robot(te), ADDED)
        for angle in angles:
            alone.advance(0.4, 0.005)
            assert alone.angle == angle


def test_threads_do_not_disturb_each_other():
    """They switch, and compile models, in the midst of each other's cycles."""
    robots = [_robot(te) for te in (1e-3, 5e-3, 2e-3, 3e-3)]

    def angles(robot):
        found = []
        for _ in range(5):
            joint = MujocoJoint(robot, ADDED)
            for k in range(100):
                joint.advance(0.4 * math.sin(0.05 * k), 0.002)
                found.append((joint.angle, joint.current(0.0)))
        return found

    alone = [angles(robot) for robot in robots]
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    try:
        with ThreadPoolExecutor(4) as pool:
            together = list(pool.map(angles, robots))
    finally:
        sys.setswitchinterval(interval)
    assert together == alone


@pytest.mark.parametrize("stiffness", [0.0, 1.0])
def test_current_clutch_bristles_and_sticking_go_together(stiffness):
    friction = Friction(viscous=2e-4, coulomb=5e-4, stribeck=3e-4, bristle_stiffness=stiffness)
    robot = replace(_robot(2e-3), friction=friction)
    tight = replace(robot, clutch=Clutch(backlash=1e-5, rotor_inertia=1e-3))
    exact = _run(GreyBoxJoint(robot, ADDED), duration=2.0).angle
    assert np.ptp(exact) > 0.1
    for each in (robot, tight):
        angle = _run(MujocoJoint(each, ADDED), duration=2.0).angle
        np.testing.assert_allclose(angle, exact, atol=2e-3)


def test_an_exported_robot_with_inductance_loads_in_plain_mujoco_with_a_current():
    for back_emf in (0.03, 0.0):
        model = mujoco.MjModel.from_xml_string(mjcf(_robot(1e-3, back_emf), ADDED))
        assert model.na == 1
        data = mujoco.MjData(model)
        data.ctrl[0] = 0.2
        for _ in range(100):
            mujoco.mj_step(model, data)
        reduced = GreyBoxJoint(_robot(0.0, back_emf), ADDED)
        reduced.advance(0.2, 0.1)
        assert data.qpos[0] == pytest.approx(reduced.angle, rel=0.05)
