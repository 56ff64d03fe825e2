"""One parameter of an estimate: a row of the one table that every view formats."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any

from butterfly.identification.trust import Trust, trust_of
from butterfly.logs.log import InputKind
from butterfly.model.parameters import JointKind, LumpedParameters
from butterfly.model.terms import PARAMETERS, TERMS

_ON_SLIDES = {
    "kg m²": "kg",
    "N m s/rad": "N s/m",
    "N m": "N",
    "N m/unit": "N/unit",
    "N m s²/rad²": "N s²/m²",
    "N m/rad": "N/m",
    "rad/s": "m/s",
    "rad": "m",
    "m": "–",
}


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """A row of an estimate's table; None where a number is unknown."""

    name: str
    meaning: str
    unit: str
    value: float | None  # None if open: its data give limits alone
    standard_error: float | None = None
    lower: float | None  # of its 95 % interval
    upper: float | None
    least_left_out: float | None = None  # of the estimates without the logs of one added mass
    largest_left_out: float | None = None
    true: float | None = None
    on_bound: bool = False
    known: bool = False  # whether it was given exactly, and is no estimate
    claim: str = ""  # how well it is known, for programs: see `identification.trust`

    @property
    def trust(self) -> Trust:
        """How far it can be trusted."""
        return self.rated(on_bound=self.on_bound, doubted=self.claim == Trust.UNREAD.claim)

    def rated(self, **flags: bool) -> Trust:
        """Return how far it can be trusted with these flags (see `trust_of`)."""
        lower, upper = or_nan(self.lower), or_nan(self.upper)
        return trust_of(self.value, lower, upper, known=self.known, **flags)

    @property
    def farther(self) -> float | None:
        """How far the farther limit of its interval is from the value."""
        if self.value is None or self.lower is None or self.upper is None:
            return None
        return max(self.upper - self.value, self.value - self.lower)

    @property
    def deviation(self) -> float | None:
        """Relative deviation from the truth, where that is known and not 0."""
        return self.value / self.true - 1 if self.true and self.value is not None else None


def meaning_of(name: str, joint: JointKind = JointKind.HINGE) -> str:
    """Return what a parameter is, in a few words; on a slide a force for a torque."""
    term = TERMS[name]
    meaning = (term.looks_like or term.meaning).removeprefix("a ").removeprefix("an ")
    if joint is JointKind.SLIDE:
        meaning = meaning.replace("inertia", "mass that moves").replace("torque", "force")
    return meaning


def unit_of(
    parameter: str, input_kind: InputKind | None = None, joint: JointKind = JointKind.HINGE
) -> str:
    """Return the unit of a parameter, on a slide with m for rad; "unit" is an unknown input's."""
    unit = TERMS[parameter].unit
    if joint is JointKind.SLIDE:
        unit = _ON_SLIDES.get(unit, unit)
    return unit.replace("unit", "unit" if input_kind is None else input_kind.unit)


def lumped_numbers(
    parameters: LumpedParameters,
    input_kind: InputKind | None = None,
    joint: JointKind = JointKind.HINGE,
) -> dict[str, dict[str, Any]]:
    """Return those parameters that every joint has, and the others that are not as usual."""
    return {
        field.name: {
            "value": float(getattr(parameters, field.name)),
            "unit": unit_of(field.name, input_kind, joint),
        }
        for field in fields(LumpedParameters)
        if field.name in PARAMETERS
        or (field.name in TERMS and getattr(parameters, field.name) != field.default)
    }


def or_none(value: float) -> float | None:
    """Return a number that is finite; JSON has no others."""
    return float(value) if math.isfinite(value) else None


def or_nan(value: float | None) -> float:
    """Return a number, NaN for one that JSON has as null (see `or_none`)."""
    return math.nan if value is None else value
