"""Motors that somebody measured: a file each, whose values can be known values of your joint.

A file says what a motor takes to another joint (torque per unit of input, friction, ...), with 95 %
intervals, how far motors of the type differ, and where all this is from. The standard uncertainty
of a value in another joint is

    u^2 = (h / 1.96)^2 + (s value)^2,

h the distance of the farther limit, s the relative standard deviation between motors of the type.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, PositiveInt, model_validator

from butterfly.errors import InputError, nearest
from butterfly.files import shipped
from butterfly.logs.log import InputKind
from butterfly.model.parameters import JointKind
from butterfly.model.prior import PHYSICAL, Known, Prior
from butterfly.model.servo import LAWS
from butterfly.model.terms import TERMS
from butterfly.verdict import SPREADS, Level
from butterfly.yaml_files import StrictModel, load_yaml, validate

FROM = "from"
"""Key of known values that names a motor."""

FOLDER = "models/motors"
"""Shipped folder of the files."""

_ENDINGS = {".yaml", ".yml"}

Share = Annotated[float, Field(ge=0)]
"""A number over a value, not negative."""


def _text(pattern: str, expected: str) -> AfterValidator:
    """Return what refuses texts of another pattern, with what is expected in words."""

    def check(value: str) -> str:
        if not re.fullmatch(pattern, value, re.DOTALL):
            raise ValueError(expected)
        return value

    return AfterValidator(check)


Words = Annotated[str, _text(r".*\S.*", "a text that is not empty")]
"""A text that says something."""


class MotorValue(StrictModel):
    """A value with the limits of its 95 % interval."""

    value: float
    lower: float
    upper: float
    unit: str

    @model_validator(mode="after")
    def _within(self) -> MotorValue:
        if not self.lower <= self.value <= self.upper:
            raise ValueError("lower, value and upper in this order")
        return self

    @property
    def farther(self) -> float:
        """Distance of the farther limit."""
        return max(self.value - self.lower, self.upper - self.value)


class SharedValue(MotorValue):
    """A value that other motors of the type share, up to their scatter."""

    scatter: Share
    """Standard deviation between motors of the type, over the value."""

    def known(self, origin: str = "") -> Known:
        """Return the value with its standard uncertainty for another motor of the type."""
        error = math.hypot(self.farther / SPREADS, self.scatter * self.value)
        return Known(value=self.value, uncertainty=float(f"{error:.2g}"), origin=origin)


class MotorSource(StrictModel):
    """Where the logs are from."""

    repository: Annotated[str, _text(r"https://\S+", "an address that begins with https://")]
    commit: Annotated[str, _text(r"[0-9a-f]{40}", "the 40 hexadecimal digits of a commit")]
    folder: Words
    """Of the logs in the repository."""
    licence: Literal["Apache-2.0", "BSD-2-Clause", "BSD-3-Clause", "CC0-1.0", "CC-BY-4.0", "MIT"]
    """That allows to publish what is computed from them."""
    holder: Words
    """Who holds the rights."""


class Making(StrictModel):
    """How the values were made."""

    command: Annotated[str, _text("butterfly identify .+", "butterfly identify ...")]
    version: Words
    """Of the program."""
    manifest: dict[str, Any]
    """Content of the manifest that the command reads, beside the logs."""


class MeasuredMotor(StrictModel):
    """The file of a motor."""

    name: Words
    maker: Words
    drive: Literal["voltage", "torque", "current", "duty"]
    """What drives it: p4 is per unit of that. Of a servo, what its firmware puts out."""
    law: str | None = None
    """Of the servo's firmware."""
    measured: PositiveInt
    """How many motors were measured."""
    scatter: Words
    """Where the scatter between motors is from."""
    conditions: Annotated[dict[str, Words], Field(min_length=1)]
    """Under which the logs were recorded: supply, temperature, gains, load, sampling."""
    verdict: Literal["good", "use with care"]
    """On the identification."""
    known: Annotated[dict[str, SharedValue], Field(min_length=1)]
    """What the motor takes to another joint."""
    rig: dict[str, MotorValue] = Field(default={})
    """What belongs to the joint that it was measured in, or is not significant: never used."""
    notes: list[Words] = Field(default=[])
    """What else a user should know."""
    source: MotorSource
    made: Making

    @model_validator(mode="after")
    def _of_a_motor(self) -> MeasuredMotor:
        if self.law is not None and self.law not in LAWS:
            raise InputError("motor", "law", self.law, nearest(self.law, LAWS))
        for place, values in (("known", self.known), ("rig", self.rig)):
            for name, value in values.items():
                unit = self._unit(place, name)
                if value.unit != unit:
                    raise InputError("motor", f"{place}.{name}.unit", value.unit, unit)
        for name, shared in self.known.items():
            if shared.lower <= 0 <= shared.upper:
                expected = "an interval without 0; else it belongs to rig"
                raise InputError("motor", f"known.{name}", f"{shared.value:g}", expected)
            if self.measured == 1 and not shared.scatter:
                expected = "above 0: one motor does not tell how far others differ"
                raise InputError("motor", f"known.{name}.scatter", 0, expected)
        Prior.of({name: value.known() for name, value in self.known.items()}, "motor")
        return self

    def _unit(self, place: str, name: str) -> str:
        """Return the unit of a value; InputError if a motor has none such."""
        shared = [name for name, row in TERMS.items() if row.of_motor]
        valid = [*TERMS] if place == "rig" else [*shared, *PHYSICAL]
        if name not in valid:
            raise InputError("motor", place, name, nearest(name, valid))
        unit = TERMS[name].unit if name in TERMS else PHYSICAL[name]
        return unit.replace("unit", InputKind(self.drive).unit)

    @property
    def level(self) -> Level:
        """The verdict's level."""
        return Level.of_verdict(self.verdict)

    @property
    def count(self) -> str:
        """How many motors were measured, in words."""
        return "one motor" if self.measured == 1 else f"{self.measured} motors"

    def knowledge(self, origin: str) -> dict[str, Known]:
        """Return its values as those of an ``origin`` that answers name."""
        return {name: value.known(origin) for name, value in self.known.items()}


