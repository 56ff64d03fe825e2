"""The torque that other joints' motion makes, against a double pendulum's textbook equation."""

import numpy as np
import pytest

from butterfly.twin.joint_of_model import JointMotion, JointOfModel, coupling, smoothness

M1, M2, L1, L2, G = 0.7, 0.4, 0.3, 0.2, 9.81  # kg, kg, m, m, m/s²
DOUBLE = f"""<mujoco><compiler angle="radian"/><worldbody><body>
  <joint name="upper" axis="0 -1 0" armature="0.1" damping="0.3"/>
  <inertial pos="0 0 {-L1}" mass="{M1}" diaginertia="1e-9 1e-9 1e-9"/>
  <body pos="0 0 {-L1}"><joint name="lower" axis="0 -1 0" armature="0.2" frictionloss="0.1"/>
    <inertial pos="0 0 {-L2}" mass="{M2}" diaginertia="1e-9 1e-9 1e-9"/></body>
</body></worldbody></mujoco>"""
TIME = np.arange(600) * 0.01


def _swing(amplitude, omega, phase=0.0):
    position = amplitude * np.sin(omega * TIME + phase)
    velocity = amplitude * omega * np.cos(omega * TIME + phase)
    return JointMotion(position=position, velocity=velocity, acceleration=-(omega**2) * position)


@pytest.fixture
def robot(tmp_path):
    path = tmp_path / "double.xml"
    path.write_text(DOUBLE)
    return lambda joint: JointOfModel.of(path, joint)


def test_the_lower_arm_takes_what_the_double_pendulums_equation_says(robot):
    """The lower joint's row of the equations of two point masses (Spong et al. 2006, ex. 7.2)."""
    upper, lower = _swing(0.5, 2.0), _swing(0.3, 3.0, 0.4)
    torque = coupling(robot("lower"), lower, {"upper": upper}, {"upper": 0.0})
    a, b = upper, lower
    whole = M2 * (
        (L2**2 + L1 * L2 * np.cos(b.position)) * a.acceleration
        + L2**2 * b.acceleration
        + L1 * L2 * np.sin(b.position) * a.velocity**2
        + G * L2 * np.sin(a.position + b.position)
    )
    alone = M2 * (L2**2 * b.acceleration + G * L2 * np.sin(b.position))
    assert torque == pytest.approx(whole - alone, abs=1e-8)


def test_the_upper_arm_feels_the_lower_ones_swing(robot):
    upper, lower = _swing(0.5, 2.0), _swing(0.3, 3.0, 0.4)
    torque = coupling(robot("upper"), upper, {"lower": lower}, {"lower": 0.1})
    a, b, held = upper, lower, 0.1
    inertia = M1 * L1**2 + M2 * (L1**2 + L2**2 + 2 * L1 * L2 * np.cos(b.position))
    fixed = M1 * L1**2 + M2 * (L1**2 + L2**2 + 2 * L1 * L2 * np.cos(held))
    turning = M2 * L1 * L2 * np.sin(b.position)
    whole = (
        inertia * a.acceleration
        + M2 * (L2**2 + L1 * L2 * np.cos(b.position)) * b.acceleration
        - turning * (2 * a.velocity * b.velocity + b.velocity**2)
        + (M1 + M2) * G * L1 * np.sin(a.position)
        + M2 * G * L2 * np.sin(a.position + b.position)
    )
    alone = (
        fixed * a.acceleration
        + (M1 + M2) * G * L1 * np.sin(a.position)
        + M2 * G * L2 * np.sin(a.position + held)
    )
    assert torque == pytest.approx(whole - alone, abs=1e-8)


def test_neighbours_that_stand_still_in_their_pose_make_no_torque(robot):
    still = JointMotion(
        position=np.full(600, 0.2), velocity=np.zeros(600), acceleration=np.zeros(600)
    )
    own = _swing(0.8, 2.0)
    assert abs(coupling(robot("lower"), own, {"upper": still}, {"upper": 0.2})).max() < 1e-10
    assert abs(coupling(robot("lower"), own, {}, {"upper": 0.2})).max() < 1e-10


def test_a_smoothed_motion_has_the_derivatives_of_the_true_one():
    rng = np.random.default_rng(0)
    time = np.arange(3000) / 250
    true = 0.3 * np.sin(3 * time)
    motion = JointMotion.of(time, true + rng.normal(0, 3e-4, time.size), time)
    inside = slice(100, -100)  # a spline's second derivative is free at its ends
    assert np.std((motion.acceleration + 9 * true)[inside]) < 0.1 * np.std(9 * true)
    assert np.std((motion.velocity - 0.9 * np.cos(3 * time))[inside]) < 0.005
    assert motion.reach == pytest.approx(0.3, rel=1e-2)


def test_noise_alone_is_smoothed_to_next_to_nothing():
    time = np.arange(2000) / 200
    noise = np.random.default_rng(1).normal(0, 1e-3, time.size)
    motion = JointMotion.of(time, noise, time)
    assert np.std(motion.position) < 3e-4
    assert smoothness(time, noise) > smoothness(time, np.sin(5 * time) + noise)


def test_gravity_compensation_of_the_model_is_no_torque_of_neighbours(tmp_path):
    path = tmp_path / "held.xml"
    path.write_text(DOUBLE.replace("<body pos=", '<body gravcomp="1" pos='))
    own, upper = _swing(0.5, 2.0), _swing(0.0, 1.0)
    robot = JointOfModel.of(path, "lower")
    assert robot.pose_facts({}).moment == 0.0
    assert abs(coupling(robot, own, {"upper": upper}, {})).max() < 1e-9


def test_what_does_not_stand_out_of_the_encoders_noise_is_no_motion():
    time = np.arange(2000) / 200
    noise = np.random.default_rng(2).normal(0, 3e-4, time.size)
    still = JointMotion.of(time, 0.7 + noise, time)
    assert still.reach == 0.0
    assert not still.acceleration.any()
    assert still.position[0] == pytest.approx(0.7, abs=1e-4)
    moving = JointMotion.of(time, 1e-3 * np.sin(3 * time) + noise, time)
    assert moving.reach == pytest.approx(1e-3, rel=0.2)
