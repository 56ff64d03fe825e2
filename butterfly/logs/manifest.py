"""Data-set manifests: the one list of facts about data.

A YAML file, the options of a command and the keywords of `butterfly.read` each set some fields of
`Manifest`; `described` merges and checks them.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping, Sequence
from enum import Enum, StrEnum
from functools import cache
from pathlib import Path, PurePath
from typing import Annotated, Any, Literal

from pydantic import (
    BeforeValidator,
    ConfigDict,
    Field,
    PlainSerializer,
    PositiveFloat,
    create_model,
    field_validator,
    model_validator,
)

from butterfly.errors import InputError
from butterfly.files import require_path, write_file
from butterfly.logs import thesis_logs
from butterfly.logs.formats import column_names, unsaid
from butterfly.logs.health import DEFAULT_REPAIRS, Repair
from butterfly.logs.log import InputKind, Intersample, Sine
from butterfly.logs.model_facts import STILL, LinkMasses, ModelFacts
from butterfly.logs.motors import with_motor
from butterfly.logs.units import Units
from butterfly.model.parameters import GRAVITY, AddedMass, JointKind, rounded
from butterfly.model.prior import Known, Prior, known_of, plain
from butterfly.model.servo import LAWS, ServoLoop
from butterfly.yaml_files import Document, StrictModel, load_yaml, validate, yaml_text

MANIFEST_NAME = "manifest.yaml"
"""File that describes the logs of its folder."""

_VARIABLE = re.compile(r"\$\{(\w+)\}")


def _read_known(value: Any) -> Known:  # noqa: ANN401 - whatever was given
    if not isinstance(value, Known | dict | str | tuple):
        raise ValueError("a number, or {value: ..., uncertainty: ...}")
    return known_of(value)


def _checked(check: Callable[[Any], object]) -> BeforeValidator:
    """Return what refuses the values that a check refuses, and keeps others as they are."""
    return BeforeValidator(lambda values: (check(values), values)[1])


def _read_loop(values: Any) -> Any:  # noqa: ANN401 - whatever was given
    """Return the facts about a loop, checked, their numbers as numbers."""
    if not isinstance(values, Mapping):
        return values
    if "law" in values:
        ServoLoop.of(values, whole=False)
    return {
        name: plain(known_of(value, "loop", name))
        if isinstance(value, str) and name != "law"
        else value
        for name, value in values.items()
    }


def _read_values(given: Any) -> Any:  # noqa: ANN401 - whatever was given
    """Return known values, those of a motor that they name among them, checked."""
    values = with_motor(given) if isinstance(given, Mapping) else given
    Prior.of(values)
    return values


LoopFacts = Annotated[dict[str, Any], BeforeValidator(_read_loop)]
"""Facts about a servo loop."""

_Known = Annotated[Known, BeforeValidator(_read_known), PlainSerializer(plain)]

Uncertain = float | _Known
"""A number, or {value: ..., uncertainty: ...}."""

Size = Annotated[float, Field(ge=0)] | _Known
"""The same, not negative."""

KnownValues = Annotated[dict[str, Uncertain], BeforeValidator(_read_values)]
"""Known values of a robot by name; ``from`` names a motor whose values are taken."""


class Recordings(StrEnum):
    """Where a file is split into several logs."""

    RESTARTS = "restarts"


class LogEntry(StrictModel):
    """One file of a data set, or a piece of one."""

    model_config = ConfigDict(
        validate_by_name=True, validate_by_alias=True, serialize_by_alias=True
    )

    file: str
    """Path below the data set's root."""
    at: str | None = None
    """Place within a file of several logs: keys with dots (JSON, MATLAB), a sheet, an array."""
    columns: dict[str, str | int] | None = None
    """Of this log, in place of those of the data set."""
    units: Annotated[dict[str, str | float] | None, _checked(Units.of)] = None
    """Of this log, where they differ from the data set's."""
    interval: PositiveFloat | None = None
    """Of this log, in place of that of the data set."""
    added_mass: Size = 0.0
    """In kg, with or without an uncertainty."""
    arm: Size | None = None
    """In m; default: that of the data set."""
    inertia: Annotated[float, Field(ge=0)] | None = None
    """Of the added mass about its own centre, in kg m^2; m r^2/2 for a disc of radius r."""
    omega: PositiveFloat | None = None
    """Of a commanded sine, in rad/s."""
    amplitude: PositiveFloat | None = None
    """Of that sine, in units of the input; set both or neither."""
    input: Literal[InputKind.NONE] | None = None
    """``none`` if nothing drove the joint in this log; it needs no input column."""
    zero: Uncertain | None = None
    """Encoder zero of this log: the reading in rad where the joint hangs at rest, if known."""
    loop: LoopFacts | None = None
    """Of the servo, where this log differs from the data set: gains, supply."""
    begin: Annotated[float | None, Field(alias="from")] = None
    """Start in s of the piece to use, on the clock of the file."""
    end: Annotated[float | None, Field(alias="to")] = None
    """End in s of the piece to use."""
    of: str | None = None
    """Name of the joint that this log moves, in the ``model``."""
    pose: dict[str, float] | None = None
    """Positions of the other joints of the ``model`` in this log, in rad or m."""
    neighbours: dict[str, str | int] | None = None
    """Columns of the positions of other joints of the ``model``, by joint."""
    part: Annotated[int, Field(ge=1)] | None = None
    """Number of the recording in the file, from 1; a recording ends where the clock falls back."""
    split: Recordings | None = None
    """``restarts``: each of these recordings is a log."""

    @classmethod
    def carrying(cls, file: str, added: AddedMass, sine: Sine | None = None) -> LogEntry:
        """Return the entry of a log with an added mass, driven by a sine if given."""
        return cls(
            file=file,
            added_mass=Known(value=added.mass, uncertainty=added.mass_uncertainty),
            arm=Known(value=added.arm, uncertainty=added.arm_uncertainty) if added.arm else None,
            inertia=added.own_inertia or None,
            omega=sine.omega if sine else None,
            amplitude=sine.amplitude if sine else None,
        )

    @field_validator("file")
    @classmethod
    def _below_the_root(cls, value: str) -> str:
        if PurePath(value).is_absolute() or ".." in PurePath(value).parts:
            raise ValueError("a path below the data set's root")
        try:
            require_path(value, "manifest", "file")
        except InputError as error:
            raise ValueError(error.expected) from None
        return value

    @model_validator(mode="after")
    def _a_whole_sine_and_a_piece(self) -> LogEntry:
        if (self.omega is None) != (self.amplitude is None):
            raise ValueError("omega and amplitude together, or neither")
        if self.split and (self.part, self.begin, self.end) != (None, None, None):
            raise ValueError("either split, or from, to and part")
        if self.begin is not None and self.end is not None and not self.begin < self.end:
            raise ValueError("from less than to")
        return self


