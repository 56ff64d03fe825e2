"""The armature's current as a state, against an independent integrator of (2)-(4)."""

import math
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from butterfly.plant.joints import GreyBoxJoint, MujocoJoint
from butterfly.plant.rig import SimulatedMotor
from butterfly.plant.robot import Clutch
from tests.plant.setting import ADDED, FINE, JOINTS, MOTOR, integrated, play, robot

pytestmark = pytest.mark.slow


def _robot(time_constant, back_emf=0.03, **friction):
    drive = replace(MOTOR, back_emf_constant=back_emf, inductance=2 * time_constant)
    return robot(drive, **friction)


@pytest.mark.parametrize("back_emf", [0.03, 0.0])
@pytest.mark.parametrize("cycle", [0.01, 0.001])
def test_the_angle_is_right_to_1e_8_at_a_time_constant_of_1_ms(back_emf, cycle):
    driven = _robot(1e-3, back_emf)
    loaded, drive = driven.loaded(ADDED), driven.drive

    def rhs(_, state, voltage):
        x, v, i = state
        torque = drive.torque_constant * i - 2e-4 * v - loaded.p3 * math.sin(x)
        back = drive.back_emf_constant * v
        return [v, torque / loaded.p1, (voltage - drive.resistance * i - back) / drive.inductance]

    logs = [play(joint(driven, ADDED), 2.0, step=cycle) for joint in JOINTS]
    exact = integrated(logs[0], rhs, [0.0, 0.0, 0.0])
    for log in logs:
        np.testing.assert_allclose(log.angle, exact, atol=1e-8)
    assert np.ptp(exact) > 0.1


@pytest.mark.parametrize("joint", JOINTS)
def test_the_current_read_is_the_state_and_obeys_the_armature(joint):
    motor = SimulatedMotor(joint(_robot(0.01, back_emf=0.0)), encoder=FINE)
    motor.start()
    motor.command(1.0)
    assert motor.read().current == 0.0
    motor.wait(0.005)
    assert motor.read().current == pytest.approx(0.5 * (1 - math.exp(-0.5)), rel=1e-6)


def test_threads_do_not_disturb_each_other():
    """They switch, and compile models, in the midst of each other's cycles."""
    robots = [_robot(te) for te in (1e-3, 5e-3, 2e-3, 3e-3)]

    def angles(driven):
        found = []
        for _ in range(5):
            joint = MujocoJoint(driven, ADDED)
            for k in range(100):
                joint.advance(0.4 * math.sin(0.05 * k), 0.002)
                found.append((joint.angle, joint.current(0.0)))
        return found

    alone = [angles(each) for each in robots]
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    try:
        with ThreadPoolExecutor(4) as pool:
            together = list(pool.map(angles, robots))
    finally:
        sys.setswitchinterval(interval)
    assert together == alone


@pytest.mark.parametrize("more", [{}, {"stribeck": 3e-4}, {"bristle_stiffness": 1.0}])
def test_current_clutch_bristles_and_sticking_go_together(more):
    rigid = _robot(2e-3, coulomb=5e-4, **more)
    tight = replace(rigid, clutch=Clutch(backlash=1e-5, rotor_inertia=1e-3))
    exact = play(GreyBoxJoint(rigid, ADDED), 2.0).angle
    assert np.ptp(exact) > 0.1
    for each in (rigid, tight):
        np.testing.assert_allclose(play(MujocoJoint(each, ADDED), 2.0).angle, exact, atol=2e-3)
