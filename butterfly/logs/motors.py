"""Motors that somebody measured: a file a type, whose values can be known values of your joint.

A file says what each motor of the type takes to another joint (torque per unit of input, friction,
...), with 95 % intervals, and where that is from. Of n motors with values x_i and distances h_i of
the farther limits, the value is their mean x, and its standard uncertainty in another joint

    u^2 = sum (h_i / 1.96)^2 / n^2 + (1 + 1/n) (s x)^2,   s^2 = (4 s0^2 + (n - 1) s_n^2) / (n + 3),

s_n the standard deviation of the x_i over x, s0 what five motors of another type differ by.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from statistics import fmean, variance
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, model_validator

from butterfly.errors import InputError, nearest
from butterfly.files import shipped
from butterfly.logs.log import InputKind
from butterfly.model.parameters import JointKind
from butterfly.model.prior import PHYSICAL, Known, Prior
from butterfly.model.servo import LAWS
from butterfly.model.terms import GROWING, TERMS
from butterfly.verdict import SPREADS, Level
from butterfly.yaml_files import StrictModel, load_yaml, validate

FROM = "from"
"""Key of known values that names a motor."""

FOLDER = "models/motors"
"""Shipped folder of the files."""

SCATTER_OF_GAIN, SCATTER_OF_FRICTION, SCATTER_OF_DAMPING = 0.12, 0.35, 1.1
"""Standard deviations between motors of one type, over the value: of p4, of Coulomb friction and of
viscous friction. Those of BAM's M1 of five Feetech STS3215 (kscalelabs/sysid f4739df,
feetech/sts3215-12v/params)."""

_FREEDOM = 4  # degrees of freedom of these, of five motors
_ENDINGS = {".yaml", ".yml"}


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
    """A value of one motor with the limits of its 95 % interval."""

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


@dataclass(frozen=True)
class SharedValue:
    """A value that the motors of a type share, up to their scatter."""

    motors: tuple[MotorValue, ...]
    assumed: float
    """Standard deviation between motors over the value, where one motor was measured."""

    @property
    def value(self) -> float:
        """Mean of the motors."""
        return fmean(motor.value for motor in self.motors)

    @property
    def unit(self) -> str:
        """That of each."""
        return self.motors[0].unit

    @property
    def scatter(self) -> float:
        """Standard deviation between motors, over the value."""
        more = len(self.motors) - 1
        values = [motor.value / self.value for motor in self.motors]
        squares = _FREEDOM * self.assumed**2 + (more * variance(values) if more else 0.0)
        return math.sqrt(squares / (_FREEDOM + more))

    def known(self, origin: str = "") -> Known:
        """Return the value with its standard uncertainty for another motor of the type."""
        count = len(self.motors)
        measured = math.hypot(*(motor.farther for motor in self.motors)) / SPREADS / count
        error = math.hypot(measured, math.sqrt(1 + 1 / count) * self.scatter * self.value)
        return Known(value=self.value, uncertainty=float(f"{error:.2g}"), origin=origin)


def assumed_scatter(name: str) -> float:
    """Return how far motors of a type differ in a parameter, where one was measured."""
    row = TERMS.get(name)
    if row is not None and row.dry:
        return SCATTER_OF_FRICTION
    damps = row is not None and row.derivative and name in GROWING
    return SCATTER_OF_DAMPING if damps else SCATTER_OF_GAIN


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
    """A motor of the type that was measured, with its own logs."""

    verdict: Literal["good", "use with care"]
    """On the identification."""
    conditions: Annotated[dict[str, Words], Field(min_length=1)]
    """Under which the logs were recorded: supply, temperature, gains, load, sampling."""
    known: Annotated[dict[str, MotorValue], Field(min_length=1)]
    """What it takes to another joint."""
    rig: dict[str, MotorValue] = Field(default={})
    """What belongs to the joint that it was measured in, or is not significant: never used."""
    notes: list[Words] = Field(default=[])
    """What else a user should know."""
    source: MotorSource
    made: Making


class MotorType(StrictModel):
    """The file of a type of motor."""

    name: Words
    maker: Words
    drive: Literal["voltage", "torque", "current", "duty"]
    """What drives it: p4 is per unit of that. Of a servo, what its firmware puts out."""
    law: str | None = None
    """Of the servo's firmware."""
    motors: Annotated[list[MeasuredMotor], Field(min_length=1)]
    """Those that were measured."""

    @model_validator(mode="after")
    def _of_motors(self) -> MotorType:
        if self.law is not None and self.law not in LAWS:
            raise InputError("motor", "law", self.law, nearest(self.law, LAWS))
        for number, motor in enumerate(self.motors):
            for part, values in (("known", motor.known), ("rig", motor.rig)):
                for name, value in values.items():
                    self._require(f"motors.{number}.{part}", name, value)
        if not self.known:
            expected = "a value that is known of each of the motors"
            raise InputError("motor", "motors", "no such value", expected)
        for name, shared in self.known.items():
            if len({value.value > 0 for value in shared.motors}) > 1:
                raise InputError("motor", f"known.{name}", "two signs", "one sign in all motors")
        Prior.of({name: value.known() for name, value in self.known.items()}, "motor")
        return self

    def _require(self, place: str, name: str, value: MotorValue) -> None:
        """Raise InputError if a motor has no such value, in another unit, or perhaps 0."""
        unit = self._unit(place, name)
        if value.unit != unit:
            raise InputError("motor", f"{place}.{name}.unit", value.unit, unit)
        if place.endswith("known") and value.lower <= 0 <= value.upper:
            expected = "an interval without 0; else it belongs to rig"
            raise InputError("motor", f"{place}.{name}", f"{value.value:g}", expected)

    def _unit(self, place: str, name: str) -> str:
        """Return the unit of a value; InputError if a motor has none such."""
        shared = [name for name, row in TERMS.items() if row.of_motor]
        valid = [*TERMS] if place.endswith("rig") else [*shared, *PHYSICAL]
        if name not in valid:
            raise InputError("motor", place, name, nearest(name, valid))
        unit = TERMS[name].unit if name in TERMS else PHYSICAL[name]
        return unit.replace("unit", InputKind(self.drive).unit)

    @property
    def known(self) -> dict[str, SharedValue]:
        """What a motor of the type takes to another joint: what is known of each of the motors."""
        first, *others = (motor.known for motor in self.motors)
        return {
            name: SharedValue((value, *(other[name] for other in others)), assumed_scatter(name))
            for name, value in first.items()
            if all(name in other for other in others)
        }

    @property
    def level(self) -> Level:
        """The gravest verdict's level."""
        return Level.worst(Level.of_verdict(motor.verdict) for motor in self.motors)

    @property
    def verdict(self) -> str:
        """The gravest verdict."""
        return self.level.verdict

    @property
    def count(self) -> str:
        """How many motors were measured, in words."""
        return "one motor" if len(self.motors) == 1 else f"{len(self.motors)} motors"

    @property
    def scatter(self) -> str:
        """Where the scatter between motors is from, in words."""
        these = "" if len(self.motors) == 1 else "; pooled with how these differ"
        return (
            f"{self.count} measured; five Feetech STS3215, each with BAM's M1 (kscalelabs/sysid "
            f"f4739df), differ by {100 * SCATTER_OF_GAIN:.0f} % of the gain, "
            f"{100 * SCATTER_OF_FRICTION:.0f} % of Coulomb and {100 * SCATTER_OF_DAMPING:.0f} % of "
            f"viscous friction{these}"
        )

    def knowledge(self, origin: str) -> dict[str, Known]:
        """Return its values as those of an ``origin`` that answers name."""
        return {name: value.known(origin) for name, value in self.known.items()}


def motor_names() -> list[str]:
    """Return the names of the shipped motors."""
    return sorted(path.stem for path in shipped(FOLDER).glob("*.yaml"))


@cache
def _read(path: Path) -> MotorType:
    document = load_yaml(path)
    return validate([document], document.content, MotorType)


def motor_of(name: str) -> MotorType:
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