class MassZero(StrictModel):
    """The encoder's zero in the logs with one added mass."""

    added_mass: Annotated[float, Field(ge=0)]
    """In kg, as in the logs."""
    zero: Uncertain
    """In rad."""


class _Rule(Enum):
    """What an option or keyword does to a field of the manifest; by default it replaces it."""

    FILLS = "only if the manifest does not set it"
    ADDS = "added to the manifest, with precedence"


class Manifest(StrictModel):
    """A data set: its files and what they have in common.

    A new fact is a field here, and its use. Its rule says what an option does to the field.
    """

    name: str
    description: str = ""
    root: str = "."
    """Folder of the files, relative to the manifest; ``${NAME}`` is an environment variable. A path
    that begins with one is relative to the working directory."""
    input: Annotated[InputKind, _Rule.FILLS]
    """Kind of input. ``voltage``, ``torque``, ``current``, ``duty``, the ``setpoint`` of a servo
    (see ``loop``), or ``none`` if the joint swings freely."""
    loop: Annotated[LoopFacts, _Rule.ADDS] = Field(default={})
    """Control loop of a servo: its ``law`` and gains. See `butterfly.model.servo`."""
    intersample: Annotated[Intersample | None, _Rule.FILLS] = None
    """Input between its samples: ``zero_order_hold`` (held until the next) or ``first_order_hold``
    (straight lines). If it is not given, both are compared; it is held if no log shows a
    difference."""
    sign: Literal[1, -1] = 1
    """-1 if a positive command turns the joint towards negative angles: the input is negated."""
    arm: Annotated[Size | None, _Rule.FILLS] = None
    """Distance from pivot to added mass in m. An added mass on a hinge requires it."""
    joint: JointKind = JointKind.HINGE
    """``hinge`` or ``slide``, whose angle is in m and p1 in kg."""
    shape: Literal["bar", "butterfly"] = "bar"
    """Shape in pictures and exported models: a plain bar, or the Butterfly robot's hand."""
    gravity: Annotated[float, Field(ge=0)] = GRAVITY
    """Gravity in m/s^2, perpendicular to the axis; 0 for a vertical axis."""
    model: str | None = None
    """MJCF or URDF of the robot whose joint the logs move."""
    of: str | None = None
    """Name of the joint in that model."""
    pose: Annotated[dict[str, float], _Rule.ADDS] = Field(default={})
    """Positions of the model's other joints in rad or m. Default: their columns, its keyframe."""
    clamped: bool = False
    """Whether that model's joints without columns are clamped."""
    link_masses: LinkMasses = LinkMasses()
    """Uncertainty of that model's masses: 5 % (0.05), one factor for all."""
    facts: ModelFacts | None = None
    """What the model says of the joint; read from it."""
    encoder: Literal["joint", "motor"] = "joint"
    """``motor`` if angle, velocity, setpoint and the loop's gains are on the motor side of a gear,
    whose ``gear_ratio`` must be ``known``."""
    known: Annotated[KnownValues, _Rule.ADDS] = Field(default={})
    """Known values of the robot, with standard uncertainties. ``from`` names a motor whose values
    are taken (`butterfly.logs.motors`). See `butterfly.model.prior`."""
    zero: Uncertain | None = None
    """Encoder zero: the reading in rad where the joint hangs at rest. Estimated if not given."""
    zeros: list[MassZero] = Field(default_factory=list)
    """Encoder zero per added mass; overrides ``zero``, and a log's own zero overrides both."""
    units: Annotated[dict[str, str | float], _checked(Units.of), _Rule.ADDS] = Field(default={})
    """Units of the columns, ``mass``, ``arm`` and ``omega``, or factors. See
    `butterfly.logs.units`."""
    columns: dict[str, str | int] | None = None
    """Columns (or variables) of time, input and angle, by name or number."""
    interval: PositiveFloat | None = None
    """Sampling interval in s of logs without a column of time."""
    repair: Annotated[frozenset[Repair], _Rule.ADDS] = DEFAULT_REPAIRS
    """Faults to repair."""
    split: Recordings | None = None
    """Split a file where its clock ``restarts``."""
    holdout: Annotated[list[str], _Rule.ADDS] = Field(default_factory=list)
    """Files, or glob patterns of them, held out from fits for testing."""
    logs: Annotated[list[LogEntry], Field(min_length=1)]
    """The files."""

    @model_validator(mode="after")
    def _arms_loops_and_zeros(self) -> Manifest:
        if self.joint is JointKind.HINGE and self.arm is None:
            for entry in self.logs:
                if known_of(entry.added_mass).value and entry.arm is None:
                    expected = f"arm in m, since {entry.file} has an added mass"
                    raise InputError("manifest", "arm", "nothing", expected)
        for entry in self.logs:
            kind = entry.input or self.input
            if kind is InputKind.SETPOINT and "law" not in self.loop_of(entry):
                expected = (
                    f"the servo's law for a setpoint, one of {', '.join(LAWS)}: such as --loop "
                    "law=dynamixel-x,kp=400, or loop: {law: dynamixel-x, kp: 400}"
                )
                raise InputError(entry.file, "loop.law", "nothing", expected)
        carried = {rounded(known_of(entry.added_mass).value) for entry in self.logs}
        for zero in self.zeros:
            if rounded(zero.added_mass) not in carried:
                masses = ", ".join(f"{mass:g}" for mass in sorted(carried))
                raise ValueError(f"zeros of the logs' added masses: {masses} kg")
        return self

    def scale(self, entry: LogEntry) -> Units:
        """Return the factors from the units of a log's columns and numbers to the project's own."""
        return Units.of({**self.units, **(entry.units or {})}).with_sign(self.sign)

    @property
    def turns(self) -> float:
        """Turns of the encoder per turn of the joint; InputError if unknown."""
        if self.encoder == "joint":
            return 1.0
        ratio = self.prior.physical.get("gear_ratio")
        if ratio is None:
            raise InputError(self.name, "known.gear_ratio", "nothing", "the gear ratio")
        return ratio.value

    @property
    def prior(self) -> Prior:
        """Known values of the robot."""
        return Prior.of(self.known)

    def knowing(self, known: Prior) -> Manifest:
        """Return the manifest with more known values."""
        if not known:
            return self
        return self.model_copy(update={"known": (self.prior | known).values})

    def with_zero(self, zero: Known) -> Manifest:
        """Return the manifest with one encoder zero for all logs."""
        logs = [entry.model_copy(update={"zero": None}) for entry in self.logs]
        return self.model_copy(update={"zero": zero, "zeros": [], "logs": logs})

    def piece(self, begin: float | None, end: float | None) -> Manifest:
        """Return the manifest of the piece between two times in s of its single, whole log."""
        if begin is None and end is None:
            return self
        name, value = ("to", end) if begin is None else ("from", begin)
        (entry, *others) = self.logs
        if others or self.split or (entry.begin, entry.end) != (None, None):
            expected = "a single, whole log (for several, set from and to of each in a manifest)"
            raise InputError("data", name, value, expected)
        if begin is not None and end is not None and not begin < end:
            raise InputError("data", "from", begin, f"less than to, {end:g} s")
        piece = entry.model_copy(update={"begin": begin, "end": end, "split": None})
        return self.model_copy(update={"logs": [piece]})

    def loop_of(self, entry: LogEntry) -> dict[str, Any]:
        """Return the facts about the servo in a log."""
        return self.loop | (entry.loop or {})

    def zero_of(self, entry: LogEntry) -> Known | None:
        """Return the encoder zero of a log, if known."""
        mass = rounded(known_of(entry.added_mass).value)
        of_mass = (zero.zero for zero in self.zeros if rounded(zero.added_mass) == mass)
        given = next((zero for zero in (entry.zero, *of_mass, self.zero) if zero is not None), None)
        return None if given is None else known_of(given)

    def added_mass(self, entry: LogEntry) -> AddedMass:
        """Return the added mass of a log."""
        mass = known_of(entry.added_mass)
        arm = known_of((self.arm if entry.arm is None else entry.arm) or 0.0)
        of_mass, of_arm = map(self.scale(entry).factor, ("mass", "arm"))
        return AddedMass(
            mass=of_mass * mass.value,
            arm=of_arm * arm.value,
            own_inertia=entry.inertia or 0.0,
            mass_uncertainty=of_mass * mass.uncertainty,
            arm_uncertainty=of_arm * arm.uncertainty,
            gravity=self.gravity,
            joint=self.joint,
            label=self._pose_label(entry),
        )

    def _pose_label(self, entry: LogEntry) -> str:
        """Return how the pose of a log is called, where logs have different ones."""
        if self.facts is None or len(self.facts.poses) < 2 or not entry.pose:  # noqa: PLR2004 - two
            return ""
        first = self.facts.poses[0].pose
        moved = {
            name: angle
            for name, angle in entry.pose.items()
            if any(abs(pose.pose[name] - first[name]) > STILL for pose in self.facts.poses)
        }
        return "pose " + ", ".join(f"{name} {angle:.3g}" for name, angle in moved.items())

    def excitation(self, entry: LogEntry) -> Sine | None:
        """Return the commanded sine of a log, if any; its amplitude is positive."""
        if entry.omega is None or entry.amplitude is None:
            return None
        return Sine(
            omega=self.scale(entry).factor("omega") * entry.omega,
            amplitude=abs(self.scale(entry).factor("input")) * entry.amplitude,
        )

    def properties(self, entry: LogEntry) -> dict[str, Any]:
        """Return the fields of `Log` that its file does not contain, its interval and place."""
        return {
            **({} if entry.at is None else {"at": entry.at}),
            "interval": entry.interval or self.interval,
            "input_kind": entry.input or self.input,
            "intersample": self.intersample,
            "added_mass": self.added_mass(entry),
            "excitation": self.excitation(entry),
            "zero": self.zero_of(entry),
            "servo": ServoLoop.of(loop, entry.file) if (loop := self.loop_of(entry)) else None,
        }


