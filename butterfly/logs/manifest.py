"""Data-set manifests: which files, and what each experiment was."""

from __future__ import annotations

import os
import re
from dataclasses import replace
from enum import StrEnum
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Annotated, Any, Literal

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
from butterfly.logs.formats import ENDINGS, FORMATS, read_log
from butterfly.logs.health import DEFAULT_REPAIRS, Repair
from butterfly.logs.log import InputKind, Intersample, Log, Sine
from butterfly.model.known import Knowledge, Known, known_of, plain
from butterfly.model.parameters import GRAVITY, AddedMass, JointKind
from butterfly.yaml_input import StrictModel, read_yaml
from butterfly.yaml_output import yaml_text

if TYPE_CHECKING:
    from collections.abc import Mapping

MANIFEST_NAME = "manifest.yaml"
"""File that describes the logs of the folder it lies in."""

_THESIS_NAME = re.compile(r"Data_(\d+(?:_\d+)?)__(\d+(?:_\d+)?)__0(\d+)")
_SELDOM = {  # not written where it is as usual
    "sign": 1,
    "joint": "hinge",
    "gravity": GRAVITY,
    "known": {},
    "zeros": [],
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

    @property
    def excitation(self) -> Sine | None:
        """The sine that was commanded, if it was one."""
        if self.omega is None or self.amplitude is None:
            return None
        return Sine(omega=self.omega, amplitude=self.amplitude)


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
        variable.
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
    columns
        Column map of CSV files.
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
    columns: dict[str, str] | None = None
    repair: frozenset[Repair] = DEFAULT_REPAIRS
    split: Split | None = None
    holdout: list[str] = Field(default_factory=list)
    logs: Annotated[list[LogEntry], Field(min_length=1)]

    @model_validator(mode="after")
    def _arms_where_needed(self) -> Manifest:
        if self.joint is JointKind.HINGE and self.arm is None:
            for entry in self.logs:
                if entry.added_mass and entry.arm is None:
                    raise ValueError(f"arm, in m, since {entry.file} carries a mass")
        return self

    @model_validator(mode="after")
    def _known_names(self) -> Manifest:
        Knowledge.told(self.known)
        return self

    @model_validator(mode="after")
    def _zeros_of_masses(self) -> Manifest:
        carried = {known_of(entry.added_mass).value for entry in self.logs}
        for each in self.zeros:
            if each.added_mass not in carried:
                masses = ", ".join(f"{mass:g}" for mass in sorted(carried))
                raise ValueError(f"zeros of masses that logs carry: {masses} kg")
        return self

    @property
    def knowledge(self) -> Knowledge:
        """What is known of the robot."""
        return Knowledge.told(self.known)

    def knowing(self, known: Knowledge) -> Manifest:
        """Return the manifest of a robot of which more is known."""
        if not known:
            return self
        return self.model_copy(update={"known": self.knowledge.also(known).as_told()})

    def with_zero(self, zero: Known | None) -> Manifest:
        """Return the manifest with another encoder's zero of all logs, if one is given."""
        if zero is None:
            return self
        logs = [entry.model_copy(update={"zero": None}) for entry in self.logs]
        return self.model_copy(update={"zero": zero, "zeros": [], "logs": logs})

    def zero_of(self, entry: LogEntry) -> Known | None:
        """Return what is known of the encoder's zero in a log."""
        mass = known_of(entry.added_mass).value
        of_mass = (each.zero for each in self.zeros if each.added_mass == mass)
        told = next((each for each in (entry.zero, *of_mass, self.zero) if each is not None), None)
        return None if told is None else known_of(told)

    def added_mass(self, entry: LogEntry) -> AddedMass:
        """Return what the hand carried in a log."""
        mass = known_of(entry.added_mass)
        arm = known_of((self.arm if entry.arm is None else entry.arm) or 0.0)
        return AddedMass(
            mass=mass.value,
            arm=arm.value,
            mass_uncertainty=mass.uncertainty,
            arm_uncertainty=arm.uncertainty,
            gravity=self.gravity,
            joint=self.joint,
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


def manifest_from_names(
    folder: Path, *, arm: float, input_kind: InputKind, intersample: Intersample
) -> Manifest:
    """Generate a manifest from the thesis's file names, ``Data_<grams>__<rad/s>__<0amplitude>``.

    ``_`` stands for a decimal point within a number, and the amplitude's point follows its first
    0: ``Data_120_5__3_5__0015.mat`` is 120.5 g, 3.5 rad/s, 0.015. Subfolders are searched.

    Raises
    ------
    InputError
        If ``folder`` does not exist, holds no file of a known format, or one of another name.
    """
    if not folder.is_dir():
        raise InputError(folder, "path", "no such folder", "a folder of logs")
    entries = []
    for path in sorted(p for p in folder.rglob("*") if p.suffix.lower() in FORMATS):
        entry = _entry_by_name(path, folder)
        if entry is None:
            raise InputError(
                path, "file name", path.stem, "Data_<grams>__<rad/s>__<0amplitude>, or a manifest"
            )
        entries.append(entry)
    if not entries:
        raise InputError(folder, "path", f"no {ENDINGS} file", "a folder of logs")
    entries.sort(key=lambda entry: (known_of(entry.added_mass).value, entry.omega or 0.0))
    return Manifest(
        name=folder.resolve().name,
        root=str(folder.resolve()),
        input=input_kind,
        intersample=intersample,
        arm=arm,
        logs=entries,
    )


def manifest_of_log(
    path: Path,
    *,
    arm: float | None,
    input_kind: InputKind,
    intersample: Intersample,
    columns: Mapping[str, str] | None = None,
) -> Manifest:
    """Generate the manifest of one log; its name tells mass and sine, where it follows the pattern.

    Without an arm the added mass is not placed, and left out.
    """
    entry = _entry_by_name(path, path.parent) or LogEntry(file=path.name)
    if arm is None:
        entry = entry.model_copy(update={"added_mass": 0.0})
    return Manifest(
        name=path.name,
        root=str(path.parent.resolve()),
        input=input_kind,
        intersample=intersample,
        arm=arm,
        columns=None if columns is None else dict(columns),
        logs=[entry],
    )


def _entry_by_name(path: Path, folder: Path) -> LogEntry | None:
    """Read added mass and sine off a file name as the thesis forms it; None if it is another."""
    match = _THESIS_NAME.fullmatch(path.stem)
    if match is None:
        return None
    grams, omega, digits = match.groups()
    return LogEntry(
        file=path.relative_to(folder).as_posix(),
        added_mass=float(grams.replace("_", ".")) / 1e3,
        omega=float(omega.replace("_", ".")),
        amplitude=float(f"0.{digits}"),
    )


def manifest_text(manifest: Manifest) -> str:
    """Return a manifest as YAML, one line per log."""
    told = manifest.model_dump(mode="json", exclude_none=True)
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
        "excitation": entry.excitation,
        "zero": manifest.zero_of(entry),
        "name": entry.file,
    }
    log = read_log(path, columns=manifest.columns, **properties)
    return log if manifest.sign == 1 else replace(log, input=-log.input)


def _expand_root(manifest_path: Path, root: str) -> Path:
    """Resolve ``root`` against the manifest's folder, environment variables filled in."""

    def expand(match: re.Match[str]) -> str:
        if match[1] not in os.environ:
            raise InputError(
                manifest_path,
                "root",
                root,
                f"${match[1]} to name the folder of the logs (or --root)",
            )
        return os.environ[match[1]]

    return (manifest_path.parent / _VARIABLE.sub(expand, root)).resolve()