def motor_names() -> list[str]:
    """Return the names of the shipped motors."""
    return sorted(path.stem for path in shipped(FOLDER).glob("*.yaml"))


@cache
def _read(path: Path) -> MeasuredMotor:
    document = load_yaml(path)
    return validate([document], document.content, MeasuredMotor)


def motor_of(name: str) -> MeasuredMotor:
    """Return a shipped motor by name, or that of a file; InputError if there is none."""
    return _read(motor_path(name))


def motor_path(name: str) -> Path:
    """Return the file of a motor; InputError if there is none."""
    path = Path(name)
    if path.suffix.lower() in _ENDINGS:
        return path
    names = motor_names()
    if name not in names:
        raise InputError("known", FROM, name, nearest(name, names))
    return shipped(f"{FOLDER}/{name}.yaml")


def with_motor(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return known values with those of the motor that they name; their own take precedence."""
    if FROM not in given:
        return dict(given)
    rest = {name: value for name, value in given.items() if name != FROM}
    name = given[FROM]
    if not isinstance(name, str):
        raise InputError("known", FROM, name, f"the name of a motor: {', '.join(motor_names())}")
    try:
        motor = motor_of(name)
    except InputError as error:
        if error.field == FROM:
            raise
        slip = f"{name}: {error.field}: {error.value}"  # who reads a manifest names that alone
        raise InputError("known", FROM, slip, error.expected) from None
    return {**motor.knowledge(name), **rest}


def described_origin(origin: str) -> str:
    """Return whose values they are, with the verdict on them where its file is here."""
    try:
        motor = motor_of(origin)
    except InputError:
        return origin
    return f"{origin} ({motor.verdict}, {motor.count} measured)"


def require_drive(known: Prior, kind: InputKind, joint: JointKind, source: str) -> None:
    """Raise InputError if a motor's values are for another drive or a slide."""
    for origin in dict.fromkeys(value.origin for value in known.values.values() if value.origin):
        try:
            motor = motor_of(origin)
        except InputError:
            continue  # of a result that was made elsewhere
        if motor.drive != kind:
            expected = f"logs whose input is a {motor.drive}, as that of {motor.name}"
            raise InputError(source, f"known.{FROM}", f"{origin} with input: {kind}", expected)
        if joint is not JointKind.HINGE:
            raise InputError(source, f"known.{FROM}", f"{origin} of a slide", "a hinge")