_SELDOM = (
    *("shape", "sign", "loop", "encoder", "joint", "gravity", "known", "zeros", "units", "holdout"),
    *("pose", "clamped", "link_masses"),
)
"""Fields that are not written at their default."""


@cache
def _options() -> type[StrictModel]:
    """Return the model of some fields of a manifest, and of ``from`` and ``to``; slow to make."""
    fields: dict[str, Any] = {
        name: (Annotated[field.annotation, Field(), *field.metadata], None)
        for name, field in Manifest.model_fields.items()
        if name not in {"logs", "root"}
    } | dict.fromkeys(("from", "to"), (float | None, None))
    return create_model("_Options", __base__=StrictModel, **fields)


def checked_options(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options or keywords that are not None, checked: fields, from and to."""
    some = {name: value for name, value in given.items() if value is not None}
    options = validate([], some, _options(), source="data")
    return {name: getattr(options, name) for name in some}


def described(
    content: Mapping[str, Any],
    given: Mapping[str, Any],
    documents: Sequence[Document] = (),
    source: object = "data",
) -> Manifest:
    """Return the manifest of a file's content and of what `checked_options` returned.

    The options replace the content, except in fields marked with a `_Rule`. A zero applies to all
    logs. ``from`` and ``to`` are applied later, by `Manifest.piece`.
    """
    both = dict(content)
    for name in given.keys() - {"from", "to", "zero"}:
        field = Manifest.model_fields[name]
        if name not in content or not set(field.metadata) & set(_Rule):
            both[name] = given[name]
        if _Rule.ADDS in field.metadata:
            value: Any = content.get(name, field.get_default(call_default_factory=True))
            if isinstance(value, Mapping):
                both[name] = {**value, **given[name]}
            elif isinstance(value, list | frozenset):  # another value is wrong, to be refused
                both[name] = [*value, *given[name]]
    manifest = validate(documents, both, Manifest, source=source)
    return manifest.with_zero(known_of(given["zero"])) if "zero" in given else manifest


def read_manifest(
    path: Path, root: Path | None = None, given: Mapping[str, Any] | None = None
) -> Manifest:
    """Read a manifest with absolute root, or ``root``; ``given`` is from `checked_options`."""
    document = load_yaml(path)
    manifest = described(document.content, given or {}, [document])
    folder = _expand_root(path, manifest.root) if root is None else root.absolute()
    if not folder.is_dir():
        raise InputError(path, "root", folder, "an existing folder")
    return manifest.model_copy(update={"root": str(folder)})


def require_columns(path: Path, manifest: Manifest) -> None:
    """Refuse the manifest in a file if it leaves a column to be chosen from those of a log."""
    for entry in manifest.logs:
        columns = manifest.columns if entry.columns is None else entry.columns
        about = {
            "interval": entry.interval or manifest.interval,
            "input_kind": entry.input or manifest.input,
        }
        if lacking := [] if columns is None else unsaid(columns, about):
            names = columns_of_entry(manifest, entry)
            which = f"one of the columns of {entry.file}, by name or by number from 0"
            expected = f"{which}: {', '.join(map(repr, names))}" if names else which
            fields = ", ".join(f"columns.{field}" for field in lacking)
            raise InputError(path, fields, "nothing", expected)


def columns_of_entry(manifest: Manifest, entry: LogEntry) -> list[str]:
    """Return the names of the columns of a log; none if it has none."""
    place = {"at": entry.at} if entry.at else {}
    return column_names(Path(manifest.root) / entry.file, **place)


def own_units(kind: InputKind) -> dict[str, str | float]:
    """Return the unit of a hinge's input as this program records it, for ``units``."""
    units = {
        quantity: quantity.unit
        for quantity in (InputKind.VOLTAGE, InputKind.CURRENT, InputKind.DUTY)
    }
    units[InputKind.TORQUE] = "Nm"
    return {"input": units[kind]} if kind in units else {}


def manifest_text(manifest: Manifest) -> str:
    """Return a manifest as YAML, one line per log."""
    content = manifest.model_dump(mode="json", exclude_none=True)
    content["repair"].sort()  # a set has no order, a file should have one
    defaults = Manifest.model_construct().model_dump(mode="json", include=set(_SELDOM))
    for name in _SELDOM:
        if content[name] == defaults[name]:
            del content[name]
    rows = [f"  - {yaml_text(entry, flow=True)}" for entry in content.pop("logs")]
    return "".join([yaml_text(content), "logs:\n", *rows])


def write_manifest(manifest: Manifest, path: Path) -> None:
    """Write a manifest as YAML."""
    write_file(path, manifest_text(manifest))


def _expand_root(manifest_path: Path, root: str) -> Path:
    """Resolve ``root`` in the manifest's folder, or the working one if a variable begins it."""

    def expand(match: re.Match[str]) -> str:
        of_thesis = match[1] == thesis_logs.VARIABLE
        folder = thesis_logs.found_folder() if of_thesis else os.environ.get(match[1])
        if folder is None:
            expected = f"${match[1]} set to the folder of the logs (or --root)"
            fetched = "the logs: run `butterfly fetch`; or " if of_thesis else ""
            raise InputError(manifest_path, "root", root, fetched + expected)
        return str(folder)

    base = Path() if _VARIABLE.match(root) else manifest_path.parent
    folder = _VARIABLE.sub(expand, root)
    require_path(folder, manifest_path, "root")
    return (base / folder).resolve()
