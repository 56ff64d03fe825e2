import math
import re
import socket
import threading
from pathlib import Path

import numpy as np
import pytest

from butterfly.errors import InputError
from butterfly.logs.log import InputKind, Sine
from butterfly.model.parameters import TorqueDrive
from butterfly.plant.joints import GreyBoxJoint, MujocoJoint
from butterfly.plant.motor import CommandPath, ControlLoop, ReplayMotor
from butterfly.plant.rig import SimulatedMotor
from butterfly.plant.sensors import Clock
from tests.plant.setting import ADDED, FINE, JOINTS, grey_box, robot, under_law

ROBOT = robot()


def _spring(reading):
    """A feedback law: pulls towards 0.4 rad."""
    return 3.0 * (0.4 - reading.angle)


def _run(joint, law=_spring, **parts):
    return under_law(joint, law, 5.0, 0.002, **parts)


def test_under_feedback_mujoco_and_grey_box_give_the_same_log():
    first, second = (_run(joint(ROBOT, ADDED)) for joint in JOINTS)
    assert np.ptp(first.angle) > 0.1
    np.testing.assert_allclose(first.angle, second.angle, atol=1e-9)
    np.testing.assert_allclose(first.input, second.input, atol=1e-8)


def test_the_log_holds_commands_as_they_were_set():
    path = CommandPath(limit=0.55, resolution=0.1)
    log = _run(GreyBoxJoint(ROBOT), path=path)
    steps = log.input[np.abs(log.input) < 0.55] / 0.1
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
    assert np.abs(log.input).max() == 0.55
    wanted = np.round(3.0 * (0.4 - log.angle) / 0.1) * 0.1
    np.testing.assert_allclose(log.input, np.clip(wanted, -0.55, 0.55), atol=1e-9)


@pytest.mark.parametrize("delay", [0.0007, 0.002, 0.0153])
@pytest.mark.parametrize("joint", JOINTS)
def test_a_delayed_command_takes_effect_at_its_own_instant(joint, delay):
    def law(reading):
        return 0.5 * math.sin(4 * reading.time)

    log = _run(joint(ROBOT), law, path=CommandPath(delay=delay))
    switches = log.time + delay
    instants = np.unique(np.concatenate([[0.0], log.time, switches[switches < log.time[-1]]]))
    held = np.searchsorted(switches, instants[:-1] + 1e-12, side="right") - 1
    inputs = np.where(held >= 0, log.input[np.maximum(held, 0)], 0.0)
    exact, _ = grey_box(ROBOT.lumped, instants, inputs)
    np.testing.assert_allclose(log.angle, np.interp(log.time, instants, exact), atol=1e-9)


def test_the_current_is_that_of_the_armature_and_unknown_for_a_torque_drive():
    motor = SimulatedMotor(MujocoJoint(ROBOT), encoder=FINE)
    motor.start()
    motor.command(1.0)
    assert motor.read().current == pytest.approx(0.5)
    motor.wait(0.05)
    before, after = motor.read(), (motor.wait(1e-5), motor.read())[1]
    speed = (after.angle - before.angle) / 1e-5
    assert before.current == pytest.approx((1 - 0.03 * speed) / 2, rel=1e-4)
    assert math.isnan(SimulatedMotor(GreyBoxJoint(robot(TorqueDrive(gain=1)))).read().current)


def test_a_replayed_log_comes_back_sample_by_sample_and_no_longer(sine_log):
    with ControlLoop(ReplayMotor(sine_log), clock=Clock(step=1e-3)) as loop:
        again = loop.run(lambda reading: reading.angle, 39.999)
    np.testing.assert_allclose(again.angle, sine_log.angle, atol=1e-9)
    np.testing.assert_array_equal(again.input, again.angle)
    assert again.input_kind is sine_log.input_kind
    with (
        ControlLoop(ReplayMotor(sine_log)) as loop,
        pytest.raises(InputError, match="a longer log"),
    ):
        loop.run(_spring, 41.0)


class _Recorder(SimulatedMotor):
    stopped = False

    def stop(self):
        self.stopped = True
        super().stop()


@pytest.mark.parametrize("late", [lambda: math.nan, lambda: math.inf, lambda: 1 / 0])
def test_a_law_that_fails_or_is_not_finite_stops_the_motor(late):
    motor = _Recorder(GreyBoxJoint(ROBOT))
    error = pytest.raises((InputError, ZeroDivisionError), match=r"law: command|division")
    with error, ControlLoop(motor) as loop:
        loop.run(lambda reading: late() if reading.time > 0.1 else 0.1, 1.0)
    assert motor.stopped


@pytest.mark.parametrize(
    "parts", [{"limit": 0}, {"limit": -1}, {"resolution": -1}, {"delay": -1}, {"delay": math.nan}]
)
def test_an_impossible_command_path_is_refused(parts):
    with pytest.raises(InputError):
        CommandPath(**parts)


class _FakeDrive(threading.Thread):
    """Speaks the protocol of docs/hardware.md on loopback; a grey-box joint behind it."""

    def __init__(self):
        super().__init__(daemon=True)
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port = self._server.getsockname()[1]
        self.commands = []

    def run(self):
        motor = SimulatedMotor(GreyBoxJoint(robot(TorqueDrive(gain=0.02)), ADDED))
        connection, _ = self._server.accept()
        with self._server, connection, connection.makefile("r") as lines:
            for line in lines:
                if line.startswith("u"):
                    self.commands.append(motor.command(float(line.split()[1])))
                else:
                    reading = motor.read()
                    connection.sendall(f"{reading.time + 7.0!r} {reading.angle!r} 0.1\n".encode())
                    motor.wait(0.002)


def _printed():
    """What the page on hardware defines."""
    text = (Path(__file__).parents[2] / "docs/hardware.md").read_text(encoding="utf-8")
    names = {}
    for block in re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL):
        exec(block, names)  # noqa: S102 - our own documentation
    return names


def test_the_printed_stop_closes_the_socket_whatever_is_raised_and_may_be_called_twice():
    motor = _printed()["SocketMotor"]("127.0.0.1", 0, limit=0.15)
    motor.stop()  # never started
    ours, theirs = socket.socketpair()
    vars(motor).update(_socket=ours, _lines=ours.makefile("r"))
    theirs.close()
    with pytest.raises(BrokenPipeError):
        motor.stop()
    assert ours.fileno() == -1
    motor.stop()


def test_the_page_on_hardware_works_as_printed(tmp_path):
    names = _printed()
    drive = _FakeDrive()
    drive.start()
    motor = names["SocketMotor"]("127.0.0.1", drive.port, limit=0.15)
    sine = Sine(omega=20.0, amplitude=0.2)
    log = names["record"](motor, sine, ADDED, 0.5, tmp_path / "log.mat")
    drive.join(timeout=5)
    assert not drive.is_alive()
    assert log.input_kind is InputKind.TORQUE
    assert log.time[0] == pytest.approx(0.002)
    clipped = np.clip(0.2 * np.sin(20 * log.time), -0.15, 0.15)
    np.testing.assert_allclose(log.input, clipped, atol=1e-12)
    assert drive.commands[-1] == 0.0
    assert np.ptp(log.angle) > 1e-3
    assert (tmp_path / "log.mat").exists()
