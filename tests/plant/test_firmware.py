"""A servo in its loop: MuJoCo, the grey box and what identification simulates, side by side."""

from dataclasses import replace

import numpy as np
import pytest

from butterfly.identification.segments import driven
from butterfly.identification.simulation import Simulation
from butterfly.logs.log import InputKind, Sine
from butterfly.model.parameters import LumpedParameters, TorqueDrive
from butterfly.model.servo import ServoLoop
from butterfly.plant.joints import MujocoJoint
from butterfly.plant.motor import CommandPath
from butterfly.plant.rig import Rig, Servo, Simulator
from butterfly.plant.rollout import replay_loop, simulate_runs
from butterfly.plant.sensors import Clock
from butterfly.signals.excitations import Table
from tests.plant.setting import ADDED, FINE, MOTOR, robot

LOOPS = {
    "pid-voltage": {"kp": 20.0, "ki": 5.0, "kd": 0.3, "limit": 6.0, "dead_band": 0.01},
    "cascade-voltage": {"kp": 10.0, "kd": 2.0, "ki": 5.0, "limit": 6.0, "speed_limit": 2.0},
    "speed-voltage": {"kp": 3.0, "ki": 5.0, "limit": 6.0, "slew": 200.0},
    "dynamixel-x": {"kp": 900, "supply": 11.0, "speed_limit": 1.5},
    "pid-current": {"kp": 4.0, "kd": 0.1, "limit": 0.4},
}
"""Every structure of a law, and every kind of limit."""

SINE = Sine(omega=4.0, amplitude=0.5)
TABLE = Table(time=(0.0, 0.2, 1.1), values=(0.4, -0.5, 0.3))


def _rig(law, simulator=Simulator.MUJOCO, drive=MOTOR, **friction):
    servo = ServoLoop.of({"law": law, **LOOPS[law]})
    own = robot(TorqueDrive(gain=0.5) if "current" in law else drive, **friction)
    return Rig(robot=own, simulator=simulator, encoder=FINE, clock=Clock(step=0.01), servo=servo,
               torque_off=((1.0, 1.3),))  # fmt: skip


def _log(rig, duration=2.0, signal=SINE):
    (log,) = simulate_runs(rig, [(ADDED, signal)], duration, [np.random.SeedSequence(0)])
    return log


def _identified(log, rig, delay=0.0):
    """The simulation of a log with the robot's own parameters."""
    flaws = {"dead_zone": rig.path.dead_zone, "compression": rig.path.compression}
    parameters = replace(rig.robot.lumped, delay=delay, **flaws)
    simulation = Simulation(driven(log), parameters)
    simulation.begins = np.zeros((1, 2))
    return simulation, parameters


def _assert_identified_alike(log, rig, delay=0.0):
    simulation, parameters = _identified(log, rig, delay)
    found = simulation.run(parameters, 0.0).at(log.time)
    np.testing.assert_allclose(found, log.angle, atol=1e-9)


@pytest.mark.parametrize("law", LOOPS)
def test_without_friction_mujoco_and_the_grey_box_follow_a_set_point_alike(law):
    rig = _rig(law)
    log = _log(rig)
    grey = _log(replace(rig, simulator=Simulator.GREY_BOX))
    assert log.input_kind is InputKind.SETPOINT
    assert np.array_equal(log.enabled == 0, (log.time >= 1.0) & (log.time < 1.3))
    assert np.ptp(log.angle) > 0.3
    np.testing.assert_allclose(grey.angle, log.angle, atol=1e-9)
    _assert_identified_alike(log, rig)


