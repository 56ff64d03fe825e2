"""What an experiment file may say."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from pydantic import Field, model_validator

from butterfly.identify.identification import Method
from butterfly.logs.log import InputKind, Sine
from butterfly.model.parameters import AddedMass, Drive, Friction, Hand, TorqueDrive, VoltageDrive
from butterfly.plant.mjcf import Robot
from butterfly.plant.sensors import Clock, Encoder
from butterfly.yaml_input import StrictModel, read_yaml

if TYPE_CHECKING:
    from pathlib import Path

Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]


class HandSpec(StrictModel):
    """Fields of `butterfly.model.parameters.Hand`."""

    mass: Positive
    com_distance: NonNegative
    inertia: Positive


class VoltageSpec(StrictModel):
    """Fields of `butterfly.model.parameters.VoltageDrive`."""

    resistance: Positive
    torque_constant: Positive
    back_emf_constant: NonNegative


class TorqueSpec(StrictModel):
    """Fields of `butterfly.model.parameters.TorqueDrive`."""

    gain: Positive


class DriveSpec(StrictModel):
    """A voltage-fed motor or a torque-controlled one: exactly one of the two."""

    voltage: VoltageSpec | None = None
    torque: TorqueSpec | None = None

    @model_validator(mode="after")
    def _one_of_them(self) -> DriveSpec:
        if (self.voltage is None) == (self.torque is None):
            raise ValueError("exactly one of the keys voltage and torque")
        return self

    def build(self) -> Drive:
        """Return the drive that is described."""
        if self.voltage is not None:
            return VoltageDrive(**self.voltage.model_dump())
        assert self.torque is not None  # noqa: S101 - the validator saw to it
        return TorqueDrive(**self.torque.model_dump())


class FrictionSpec(StrictModel):
    """Fields of `butterfly.model.parameters.Friction`."""

    viscous: NonNegative = 0.0
    coulomb: NonNegative = 0.0


class ClockSpec(StrictModel):
    """Fields of `butterfly.plant.sensors.Clock`."""

    step: Positive = 0.001
    jitter: NonNegative = 0.0


class EncoderSpec(StrictModel):
    """Fields of `butterfly.plant.sensors.Encoder`."""

    steps: Annotated[int, Field(ge=1)] = 32768
    noise: NonNegative = 0.0


class PlantSpec(StrictModel):
    """The simulated robot with its controller's clock and encoder."""

    hand: HandSpec
    drive: DriveSpec
    friction: FrictionSpec = FrictionSpec()
    clock: ClockSpec = ClockSpec()
    encoder: EncoderSpec = EncoderSpec()

    def robot(self) -> Robot:
        """Return the robot that is described."""
        return Robot(
            hand=Hand(**self.hand.model_dump()),
            drive=self.drive.build(),
            friction=Friction(**self.friction.model_dump()),
        )


class AddedMassSpec(StrictModel):
    """Fields of `butterfly.model.parameters.AddedMass`."""

    mass: NonNegative
    arm: NonNegative


class SineSpec(StrictModel):
    """Fields of `butterfly.logs.log.Sine`."""

    omega: Positive
    amplitude: Positive


class Experiment(StrictModel):
    """One experiment file: every added mass is driven with every excitation.

    Parameters
    ----------
    name, description
        For the report and the results folder.
    seed
        Fixes everything random.
    plant
        The simulated robot.
    added_masses, excitations
        What is combined.
    duration
        Of each run in s.
    method
        The estimator.
    """

    name: Annotated[str, Field(pattern=r"^[\w.-]+$")]
    description: str = ""
    seed: Annotated[int, Field(ge=0)] = 0
    plant: PlantSpec
    added_masses: Annotated[list[AddedMassSpec], Field(min_length=1)]
    excitations: Annotated[list[SineSpec], Field(min_length=1)]
    duration: Positive
    method: Method = Method.HARMONIC_BALANCE

    def runs(self) -> list[tuple[AddedMass, Sine]]:
        """List what each run carries and is driven with."""
        return [
            (AddedMass(**mass.model_dump()), Sine(**sine.model_dump()))
            for mass in self.added_masses
            for sine in self.excitations
        ]

    def clock(self) -> Clock:
        """Return the controller's clock."""
        return Clock(**self.plant.clock.model_dump())

    def encoder(self) -> Encoder:
        """Return the encoder."""
        return Encoder(**self.plant.encoder.model_dump())

    @property
    def input_kind(self) -> InputKind:
        """What the commands mean."""
        return InputKind.TORQUE if self.plant.drive.voltage is None else InputKind.VOLTAGE


def read_experiment(path: Path) -> Experiment:
    """Read an experiment file.

    Raises
    ------
    InputError
        If it does not follow the schema.
    """
    return read_yaml(path, Experiment)
