"""What an experiment file may say."""

from __future__ import annotations

from itertools import product
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


class DriveSpec(StrictModel):
    """A voltage-fed motor or a torque-controlled one: exactly one of the two."""

    voltage: VoltageDrive | None = None
    torque: TorqueDrive | None = None

    @model_validator(mode="after")
    def _one_of_them(self) -> DriveSpec:
        if (self.voltage is None) == (self.torque is None):
            raise ValueError("exactly one of the keys voltage and torque")
        return self

    @property
    def chosen(self) -> Drive:
        """The drive that is described."""
        drive = self.voltage or self.torque
        assert drive is not None  # noqa: S101 - the validator saw to it
        return drive


class PlantSpec(StrictModel):
    """The simulated robot with its controller's clock and encoder."""

    hand: Hand
    drive: DriveSpec
    friction: Friction = Friction()
    clock: Clock = Clock()
    encoder: Encoder = Encoder()

    @property
    def robot(self) -> Robot:
        """The robot that is described."""
        return Robot(hand=self.hand, drive=self.drive.chosen, friction=self.friction)


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
    added_masses: Annotated[list[AddedMass], Field(min_length=1)]
    excitations: Annotated[list[Sine], Field(min_length=1)]
    duration: Annotated[float, Field(gt=0)]
    method: Method = Method.HARMONIC_BALANCE

    def runs(self) -> list[tuple[AddedMass, Sine]]:
        """List what each run carries and is driven with."""
        return list(product(self.added_masses, self.excitations))

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
