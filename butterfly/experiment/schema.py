"""What an experiment file may say."""

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import Annotated

from pydantic import Field, model_validator

from butterfly.identify.identification import Method
from butterfly.logs.csv import read_columns
from butterfly.logs.log import InputKind, Sine
from butterfly.model.harmonic import predicted_swing
from butterfly.model.parameters import AddedMass, Drive, Friction, Hand, TorqueDrive, VoltageDrive
from butterfly.plant.excitations import (
    Chirp,
    Excitation,
    FreeDecay,
    Multisine,
    Prbs,
    SteppedSine,
    Table,
)
from butterfly.plant.mjcf import Robot
from butterfly.plant.motor import CommandPath
from butterfly.plant.sensors import Clock, Encoder, Faults
from butterfly.yaml_input import StrictModel, read_yaml

SMALL_SWING = 1.0
"""Swing in rad above which a sine is warned about: harmonics and jumps of the resonance set in."""


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
    path: CommandPath = CommandPath()
    faults: Faults = Faults()

    @property
    def robot(self) -> Robot:
        """The robot that is described."""
        return Robot(hand=self.hand, drive=self.drive.chosen, friction=self.friction)


class TableFile(StrictModel):
    """Columns of a CSV file: the instants in s, and the input held from each on."""

    path: Path
    time: str = "time"
    values: str = "input"


class SignalSpec(StrictModel):
    """An input other than a plain sine: exactly one of these."""

    stepped_sine: SteppedSine | None = None
    multisine: Multisine | None = None
    chirp: Chirp | None = None
    prbs: Prbs | None = None
    free_decay: FreeDecay | None = None
    table: Table | None = None
    file: TableFile | None = None

    @model_validator(mode="after")
    def _one_of_them(self) -> SignalSpec:
        if len(self._given()) != 1:
            raise ValueError("exactly one of the keys " + ", ".join(type(self).model_fields))
        return self

    def _given(self) -> list[str]:
        return [name for name in type(self).model_fields if getattr(self, name) is not None]

    def load(self, folder: Path) -> SignalSpec:
        """Return the spec with a file, which is relative to ``folder``, read into a table.

        Raises
        ------
        InputError
            If the file cannot be read.
        """
        if self.file is None:
            return self
        time, values = read_columns(folder / self.file.path, [self.file.time, self.file.values])
        table = Table(time=tuple(time.tolist()), values=tuple(values.tolist()))
        return SignalSpec(table=table)

    @property
    def excitation(self) -> Excitation:
        """The input that is described; a file must have been read by `load`."""
        return getattr(self, self._given()[0])  # type: ignore[no-any-return]


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
    added_masses
        What the hand carries, one after another.
    excitations, signals
        Sines, and other inputs. Only sines can be identified from.
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
    excitations: tuple[Sine, ...] = ()
    signals: tuple[SignalSpec, ...] = ()
    duration: Annotated[float, Field(gt=0)]
    method: Method = Method.HARMONIC_BALANCE

    @model_validator(mode="after")
    def _some_input(self) -> Experiment:
        if not (self.excitations or self.signals):
            raise ValueError("at least one of the keys excitations and signals")
        return self

    def runs(self) -> list[tuple[AddedMass, Excitation]]:
        """List what each run carries and is driven with."""
        inputs = [*self.excitations, *(signal.excitation for signal in self.signals)]
        return list(product(self.added_masses, inputs))

    def wide_swings(self) -> list[tuple[AddedMass, Sine, float]]:
        """List the runs whose sine is predicted to swing the hand beyond `SMALL_SWING`, in rad."""
        lumped = self.plant.robot.lumped
        predicted = [
            (
                added,
                sine,
                predicted_swing(lumped.with_added_mass(added), sine.omega, sine.amplitude),
            )
            for added, sine in product(self.added_masses, self.excitations)
        ]
        return [run for run in predicted if run[2] > SMALL_SWING]

    @property
    def input_kind(self) -> InputKind:
        """What the commands mean."""
        return InputKind.TORQUE if self.plant.drive.voltage is None else InputKind.VOLTAGE


def read_experiment(path: Path) -> Experiment:
    """Read an experiment file.

    Raises
    ------
    InputError
        If it does not follow the schema, or a file that it names cannot be read.
    """
    experiment = read_yaml(path, Experiment)
    signals = tuple(signal.load(path.parent) for signal in experiment.signals)
    return experiment.model_copy(update={"signals": signals})
