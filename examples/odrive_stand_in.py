"""A simulated ODrive at the other end of a virtual CAN bus: to rehearse with, and for tests."""

from __future__ import annotations

import math
import struct

import can
import numpy as np
from can.interfaces.virtual import VirtualBus

from butterfly.model.parameters import Friction, Hand, TorqueDrive
from butterfly.plant.joints import GreyBoxJoint, Joint
from butterfly.plant.robot import Robot
from butterfly.plant.sensors import Encoder
from examples.odrive_can import AxisState, Command

ROBOT = Robot(
    hand=Hand(mass=0.5, com_distance=0.25, inertia=0.006),
    drive=TorqueDrive(gain=1.0),
    friction=Friction(viscous=0.02, coulomb=0.02),
)
"""Of the rehearsal: p1 = 0.03725 kg m², p3 = 1.226 N m."""

ZERO = 0.7
"""Where the rehearsal's encoder stands when the joint hangs down, in rad."""

ENCODER = Encoder(steps=16384, noise=2e-4)
"""Of the rehearsal."""

_HEARTBEAT = 0.1  # s


class StandIn:
    """An axis that answers as the drive does, in simulated time.

    Parameters
    ----------
    joint
        What it turns.
    channel
        Of the virtual bus.
    node
        The axis's ``can.node_id``.
    period
        Between two estimates in s.
    encoder
        Reads the joint's angle.
    zero
        Where it stands when the joint hangs down, in rad.
    """

    def __init__(
        self,
        joint: Joint,
        channel: str,
        *,
        node: int,
        period: float,
        encoder: Encoder,
        zero: float,
    ) -> None:
        self._joint, self._node, self._period = joint, node, period
        self._encoder, self._zero = encoder, zero
        self._rng = np.random.default_rng(0)
        self._bus = VirtualBus(channel, preserve_timestamps=True)
        self._cycles = 0
        self.torque = 0.0
        self.state = AxisState.IDLE
        self.error = 0

    @property
    def time(self) -> float:
        """How long it has lived, in s."""
        return self._cycles * self._period

    def live(self) -> None:
        """Let one period pass: do what was told, turn the joint, say where it is."""
        while (message := self._bus.recv(0.0)) is not None:
            self.obey(Command(message.arbitration_id & 0x1F), bytes(message.data))
        is_driven = self.state == AxisState.CLOSED_LOOP_CONTROL
        self._joint.advance(self.torque if is_driven else 0.0, self._period)
        self._cycles += 1
        angle = self._encoder.read_one(self.time, self._joint.angle + self._zero, self._rng)
        if self._cycles % round(_HEARTBEAT / self._period) == 0:
            self.say(Command.HEARTBEAT, struct.pack("<IBxxx", self.error, self.state))
        self.say(Command.ENCODER_ESTIMATES, struct.pack("<ff", angle / math.tau, 0.0))

    def obey(self, command: Command, data: bytes) -> None:
        """Do what a message tells."""
        if command == Command.SET_INPUT_TORQUE:
            (self.torque,) = struct.unpack("<f", data)
        elif command == Command.SET_AXIS_STATE:
            self.state = AxisState(*struct.unpack("<I", data))

    def say(self, command: Command, data: bytes) -> None:
        """Send a message, stamped with the simulated time."""
        identifier = self._node << 5 | command
        message = can.Message(
            timestamp=self.time, arbitration_id=identifier, data=data, is_extended_id=False
        )
        self._bus.send(message)

    def shutdown(self) -> None:
        """Leave the bus."""
        self._bus.shutdown()


class WaitingBus(VirtualBus):
    """The program's end of the bus: while it waits for a message, the stand-in lives."""

    def __init__(self, channel: str, stand_in: StandIn) -> None:
        super().__init__(channel)
        self._stand_in = stand_in

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """Return the next message, or None after ``timeout`` s of simulated time."""
        end = math.inf if timeout is None else self._stand_in.time + timeout
        while (message := super().recv(0.0)) is None and self._stand_in.time < end:
            self._stand_in.live()
        return message

    def shutdown(self) -> None:
        """Leave the bus, both."""
        self._stand_in.shutdown()
        super().shutdown()


def rehearsal(*, node: int, period: float) -> WaitingBus:
    """Return a bus with a stand-in that turns `ROBOT`."""
    joint = GreyBoxJoint(ROBOT)
    stand_in = StandIn(joint, "rehearsal", node=node, period=period, encoder=ENCODER, zero=ZERO)
    return WaitingBus("rehearsal", stand_in)
