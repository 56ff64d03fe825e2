"""Data-set manifests: which files, and what each experiment was."""

from __future__ import annotations

import os
import re
from enum import StrEnum
from pathlib import Path, PurePath
from typing import Annotated, Any, Literal

from pydantic import (
    BeforeValidator,
    ConfigDict,
    Field,
    PlainSerializer,
    field_validator,
    model_validator,
)

from butterfly.errors import InputError
from butterfly.files import replacing
from butterfly.logs import thesis_logs
from butterfly.logs.formats import read_log
from butterfly.logs.health import DEFAULT_REPAIRS, Repair
from butterfly.logs.log import InputKind, Intersample, Log, Sine
from butterfly.logs.units import Units
from butterfly.model.known import Knowledge, Known, known_of, plain
from butterfly.model.parameters import GRAVITY, AddedMass, JointKind, rounded
from butterfly.yaml_input import StrictModel, read_yaml
from butterfly.yaml_output import yaml_text

MANIFEST_NAME = "manifest.yaml"
"""File that describes the logs of the folder it lies in."""

_SELDOM = {  # not written where it is as usual
    "sign": 1,
    "joint": "hinge",
    "gravity": GRAVITY,
    "known": {},
    "zeros": [],
    "units": {},
    "holdout": [],
}
_VARIABLE = re.compile(r"\$\{(\w+)\}")


def _read_known(value: Any) -> Known:  # noqa: ANN401 - whatever YAML holds
    if not isinstance(value, Known | dict | str):
        raise ValueError("a number, or {value: ..., uncertainty: ...}")
    return known_of(value)


Told = float | Annotated[Known, BeforeValidator(_read_known), PlainSerializer(plain)]
"""A number, or {value: ..., uncertainty: ...}."""

Size = (
    Annotated[float, Field(ge=0)]
    | Annotated[Known, BeforeValidator(_read_known), PlainSerializer(plain)]
)
"""The same, not negative."""


class Split(StrEnum):
    """Where a file is cut into several logs."""

    RESTARTS = "restarts"


class LogEntry(StrictModel):
    """One file of a data set, or a piece of one.

    Parameters
    ----------
    file
        Path below the data set's root.
    added_mass
        In kg, with or without an uncertainty.
    arm
        In m, with or without an uncertainty; the data set's own ``arm`` if not given.
    omega, amplitude
        Of the sine that was commanded, in rad/s and in units of the input; neither for any other
        input.
    zero
        What the encoder reads in rad where the hand hangs, with or without an uncertainty, if it is
        known of this log by itself.
    begin, end
        Called ``from`` and ``to``: first and last instant in s of the piece that is meant, by the
        file's own clock.
    part
        Which of the recordings that were put together in the file is meant, from 1 on: one ends
        where the clock falls back.
    split
        ``restarts``: each of these recordings is a log.
    """

    model_config = ConfigDict(
        validate_by_name=True, validate_by_alias=True, serialize_by_alias=True
    )

    file: str
    added_mass: Size = 0.0
    arm: Size | None = None
    omega: Annotated[float, Field(gt=0)] | None = None
    amplitude: Annotated[float, Field(gt=0)] | None = None
    zero: Told | None = None
    begin: Annotated[float | None, Field(alias="from")] = None
    end: Annotated[float | None, Field(alias="to")] = None
    part: Annotated[int, Field(ge=1)] | None = None
    split: Split | None = None

    @field_validator("file")
    @classmethod
    def _below_the_root(cls, value: str) -> str:
        if PurePath(value).is_absolute() or ".." in PurePath(value).parts:
            raise ValueError("a path below the data set's root")
        return value

    @model_validator(mode="after")
    def _a_whole_sine(self) -> LogEntry:
        if (self.omega is None) != (self.amplitude is None):
            raise ValueError("omega and amplitude together, or neither")
        return self

    @model_validator(mode="after")
    def _a_piece(self) -> LogEntry:
        if self.split and (self.part, self.begin, self.end) != (None, None, None):
            raise ValueError("split, or from, to and part, not both")
        if self.begin is not None and self.end is not None and not self.begin < self.end:
            raise ValueError("from before to")
        return self


class MassZero(StrictModel):
    """The encoder's zero in the logs with one added mass.

    Parameters
    ----------
    added_mass
        In kg, as the logs say it.
    zero
        What the encoder reads in rad where the hand hangs, with or without an uncertainty.
    """

    added_mass: Annotated[float, Field(ge=0)]
    zero: Told