@pytest.mark.parametrize(
    ("law", "friction"),
    [
        ("pid-voltage", {"stribeck": 1e-3, "motor_friction": 0.15, "load_friction": 0.1}),
        ("cascade-voltage", {}),
        ("speed-voltage", {"stribeck": 1e-3}),
    ],
)
def test_with_friction_mujoco_comes_to_the_grey_box_as_its_steps_grow_short(law, friction):
    rig = replace(_rig(law, Simulator.GREY_BOX, coulomb=3e-3, **friction), torque_off=((0.3, 0.5),))
    log = _log(rig, 0.8)
    simulation, parameters = _identified(log, rig)
    loop, grid = simulation.segments.loop(parameters, 0.0), simulation.segments.grid
    exact = simulation.run(parameters, 0.0).pieces[0][1]
    np.testing.assert_allclose(exact[::10], log.angle, atol=1e-9)
    errors = []
    for step in (4e-4, 1e-4):
        angle, _ = replay_loop(MujocoJoint(rig.robot, ADDED), log, grid, loop, step)
        errors.append(np.abs(angle - exact).max())
    assert errors[1] < min(1e-4, 0.6 * errors[0])


class _Still:
    """A joint that stays at 0.1 rad, and keeps what it is told, and from when to when."""

    angle, velocity = 0.1, 0.0

    def __init__(self):
        self.told, self.now = [], 0.0

    def advance(self, command, duration):
        self.told.append((round(self.now, 9), command))
        self.now += duration

    def open_circuit(self, is_open):
        self.is_open = is_open


def test_the_firmware_looks_at_its_own_clock_and_holds_in_between():
    loop = ServoLoop.of({"law": "pid-duty", "kp": 2.0, "clock": 4e-3, "supply": 5.0, "limit": 0.5})
    servo = Servo(loop, LumpedParameters(p1=1, p2=0, p3=0, p4=3), ((0.02, 0.03),), None)
    joint = _Still()
    for k, setpoint in enumerate([0.15, 0.2, 0.3, 9.0]):
        servo.advance(joint, setpoint, 0.01 * k, 0.01 * k + 0.01)
    wanted = [(0.0, 0.5), (0.004, 0.5), (0.008, 0.5), (0.01, 0.5), (0.012, 1.0), (0.016, 1.0)]
    wanted += [(0.02, 0.0), (0.024, 0.0), (0.028, 0.0), (0.03, 0.0), (0.032, 2.5), (0.036, 2.5)]
    np.testing.assert_allclose(joint.told, wanted, atol=1e-12)
    assert joint.is_open is False


def test_a_delay_is_one_of_the_set_point_and_flaws_of_the_drive_lie_behind_the_firmware():
    path = CommandPath(delay=0.013, dead_zone=0.2, compression=0.1)
    rig = replace(_rig("pid-voltage", Simulator.GREY_BOX), path=path)
    log = _log(rig, signal=TABLE)
    _assert_identified_alike(log, rig, path.delay)
    plain = _log(replace(rig, path=CommandPath()), signal=TABLE)
    assert np.abs(plain.angle - log.angle).max() > 0.01


def test_a_supply_that_sags_is_recorded_and_multiplies_the_duty():
    sagging = Table(time=(0.0, 0.5), values=(11.0, 7.0))
    rig = replace(_rig("dynamixel-x"), supply=sagging)
    log = _log(rig, 1.0)
    assert set(log.supply) == {11.0, 7.0}
    _assert_identified_alike(log, rig)
    assert np.abs(_log(replace(rig, supply=None), 1.0).angle - log.angle).max() > 1e-3


@pytest.mark.parametrize("simulator", Simulator)
@pytest.mark.parametrize("inductance", [0.0, 4e-3])
def test_torque_off_takes_the_back_emf_with_it(simulator, inductance):
    motor = replace(MOTOR, back_emf_constant=0.3, inductance=inductance)
    rig = replace(_rig("pid-voltage", simulator, drive=motor), torque_off=((0.3, 9.0),))
    log = _log(rig, 2.5)
    bare = replace(rig.robot, drive=TorqueDrive(gain=1.0)).loaded(ADDED)
    late = log.angle[log.time > 0.5]
    decay = np.ptp(late[-80:]) / np.ptp(late[:80])
    assert decay == pytest.approx(np.exp(-bare.p2 / bare.p1 / 2 * 1.2), rel=0.02)
    assert decay > 0.9  # with the back EMF it is 0.3
