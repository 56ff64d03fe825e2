"""A simulated robot in place of a real one: a motor that any of its masses can be mounted on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from butterfly.errors import InputError
from butterfly.logs.log import InputKind
from butterfly.model.parameters import AddedMass
from butterfly.plant.motor import Reading
from butterfly.plant.rig import Rig, SimulatedMotor


class SimulatedRobot:
    """The motor of a rig (see `butterfly.plant.motor.Motor`), its noise from ``rng``."""

    def __init__(self, rig: Rig, mass: AddedMass, rng: np.random.Generator) -> None:
        if rig.servo is not None:
            expected = "a plant without a loop: a campaign commands the drive directly"
            raise InputError("campaign", "plant.loop", rig.servo.law, expected)
        self._rig, self._rng = replace(rig, run_in=0.0), rng
        self.carry(mass)

    def carry(self, mass: AddedMass) -> None:
        """Mount a mass, at rest."""
        self._motor = SimulatedMotor(
            self._rig.joint(mass),
            path=self._rig.path,
            encoder=self._rig.encoder,
            clock=self._rig.clock,
            rng=self._rng,
        )

    @property
    def input_kind(self) -> InputKind:
        """Kind of the command."""
        return self._motor.input_kind

    def start(self) -> None:
        """Put the joint to rest at time 0."""
        self._motor.start()

    def stop(self) -> None:
        """Set the terminals to 0."""
        self._motor.stop()

    def command(self, value: float) -> float:
        """Set the command; return it as set."""
        return self._motor.command(value)

    def read(self) -> Reading:
        """Read the encoder."""
        return self._motor.read()

    def wait(self, duration: float) -> None:
        """Simulate ``duration`` s."""
        self._motor.wait(duration)
