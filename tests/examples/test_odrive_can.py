"""The ODrive's adapter against a stand-in whose joint shares no code with the program."""

import math
import struct
from itertools import groupby

import numpy as np
import pytest

can = pytest.importorskip("can", reason="python-can is not installed (extra 'can')")

from butterfly.errors import InputError
from butterfly.identification.data import read_data_set
from butterfly.identification.estimators import OutputError
from butterfly.identification.identify import identify
from butterfly.logs.log import InputKind, Sine
from butterfly.logs.manifest import read_manifest
from butterfly.model.prior import Known
from butterfly.plant.motor import ControlLoop
from butterfly.plant.sensors import Clock, Encoder
from examples.odrive_can import AxisState, Command, DriveError, ODrive
from examples.odrive_stand_in import StandIn, WaitingBus
from examples.record_sines import record
from tests.independent.integrator import Joint, motion

NODE, PERIOD, ZERO, COUNTS = 3, 0.01, 2.5, 16384
JOINT = Joint(inertia=0.04, viscous=0.02, gravity=1.2, gain=1.0, coulomb=0.02)


class Independent:
    """What the stand-in turns."""

    def __init__(self):
        self.angle = self._velocity = 0.0

    def advance(self, command, duration):
        stamps, inputs = np.array([0.0, duration]), np.full(2, command)
        angles, velocities = motion(JOINT, stamps, inputs, self.angle, self._velocity)
        self.angle, self._velocity = float(angles[-1]), float(velocities[-1])


class Drive(StandIn):
    """The stand-in with a memory, and with what may go wrong once it has lived for some periods."""

    def __init__(self):
        seen = {"encoder": Encoder(steps=COUNTS), "zero": ZERO}
        super().__init__(Independent(), "test", node=NODE, period=PERIOD, **seen)
        self.torques, self.periods = [], 0
        self.fault, self.fails_after = "", 0

    def live(self):
        self.periods += 1
        if self.fails("reports an error"):
            self.error, self.state = 0x01000000, AxisState.IDLE
        if self.fails("disarms"):
            self.state = AxisState.IDLE
        super().live()

    def fails(self, fault):
        return self.fault == fault and self.periods > self.fails_after

    def obey(self, command, data):
        if command == Command.SET_AXIS_STATE and self.fault == "does not arm":
            data = struct.pack("<I", AxisState.IDLE)
        super().obey(command, data)
        if command == Command.SET_INPUT_TORQUE:
            self.torques.append(self.torque)

    def say(self, command, data):
        if self.fails("is silent") or (
            command == Command.HEARTBEAT and self.fails("has no heartbeat")
        ):
            return
        if command == Command.ENCODER_ESTIMATES and self.fails("is slow") and self.periods % 2:
            return
        super().say(command, data)

    @property
    def has_let_go(self):
        """Whether it is idle, without torque, when it has read what it was told last."""
        self.live()
        return self.torque == 0.0 and self.state == AxisState.IDLE


@pytest.fixture
def drive():
    return Drive()


@pytest.fixture
def bus(drive):
    with WaitingBus("test", drive) as bus:
        yield bus


def _run(bus, law, duration=1.0, **options):
    motor = ODrive(bus, **{"limit": 0.3, "node": NODE, "period": PERIOD, **options})
    with ControlLoop(motor, clock=Clock(step=PERIOD)) as loop:
        return loop.run(law, duration)


def _sine(reading):
    return 0.5 * math.sin(5.0 * reading.time)


def test_the_log_holds_what_the_drive_was_told_and_how_the_joint_moved(drive, bus):
    log = _run(bus, _sine, 4.0)
    assert log.input_kind is InputKind.TORQUE
    np.testing.assert_allclose(np.diff(log.time), PERIOD, rtol=1e-9)
    wanted = np.clip(0.5 * np.sin(5.0 * log.time), -0.3, 0.3)
    np.testing.assert_allclose(log.input, wanted, rtol=1e-6)
    assert np.abs(log.input).max() == np.float32(0.3)  # the limit
    assert drive.has_let_go
    np.testing.assert_array_equal([0.0, *log.input, 0.0], drive.torques)
    moved, _ = motion(JOINT, log.time, log.input)
    assert np.ptp(moved) > 1.0
    np.testing.assert_allclose(log.angle, moved + ZERO, atol=0.51 * math.tau / COUNTS)


def test_a_gear_divides_angles_and_torques_of_the_motor(drive, bus):
    log = _run(bus, lambda _: 0.12, gear=-6.0)
    np.testing.assert_allclose(log.input, 0.12, rtol=1e-6)
    np.testing.assert_allclose(drive.torques[1:], -0.02, rtol=1e-6)
    assert log.angle[0] == pytest.approx(-ZERO / 6.0, abs=1e-4)