class Manifest(StrictModel):
    """A data set: its files and what they have in common.

    Parameters
    ----------
    name, description
        For reports.
    root
        Folder of the files, relative to the manifest; ``${NAME}`` stands for an environment
        variable, and a folder that begins with one is relative to where the command runs.
    input
        What the input column commands.
    intersample
        How the command is held between its samples.
    sign
        -1 where a positive command turns the hand towards negative angles: the input is negated.
    arm
        Pivot to added mass in m, with or without an uncertainty; needed where a mass is added to a
        hinge.
    joint
        ``hinge``, or ``slide``, whose way is in m, and whose parameters are masses and forces.
    gravity
        In m/s^2, across the joint's axis; 0 for a joint that turns about the vertical.
    known
        What is known of the robot: parameters of the model, of motor and hand, each a number or
        ``{value: ..., uncertainty: ...}`` (see `butterfly.model.known`).
    zero
        What the encoder reads in rad where the hand hangs, with or without an uncertainty; found
        from the logs if not given. What a log says of its own goes before what ``zeros`` say, and
        that before this.
    zeros
        The same for single added masses.
    units
        Units of the columns, and of ``mass``, ``arm`` and ``omega`` (see `butterfly.logs.units`).
    columns
        What holds time, input and angle: columns of a table or variables of a .mat file, by name
        or number.
    repair
        Repairs that may be made (see `butterfly.logs.health.Repair`).
    split
        ``restarts``: files in which the clock falls back are several recordings put together, and
        each is a log, unless an entry says which piece is meant.
    holdout
        Files, or glob patterns of them, that are not used for a fit, only to be foretold by it.
    logs
        The files.
    """

    name: str
    description: str = ""
    root: str = "."
    input: InputKind
    intersample: Intersample = Intersample.ZERO_ORDER_HOLD
    sign: Literal[1, -1] = 1
    arm: Size | None = None
    joint: JointKind = JointKind.HINGE
    gravity: Annotated[float, Field(ge=0)] = GRAVITY
    known: dict[str, Told] = Field(default_factory=dict)
    zero: Told | None = None
    zeros: list[MassZero] = Field(default_factory=list)
    units: dict[str, str | float] = Field(default_factory=dict)
    columns: dict[str, str | int] | None = None
    repair: frozenset[Repair] = DEFAULT_REPAIRS
    split: Split | None = None
    holdout: list[str] = Field(default_factory=list)
    logs: Annotated[list[LogEntry], Field(min_length=1)]

    @model_validator(mode="after")
    def _arms_where_needed(self) -> Manifest:
        if self.joint is JointKind.HINGE and self.arm is None:
            for entry in self.logs:
                if known_of(entry.added_mass).value and entry.arm is None:
                    raise ValueError(f"arm, in m, since {entry.file} carries a mass")
        return self

    @model_validator(mode="after")
    def _known_names(self) -> Manifest:
        Knowledge.told(self.known)
        return self

    @model_validator(mode="after")
    def _known_units(self) -> Manifest:
        Units.told(self.units)
        return self

    @model_validator(mode="after")
    def _zeros_of_masses(self) -> Manifest:
        carried = {rounded(known_of(entry.added_mass).value) for entry in self.logs}
        for each in self.zeros:
            if rounded(each.added_mass) not in carried:
                masses = ", ".join(f"{mass:g}" for mass in sorted(carried))
                raise ValueError(f"zeros of masses that logs carry: {masses} kg")
        return self

    @property
    def scale(self) -> Units:
        """What makes the project's own units of the manifest's numbers and the files' columns."""
        return Units.told(self.units).with_sign(self.sign)

    @property
    def knowledge(self) -> Knowledge:
        """What is known of the robot."""
        return Knowledge.told(self.known)

    def knowing(self, known: Knowledge) -> Manifest:
        """Return the manifest of a robot of which more is known."""
        if not known:
            return self
        both = self.knowledge.also(known)
        return self.model_copy(update={"known": {**both.parameters, **both.physical}})

    def moving(self, joint: JointKind | None, gravity: float | None) -> Manifest:
        """Return the manifest of a joint that moves otherwise, as far as that is said."""
        said = {"joint": joint, "gravity": gravity}
        return self.model_copy(
            update={name: each for name, each in said.items() if each is not None}
        )

    def with_zero(self, zero: Known | None) -> Manifest:
        """Return the manifest with another encoder's zero of all logs, if one is given."""
        if zero is None:
            return self
        logs = [entry.model_copy(update={"zero": None}) for entry in self.logs]
        return self.model_copy(update={"zero": zero, "zeros": [], "logs": logs})

    def zero_of(self, entry: LogEntry) -> Known | None:
        """Return what is known of the encoder's zero in a log."""
        mass = rounded(known_of(entry.added_mass).value)
        of_mass = (each.zero for each in self.zeros if rounded(each.added_mass) == mass)
        told = next((each for each in (entry.zero, *of_mass, self.zero) if each is not None), None)
        return None if told is None else known_of(told)

    def added_mass(self, entry: LogEntry) -> AddedMass:
        """Return what the hand carried in a log."""
        mass = known_of(entry.added_mass)
        arm = known_of((self.arm if entry.arm is None else entry.arm) or 0.0)
        of_mass, of_arm = map(self.scale.factor, ("mass", "arm"))
        return AddedMass(
            mass=of_mass * mass.value,
            arm=of_arm * arm.value,
            mass_uncertainty=of_mass * mass.uncertainty,
            arm_uncertainty=of_arm * arm.uncertainty,
            gravity=self.gravity,
            joint=self.joint,
        )

    def excitation(self, entry: LogEntry) -> Sine | None:
        """Return the sine that was commanded in a log, if it was one; its amplitude is positive."""
        if entry.omega is None or entry.amplitude is None:
            return None
        return Sine(
            omega=self.scale.factor("omega") * entry.omega,
            amplitude=abs(self.scale.factor("input")) * entry.amplitude,
        )


