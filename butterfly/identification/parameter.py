"""How far a value can be trusted: one scale for the verdict, badges, words and programs.

A value's half-width h is the distance of its farther limit. Within `GOOD_WITHIN` of the value it is
good; *precise* is a definite statement, made where `CLEARLY` times the half-width is within it, as
if half-widths were standard errors. The rows, the first that holds:

| row | claim in JSON | badge | holds if |
|---|---|---|---|
| KNOWN | known | known | it was given exactly |
| OPEN | open | open | its data give a limit alone |
| AT_BOUND | as without the bound | at bound | it is on an active bound |
| UNSURE | "" | "" | it has no interval |
| ZERO | not-from-zero | may be 0 | the interval includes 0 |
| UNREAD | unit-unread | care | precise or good, by a unit that a finding doubts |
| PRECISE | precise | good | 3.3 h' <= 10 % of the value, h' half of the interval |
| GOOD | rough | good | h <= 10 % of the value |
| CARE | rough | care | 3.3 h <= the value |
| POOR | rough | poor | else |

One parameter of an estimate is a row of the one table that every view formats. The levels of
significance, precision and relevance that all of identification shares stand before the scale.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from enum import Enum
from statistics import NormalDist
from typing import Any

from butterfly.logs.log import InputKind
from butterfly.model.parameters import JointKind, LumpedParameters
from butterfly.model.terms import PARAMETERS, TERMS
from butterfly.verdict import Level

CONFIDENCE = 0.95
"""Level of all intervals; tests have a false-alarm rate of 1 less it."""

SPREADS = NormalDist().inv_cdf(0.5 + CONFIDENCE / 2)
"""Half width of an interval, in standard deviations of a normal distribution."""

ACCUSED = 1e-3
"""False-alarm rate of tests of given values, and of the homogeneity of logs."""

CLEARLY = -NormalDist().inv_cdf(ACCUSED / 2)
"""Standard errors above which two values contradict each other."""

MATTERS = 0.01
"""Share of a value below which a change is negligible."""

MATERIAL = 0.05
"""Share of the squared errors that a missing term or a contrast explains if it is one."""

SHOWS = 1e-3
"""The same where errors are known, as those of steady responses are."""

LOST = 0.5
"""Largest unexplained share of a motion, or of an effect, of a model that follows."""

FEW = 3
"""Logs, masses or parts of data: so many allow to leave one out, but no estimate of scatter."""

DRAWS = round(1 / (1 - CONFIDENCE))
"""Random draws of which one is expected outside an interval."""

GOOD_WITHIN = 0.1
"""Relative half-width within which a value is good."""


class Trust(Enum):
    """A row: the claim that programs read, the badge, and how grave that is (None: no badge)."""

    KNOWN = "known", "known", Level.NOTE
    OPEN = "open", "open", Level.CARE
    AT_BOUND = "", "at bound", Level.CARE
    UNSURE = "", "", None
    ZERO = "not-from-zero", "may be 0", Level.CARE
    UNREAD = "unit-unread", "care", Level.CARE
    PRECISE = "precise", "good", Level.GOOD
    GOOD = "rough", "good", Level.GOOD
    CARE = "rough", "care", Level.CARE
    POOR = "rough", "poor", Level.WARNING

    def __init__(self, claim: str, badge: str, level: Level | None) -> None:
        self.claim, self.badge, self.level = claim, badge, level

    @property
    def sized(self) -> bool:
        """Whether it has an interval that excludes 0."""
        return self in {Trust.PRECISE, Trust.UNREAD, Trust.GOOD, Trust.CARE, Trust.POOR}


def trust_of(
    value: float | None,
    lower: float,
    upper: float,
    *,
    known: bool = False,
    on_bound: bool = False,
    doubted: bool = False,
) -> Trust:
    """Return the row of a value, None if it is open, with its limits and what is found of it.

    ``doubted``: Whether a finding doubts its unit.
    """
    if known or value is None:
        return Trust.KNOWN if known else Trust.OPEN
    if on_bound:
        return Trust.AT_BOUND
    if not (math.isfinite(lower) and math.isfinite(upper)):
        return Trust.UNSURE
    half, farther, size = (upper - lower) / 2, max(upper - value, value - lower), abs(value)
    rows = {
        Trust.ZERO: lower <= 0 <= upper,
        Trust.UNREAD: doubted and farther <= GOOD_WITHIN * size,
        Trust.PRECISE: CLEARLY * half <= GOOD_WITHIN * size,
        Trust.GOOD: farther <= GOOD_WITHIN * size,
        Trust.CARE: CLEARLY * farther <= size,
    }
    return next((row for row, holds in rows.items() if holds), Trust.POOR)


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
    claim: str = ""  # how well it is known, for programs: see `trust_of`

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