def test_messages_are_those_of_the_protocol_byte_for_byte(bus):
    with can.Bus(interface="virtual", channel="test") as witness:
        _run(bus, lambda _: 0.1, 0.2)
        all_sent = list(iter(lambda: witness.recv(0.0), None))
    assert not any(each.is_extended_id or each.is_remote_frame for each in all_sent)
    sent = [(each.arbitration_id, bytes(each.data).hex()) for each in all_sent]
    told = [each for each in sent if each[0] not in {0x61, 0x69}]
    assert [each for each, _ in groupby(told)] == [
        (0x6B, "0100000001000000"),  # torque control, passed through
        (0x6E, "00000000"),
        (0x67, "08000000"),  # closed loop
        (0x6E, "cdcccc3d"),  # 0.1 as float32
        (0x6E, "00000000"),
        (0x67, "01000000"),  # idle
    ]
    assert {each for each in sent if each[0] == 0x61} == {
        (0x61, "0000000001000000"),  # as the manufacturer's guide prints the heartbeat
        (0x61, "0000000008000000"),
    }


FAULTS = [
    ("is silent", 0, r"at node 3 has sent no estimate for 0\.25 s"),
    ("reports an error", 0, "reports the error 0x1000000"),
    ("does not arm", 0, "is in state 1, not in closed loop"),
    ("has no heartbeat", 0, "sends no heartbeat"),
    ("is slow", 0, r"an estimate every 20 ms, not every 10 ms \(can\.encoder_msg_rate_ms\)"),
    ("is silent", 80, "has sent no estimate"),
    ("reports an error", 80, "reports the error"),
    ("disarms", 80, "is in state 1"),
]
"""What is wrong, after how many periods, and what is said."""


@pytest.mark.parametrize(("fault", "after", "said"), FAULTS)
def test_a_drive_that_is_not_well_is_not_started_or_let_go(drive, bus, fault, after, said):
    drive.fault, drive.fails_after = fault, after
    with pytest.raises(DriveError, match=said):
        _run(bus, lambda _: 0.1)
    assert drive.has_let_go
    assert any(drive.torques) == bool(after)


@pytest.mark.parametrize("stop", [KeyboardInterrupt, ZeroDivisionError])
def test_it_stops_when_the_law_is_interrupted(drive, bus, stop):
    def law(reading):
        if reading.time > 0.2:
            raise stop
        return 0.1

    with pytest.raises(stop):
        _run(bus, law)
    assert any(drive.torques)
    assert drive.has_let_go


def test_it_stops_when_it_is_interrupted_while_it_arms(drive, bus, monkeypatch):
    def obey(command, _):
        if command == Command.SET_AXIS_STATE:
            drive.state = AxisState.CLOSED_LOOP_CONTROL
            monkeypatch.undo()
            raise KeyboardInterrupt

    monkeypatch.setattr(drive, "obey", obey)
    with pytest.raises(KeyboardInterrupt):
        _run(bus, lambda _: 0.1)
    assert drive.has_let_go


def test_it_goes_idle_even_if_the_torque_cannot_be_told(drive, bus, monkeypatch):
    send = bus.send

    def blocked(message):
        if not any(message.data):
            monkeypatch.undo()
            raise can.CanOperationError("full")
        send(message)

    def law(_):
        monkeypatch.setattr(bus, "send", blocked)
        return 0.1

    with pytest.raises(can.CanOperationError):
        _run(bus, law, 0.2)
    drive.live()
    assert drive.state == AxisState.IDLE


def test_a_program_that_comes_late_reads_the_newest_estimate(drive, bus):
    late = []

    def law(reading):
        if reading.time > 0.2 and not late:
            late.append(reading.time)
            for _ in range(10):
                drive.live()
        return 0.1

    log = _run(bus, law)
    steps = np.round(np.diff(log.time) / PERIOD)
    assert sorted(steps)[-2:] == [1.0, 10.0]


def test_other_nodes_are_not_listened_to(bus):
    with can.Bus(interface="virtual", channel="test") as other:

        def law(_):
            error = struct.pack("<IB", 1, 1)
            other.send(can.Message(arbitration_id=0x41, data=error, is_extended_id=False))
            return 0.1

        _run(bus, law, 0.2)


def test_what_is_no_torque_never_reaches_the_drive(drive, bus):
    with pytest.raises(InputError, match="control law: command"):
        _run(bus, lambda _: math.nan)
    assert drive.has_let_go
    with pytest.raises(InputError, match="limit"):
        ODrive(bus, limit=0.0)


def test_its_logs_tell_the_parameters_of_one_mass(bus, tmp_path):
    motor = ODrive(bus, limit=0.3, node=NODE, period=PERIOD)
    sines = [Sine(omega=omega, amplitude=0.12) for omega in (3.5, 5.0, 7.0)]
    manifest = record(motor, sines, tmp_path, seconds=10.0, period=PERIOD, gain=Known(value=1.0))
    found = identify(read_data_set(read_manifest(manifest)), OutputError(terms=()))
    truth = {"p1": JOINT.inertia, "p2": JOINT.viscous, "p3": JOINT.gravity}
    truth["coulomb"] = JOINT.coulomb
    for name, value in truth.items():
        assert getattr(found.estimate.parameters, name) == pytest.approx(value, rel=0.01), name
