"""Motors that raise, or answer with what is no number; and switching them off, whatever happens."""

import contextlib
import math
import os
import signal

import numpy as np
import pytest

from butterfly.campaigns.drive import Drive, DriveFault, signals_wait
from butterfly.errors import InputError
from butterfly.logs.log import InputKind
from butterfly.plant.motor import Reading


class Fake:
    """A motor whose methods do as they are told, and that counts its calls."""

    input_kind = InputKind.TORQUE

    def __init__(self, **does):
        self._does, self.calls = does, []

    def _call(self, name, value=None):
        self.calls.append(name)
        found = self._does.get(name, value)
        if isinstance(found, list):
            found = found.pop(0) if found else value
        if isinstance(found, BaseException):
            raise found
        return found() if callable(found) else found

    def start(self):
        self._call("start")

    def stop(self):
        self._call("stop")

    def command(self, value):
        return self._call("command", value)

    def read(self):
        return self._call("read", Reading(0.0, 0.0, math.nan))

    def wait(self, duration):
        self._call("wait", duration)


@pytest.mark.parametrize(
    "given",
    [
        None,
        (0.0, 0.0),
        (0.0, 0.0, math.nan, 1.0),
        "012",
        Reading(0.0, None, math.nan),
        Reading(0.0, math.nan, math.nan),
        Reading(math.nan, 0.0, math.nan),
        Reading(0.0, math.inf, math.nan),
        Reading(0.0, "0.1", math.nan),
        Reading(0.0, 0.0, None),
        Reading(0.0, np.zeros(3), math.nan),
        Reading(0.0, 1j, math.nan),
        ValueError("not enough values"),
        RuntimeError(),
        KeyError("angle"),
        OSError("device not configured"),
    ],
    ids=str,
)
def test_whatever_a_reading_is_that_is_none_becomes_one_sentence(given):
    with pytest.raises(DriveFault) as caught:
        Drive(Fake(read=given)).read()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("given", [None, math.nan, "1", ValueError("late"), (1.0, 2.0)], ids=str)
def test_whatever_a_command_returns_that_is_no_number_becomes_one_sentence(given):
    motor = Fake(command=given if isinstance(given, Exception) else lambda: given)
    with pytest.raises(DriveFault, match=r"command\(\)"):
        Drive(motor).command(0.5)


def test_numbers_of_any_kind_are_read():
    given = (np.float32(0.5), np.array(0.25), 1)
    assert Drive(Fake(read=given)).read() == (0.5, 0.25, 1.0)


def test_a_drive_is_tried_again_until_it_is_off():
    motor = Fake(command=OSError("gone"), stop=[OSError("gone"), OSError("gone")])
    drive = Drive(motor)
    drive.start()
    drive.switch_off()
    assert motor.calls.count("stop") == 3
    drive.switch_off()
    assert motor.calls.count("stop") == 3


def test_a_drive_that_cannot_be_switched_off_is_said_so_loudly():
    drive = Drive(Fake(stop=OSError("gone")))
    drive.start()
    with pytest.raises(DriveFault, match="cut its supply"):
        drive.switch_off()


def test_a_drive_that_fails_to_start_is_stopped_and_its_own_reason_is_given():
    motor = Fake(start=OSError("refused"), stop=AttributeError("no socket"))
    with pytest.raises(DriveFault, match="refused"):
        Drive(motor).start()
    assert "stop" in motor.calls


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_no_signal_prevents_that_a_drive_is_switched_off(name):
    number = getattr(signal, name)
    before = signal.getsignal(number)
    motor = Fake(stop=lambda: os.kill(os.getpid(), number))
    drive = Drive(motor)

    def play():
        try:
            drive.start()
            os.kill(os.getpid(), number)
            pytest.fail("the first signal interrupts what is played")
        finally:
            drive.switch_off()

    with pytest.raises(KeyboardInterrupt):
        play()
    assert motor.calls.count("stop") == 1
    assert signal.getsignal(number) == before


def test_a_ctrl_c_inside_of_stop_is_raised_when_the_drive_is_off():
    motor = Fake(stop=[KeyboardInterrupt()])
    drive = Drive(motor)
    drive.start()
    with pytest.raises(KeyboardInterrupt):
        drive.switch_off()
    assert motor.calls.count("stop") == 2


@pytest.mark.parametrize(
    ("motor", "named"),
    [
        (type("Servo", (Fake,), {"input_kind": InputKind.SETPOINT})(), "torque, current or PWM"),
        (type("Free", (Fake,), {"input_kind": InputKind.NONE})(), "input_kind"),
        (type("Odd", (Fake,), {"input_kind": "steam"})(), "input_kind"),
        (type("Bad", (Fake,), {"input_kind": property(lambda _: 1 / 0)})(), "input_kind"),
        (object(), "without start"),
        (3.0, "without start"),
    ],
)
def test_what_cannot_be_commanded_is_refused_before_it_is_started(motor, named):
    with pytest.raises(InputError, match=named):
        Drive(motor)
    assert "start" not in getattr(motor, "calls", [])


def test_a_zero_that_is_never_sent_does_not_keep_a_drive_from_being_stopped():
    motor = Fake(command=lambda: os.kill(os.getpid(), signal.SIGINT))  # Ctrl-C while it waits
    drive = Drive(motor)
    drive.start()
    with pytest.raises(KeyboardInterrupt):
        drive.switch_off()
    assert motor.calls[-1] == "stop"
    assert not drive.is_enabled


def test_an_interrupt_that_a_motor_swallows_ends_the_run_at_its_next_reading():
    def swallowing():
        with contextlib.suppress(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
        return Reading(0.0, 0.0, math.nan)

    drive = Drive(Fake(read=swallowing))
    drive.start()
    with pytest.raises(KeyboardInterrupt):
        drive.read()
    with pytest.raises(KeyboardInterrupt):
        drive.switch_off()


def test_what_is_written_while_signals_wait_is_written_whole():
    written = []

    def write():
        with signals_wait():
            os.kill(os.getpid(), signal.SIGTERM)
            written.append(1)

    with pytest.raises(KeyboardInterrupt):
        write()
    assert written == [1]