def read_manifest(path: Path, root: Path | None = None) -> Manifest:
    """Read a manifest file, with its root resolved to an absolute folder.

    Parameters
    ----------
    path
        The manifest.
    root
        Folder of the logs, in place of the one that the manifest names.

    Raises
    ------
    InputError
        If the file does not follow the schema, or ``root`` names an unset variable or no folder.
    """
    manifest = read_yaml(path, Manifest)
    folder = _expand_root(path, manifest.root) if root is None else root.absolute()
    if not folder.is_dir():
        raise InputError(path, "root", folder, "an existing folder")
    return manifest.model_copy(update={"root": str(folder)})


def manifest_text(manifest: Manifest) -> str:
    """Return a manifest as YAML, one line per log."""
    told = manifest.model_dump(mode="json", exclude_none=True)
    told["repair"].sort()  # a set has no order, a file should have one
    head = {
        name: value
        for name, value in told.items()
        if name != "logs" and (name not in _SELDOM or value != _SELDOM[name])
    }
    rows = [f"  - {yaml_text(entry, flow=True)}" for entry in told["logs"]]
    return "".join([yaml_text(head), "logs:\n", *rows])


def write_manifest(manifest: Manifest, path: Path) -> None:
    """Write a manifest as YAML."""
    with replacing(path) as draft:
        draft.write_text(manifest_text(manifest), encoding="utf-8")


def read_entry(manifest: Manifest, entry: LogEntry) -> Log:
    """Read the whole file of a log (see `butterfly.logs.pieces` for pieces of it).

    Raises
    ------
    InputError
        If its file cannot be read (see `read_log`).
    """
    path = Path(manifest.root) / entry.file
    properties = {
        "input_kind": manifest.input,
        "intersample": manifest.intersample,
        "added_mass": manifest.added_mass(entry),
        "excitation": manifest.excitation(entry),
        "zero": manifest.zero_of(entry),
        "name": entry.file,
    }
    return read_log(path, columns=manifest.columns, units=manifest.scale, **properties)


def _expand_root(manifest_path: Path, root: str) -> Path:
    """Resolve ``root``, environment variables filled in.

    It is relative to the manifest's folder; what begins with a variable, to where the command runs.
    """

    def expand(match: re.Match[str]) -> str:
        of_thesis = match[1] == thesis_logs.VARIABLE
        folder = thesis_logs.found_folder() if of_thesis else os.environ.get(match[1])
        if folder is None:
            expected = f"${match[1]} to name the folder of the logs (or --root)"
            fetched = "the logs: run `butterfly logs fetch`; or " if of_thesis else ""
            raise InputError(manifest_path, "root", root, fetched + expected)
        return str(folder)

    base = Path() if _VARIABLE.match(root) else manifest_path.parent
    return (base / _VARIABLE.sub(expand, root)).resolve()
