"""MuJoCo, the grey box and a log of known parameters side by side."""

from dataclasses import asdict, replace

import numpy as np
import pytest

from butterfly.comparison.three_way import compare_three
from butterfly.identification.data import DataSet
from butterfly.identification.estimators import HarmonicBalance
from butterfly.identification.identified import given_estimate
from butterfly.identification.segments import driven
from butterfly.logs.log import InputKind, Log
from butterfly.model.parameters import AddedMass, JointKind, LumpedParameters
from butterfly.model.servo import ServoLoop
from butterfly.plant.joints import GreyBoxJoint, MujocoJoint
from butterfly.plant.rig import Rig, Simulator
from butterfly.plant.robot import Robot
from butterfly.plant.rollout import replay_input
from butterfly.plant.sensors import Clock
from butterfly.signals.excitations import Table
from tests.conftest import MASSES
from tests.identification.simulated import ROBOT, SWINGS, steady
from tests.independent.integrator import Joint, motion

ZERO = 0.4


@pytest.fixture(scope="module")
def data():
    logs = steady(ROBOT, dict(list(SWINGS.items())[::2]), duration=12.0)
    briefly = [log.take(np.arange(0, log.time.size, 4)) for log in logs]
    return DataSet.of([replace(log, angle=log.angle + ZERO) for log in briefly])


@pytest.fixture(scope="module")
def estimate(data):
    return HarmonicBalance()(data)


@pytest.fixture(scope="module")
def ways(data, estimate):
    return compare_three(data, estimate, [0, 5])


def test_both_simulators_follow_the_robot_and_each_other(data, ways):
    for way in ways:
        assert way.log in data.logs
        assert way.zero == pytest.approx(ZERO, abs=2e-3)
        assert way.fits["MuJoCo"] > 97
        assert way.fits["grey box"] > 97
        assert way.difference < 5e-3
        assert way.difference == np.abs(way.mujoco - way.greybox).max()
        for gain in way.gains.values():
            assert gain == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize(
    "added",
    [
        AddedMass(mass=0.5, joint=JointKind.SLIDE),
        AddedMass(mass=0.5, arm=0.2, gravity=0.0),
        AddedMass(mass=0.5, arm=0.2, gravity=4.0),
    ],
)
def test_mujoco_carries_a_mass_as_its_joint_does(added):
    bare = LumpedParameters(p1=0.1, p2=0.2, p3=0.1 * added.gravity, p4=1.0, coulomb=0.01)
    time = np.arange(0.0, 4.0, 0.002)
    command = 0.3 * np.sin(3.0 * time)
    angle, _ = motion(
        Joint(0.1 + added.inertia, 0.2, bare.p3 + added.gravity_moment, 1.0, 0.01), time, command
    )
    log = Log(time=time, input=command, angle=angle, input_kind=InputKind.TORQUE, added_mass=added)
    given = given_estimate(asdict(bare) | {"zero": 0.0}, "test")
    (way,) = compare_three(DataSet.of([log]), given, [0])
    assert way.fits["MuJoCo"] > 99
    assert way.fits["grey box"] > 99


def test_what_an_estimate_found_for_a_log_reaches_both_simulators(data, estimate, ways):
    """A bias that only one log has is in both."""
    log, plain = data.logs[0], ways[0]
    biased = replace(estimate, local={log.name: {"bias": 6e-3, "zero": ZERO}})
    (way,) = compare_three(data, biased, [0])
    assert way.parameters.bias == 6e-3
    moved = way.mujoco - plain.mujoco, way.greybox - plain.greybox
    for each in moved:
        assert np.mean(each) > 0.05
    assert way.difference < 5e-3


def test_a_drive_that_is_late_and_compressed_is_so_in_both_simulators(data, estimate, ways):
    plain = ways[0]
    late = np.where(np.array(estimate.names) == "delay", 0.15, estimate.values)
    compressed = {"names": (*estimate.names, "compression"), "values": [*estimate.values, 20.0]}
    changed = compressed | {"values": np.array(compressed["values"])}
    for each in (replace(estimate, values=late), replace(estimate, **changed)):
        (way,) = compare_three(data, each, [0])
        assert np.abs(way.mujoco - plain.mujoco).max() > 0.02
        assert np.abs(way.greybox - plain.greybox).max() > 0.02
        assert way.difference < 5e-3


def test_gains_over_the_log_say_what_the_parameters_get_wrong(data, estimate):
    gain = np.where(np.array(estimate.names) == "p4", 1.1, 1.0)
    doubled = replace(estimate, values=gain * estimate.values)
    number = next(k for k, log in enumerate(data.logs) if log.excitation.omega == 8.5)
    assert data.logs[number].added_mass == MASSES[0]
    (way,) = compare_three(data, doubled, [number])
    for gain in way.gains.values():  # far above the resonance the response is p4 over -p1 w^2
        assert abs(gain) == pytest.approx(1.1, abs=0.02)
    assert way.residual.torque.size


def test_a_log_without_a_sine_has_no_gain(data, estimate):
    free = DataSet.of([replace(log, excitation=None) for log in data.logs[:1]])
    (way,) = compare_three(free, replace(estimate, local={None: {"zero": ZERO}}), [0])
    assert way.gains == {}
    assert way.fits["MuJoCo"] > 97


SERVO = ServoLoop.of({"law": "dynamixel-xl330", "kp": 500, "supply": 7.0})


@pytest.mark.parametrize("closed", [True, False])
def test_mujoco_and_the_grey_box_follow_a_servo_that_is_off_for_a_while(closed):
    """Its back EMF, which is gone then, and friction on the motor's torque are in both."""
    p = LumpedParameters(p1=0.0066, p2=0.05, p3=0.3, p4=0.09, coulomb=0.01, back_emf=0.03,
                         motor_friction=0.1)  # fmt: skip
    rig = Rig(robot=Robot.of_lumped(p), simulator=Simulator.GREY_BOX, clock=Clock(step=0.01),
              servo=SERVO, torque_off=((0.8, 1.1),))  # fmt: skip
    steps = Table(time=(0.0, 0.1, 0.5), values=(0.0, 0.6, -0.4))
    log = rig.play(AddedMass(), steps, 1.5, np.random.default_rng(0))
    log = replace(log, angle=log.angle + ZERO, input=log.input + ZERO)
    data = DataSet.of([log if closed else replace(driven(log), servo=None)])
    (way,) = compare_three(data, given_estimate(asdict(p) | {"zero": ZERO}, "test"), [0])
    assert way.difference < 1e-3
    assert way.fits["MuJoCo"] > (99.9 if closed else 90)


@pytest.mark.slow
@pytest.mark.parametrize("number", [13, 19, 40])  # one of each mass
def test_the_three_ways_to_simulate_a_real_log_agree(real, number):
    """MuJoCo's Coulomb friction, which creeps at rest, is what is left."""
    setting = real.data.simulations.setting(number, real.estimate)
    log, p = real.data.logs[number], setting.parameters
    start = float(log.angle[0]) - setting.zero
    mujoco, grey = (
        replay_input(kind(Robot.of_lumped(p), log.added_mass, angle=start), log, p.delay)
        + setting.zero
        for kind in (MujocoJoint, GreyBoxJoint)
    )
    run = real.data.simulations.run(number, real.estimate).simulated
    assert np.abs(grey - run).max() < 2e-4
    assert np.abs(mujoco - run).max() < 3e-3
