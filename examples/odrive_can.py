"""A joint driven by an ODrive over CAN, behind butterfly's motor wrapper.

Messages are those of CANSimple, as firmware 0.5.4 and later speaks it
(https://docs.odriverobotics.com/v/latest/manual/can-protocol.html): an 11-bit identifier
``node << 5 | command``, data with the least significant byte first. The CAN adapter is
python-can's affair (``pip install python-can``). `examples.record_sines` drives sines with it;
docs/torque-joint.md says how to set the drive up.
"""

from __future__ import annotations

import math
import struct
from enum import IntEnum

import can

from butterfly.logs.log import InputKind
from butterfly.plant.motor import CommandPath, Reading


class Command(IntEnum):
    """Lower five bits of an identifier, with the data that belong to it."""

    HEARTBEAT = 0x01  # from the drive: uint32 error, uint8 state, and more
    SET_AXIS_STATE = 0x07  # uint32 state
    ENCODER_ESTIMATES = 0x09  # from the drive: float32 turns, float32 turns/s
    SET_CONTROLLER_MODE = 0x0B  # uint32 control mode, uint32 input mode
    SET_INPUT_TORQUE = 0x0E  # float32 N m


class AxisState(IntEnum):
    """What an axis may be doing, as far as it matters here."""

    IDLE = 1
    CLOSED_LOOP_CONTROL = 8


TORQUE_CONTROL = 1
"""The control mode that obeys torques."""

PASSTHROUGH = 1
"""The input mode that takes a command as it comes, without ramp or filter."""

_OWN_MESSAGES = 0x7E0  # mask of the identifier's bits that name the node


class DriveError(RuntimeError):
    """The drive is silent, reports an error, or does not do what it was told."""


class ODrive:
    """One axis, as a `butterfly.plant.motor.Motor` that is told torques in N m at the joint.

    The drive's stream of encoder estimates is the clock: to wait is to listen. What it hears of
    faults it raises, and the bench stops the motor then, as after Ctrl-C. If the program is killed,
    only the drive's own watchdog stops it: switch it on.

    Parameters
    ----------
    bus
        Of python-can.
    limit
        Largest torque in N m at the joint; commands beyond are cut to it.
    node
        The axis's ``can.node_id``.
    period
        Its ``can.encoder_msg_rate_ms``, in s.
    gear
        Turns of the motor per turn of the joint; negative if it reverses.
    timeout
        In s, without an estimate, after which the drive is given up; more than the time between two
        heartbeats, which is 0.1 s.
    """

    input_kind = InputKind.TORQUE

    def __init__(
        self,
        bus: can.BusABC,
        *,
        limit: float,
        node: int = 0,
        period: float = 0.01,
        gear: float = 1.0,
        timeout: float = 0.25,
    ) -> None:
        self._bus, self._node = bus, node
        self._path = CommandPath(limit=limit)
        self._period, self._gear, self._timeout = period, gear, timeout
        self._begin = self._stamp = self._angle = math.nan
        self._state: int | None = None
        self._is_armed = False
        bus.set_filters([{"can_id": node << 5, "can_mask": _OWN_MESSAGES, "extended": False}])

    def start(self) -> None:
        """Listen whether the axis is well, then arm it with no torque.

        Raises
        ------
        DriveError
            If it is silent, reports an error, sends estimates at another rate or does not arm.
        """
        self._state = None
        while self._bus.recv(0.0) is not None:
            pass  # said long ago
        self._stamp = math.nan
        begin = self._stamp = self._hear().timestamp
        heard = self._listen(self._timeout)
        if self._state is None:
            raise self._error("sends no heartbeat")
        period = (self._stamp - begin) / heard
        if abs(period / self._period - 1.0) > 0.25:  # noqa: PLR2004 - a quarter off is another rate
            expected = f"{1e3 * self._period:g} ms (can.encoder_msg_rate_ms)"
            raise self._error(
                f"sends an estimate every {1e3 * period:.3g} ms, not every {expected}"
            )
        try:
            self._send(Command.SET_CONTROLLER_MODE, "<II", TORQUE_CONTROL, PASSTHROUGH)
            self._send(Command.SET_INPUT_TORQUE, "<f", 0.0)
            self._send(Command.SET_AXIS_STATE, "<I", AxisState.CLOSED_LOOP_CONTROL)
            self._listen(self._timeout)
            self._is_armed = True
            self._require_closed_loop()
        except BaseException:  # nobody else knows yet that there is something to stop
            self.stop()
            raise
        self._begin = self._stamp

    def stop(self) -> None:
        """Set the torque to 0 and the axis to idle."""
        self._is_armed = False
        try:
            self._send(Command.SET_INPUT_TORQUE, "<f", 0.0)
        finally:
            self._send(Command.SET_AXIS_STATE, "<I", AxisState.IDLE)

    def command(self, value: float) -> float:
        """Set the torque in N m; return it within the limit, and rounded as it is sent."""
        data = self._send(Command.SET_INPUT_TORQUE, "<f", self._path.shape(value) / self._gear)
        return float(struct.unpack("<f", data)[0]) * self._gear

    def read(self) -> Reading:
        """Return the last estimate, at the time at which the adapter received it."""
        return Reading(self._stamp - self._begin, self._angle, math.nan)

    def wait(self, duration: float) -> None:
        """Listen until an estimate comes that is ``duration`` s younger than the last.

        Raises
        ------
        DriveError
            If the drive is silent, reports an error, or is no longer in closed loop.
        """
        self._listen(duration)

    def _listen(self, duration: float) -> int:
        """Take messages for ``duration`` s, and all that wait; return how many were estimates."""
        due = self._stamp + duration - 0.5 * self._period
        heard = 0
        while self._stamp < due:
            heard += self._take(self._hear())
        while (message := self._bus.recv(0.0)) is not None:
            heard += self._take(message)
        return heard

    def _hear(self) -> can.Message:
        message = self._bus.recv(self._timeout)
        if message is None or message.timestamp > self._stamp + self._timeout:
            raise self._error(f"has sent no estimate for {self._timeout:g} s")
        return message

    def _take(self, message: can.Message) -> bool:
        """Take note of a message; tell whether it was an estimate."""
        command = message.arbitration_id & ~_OWN_MESSAGES
        if command == Command.ENCODER_ESTIMATES:
            turns, _ = struct.unpack("<ff", message.data)
            self._stamp, self._angle = message.timestamp, math.tau * turns / self._gear
            return True
        if command == Command.HEARTBEAT:
            error, self._state = struct.unpack_from("<IB", message.data)
            if error:
                raise self._error(f"reports the error 0x{error:X}")
            self._require_closed_loop()
        return False

    def _require_closed_loop(self) -> None:
        if self._is_armed and self._state != AxisState.CLOSED_LOOP_CONTROL:
            raise self._error(f"is in state {self._state}, not in closed loop")

    def _send(self, command: Command, form: str, *values: float) -> bytes:
        data = struct.pack(form, *values)
        identifier = self._node << 5 | command
        self._bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))
        return data

    def _error(self, what: str) -> DriveError:
        return DriveError(f"the drive at node {self._node} {what}")
