"""How far a value can be trusted, on one scale, and findings about a fit, as data."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass, fields
from enum import Enum, StrEnum
from statistics import NormalDist
from typing import Any

from butterfly.logs.log import InputKind
from butterfly.model.parameters import JointKind, LumpedParameters
from butterfly.model.terms import PARAMETERS, TERMS
from butterfly.verdict import CONFIDENCE, Level


class Ending(StrEnum):
    """How an estimation ended."""

    CONVERGED = "converged"
    STOPPED = "stopped"
    REFUSED = "refused"


class FindingKind(StrEnum):
    """Kinds of findings, gravest first; comments explain the numbers."""

    UNIT_ERROR = "unit-error"  # name of the error; the factor that undoes it
    # share by which p4/p1 of the second of two logs of one mass is larger; their names, then which
    # of both moves like which log of another mass
    UNREPEATED = "unrepeated"
    # median FIT in per cent beyond noise, too low for a model that follows; a method that does
    POOR_FIT = "poor-fit"
    NO_INERTIA = "no-inertia"  # p1 with the least added inertia
    NEGATIVE = "negative"  # parameters that cannot be negative
    LOGS_LOST = "logs-lost"  # a quarter of the logs or more that are not followed; of how many
    SEARCH_STOPPED = "search-stopped"  # seconds; the parameters name what was skipped
    SUSPECTED = "suspected-slip"  # a unit error that hardly moves the values; the factor
    ASKED = "asked-slip"  # one that no motion can show; the mass in kg
    EARLY = "early"  # a delay below 0
    NEGATIVE_GAIN = "negative-gain"
    SOURCES_CONFLICT = "sources-conflict"  # standard uncertainties between two given values
    NEIGHBOURS_UNSEEN = "neighbours-unseen"  # other joints without columns, not said to be clamped
    NEIGHBOURS_MOVED = "neighbours-moved"  # other joints; rad by which they moved, uncorrected
    CONTRADICTED = "contradicted"  # physical parameters below 0; standard errors
    # p4, the unit that the input was taken in, another in its file, its place, its kind of input
    UNIT_UNREAD = "unit-unread"
    KNOWN_CONFLICT = "known-conflict"  # relative correction of a given value by the added masses
    PRIOR_CONFLICT = "prior-apart"  # standard errors between a given value and the logs
    MOTOR_CONFLICT = "motor-conflict"  # the same of a motor's value; its name, then the motor
    PULLED = "pulled"  # on a bound that the data would cross
    CLOCK = "clock"  # share by which the inputs' sines run faster than their omega
    CLOCK_SET = "clock-set"  # the same where all timestamps were multiplied by 1 more than it
    OMEGA_SET = "omega-set"  # or every omega
    STRAIGHT = "straight"  # logs whose input goes straight between samples, as nobody says
    # a term, and scales that may be wrong instead; share by which p1 would be
    LIKE_SCALE = "like-scale"
    # a term that is not fitted, and parameters that it would move; the largest share
    LIKE_TERM = "like-term"
    OFF_CENTRE = "off-centre"  # amplitude in rad of an encoder's error that repeats with the angle
    TORQUE_DRIVEN = "torque-driven"  # largest resistance in Ohm that the damping allows
    REST_DIFFERS = "rest-differs"  # rad between the rest angles with different masses
    ZERO_GUESSED = "zero-guessed"  # logs whose encoder zero is a guess
    NO_UNCERTAINTY = "no-uncertainty"  # number of equations
    COMBINATION = "combination"  # condition number, of parameters known in one combination only
    APPROXIMATE = "approximate"  # a method whose intervals do not include its systematic error
    FEW_LOGS = "few-logs"  # number of logs; the scatter is that of their blocks
    SCATTER = "scatter"  # standard deviation between logs, over the value
    LEFT_OUT = "left-out"  # number of all logs; those named have no response to a sine
    UNPREDICTABLE = "unpredictable"  # logs that no simulation from the start can follow
    NOT_ESTIMATED = "not-estimated"
    UNDRIVEN = "undriven"
    FEW_MASSES = "few-masses"  # different added masses, too few to leave one out
    ON_BOUND = "on-bound"
    SIGN_UNKNOWN = "sign-unknown"
    OTHER_END = "other-end"  # cost of the next best minimum over that of the best
    INSEPARABLE = "inseparable"  # terms dropped: not identifiable together with the others
    NOT_HELPING = "not-helping"  # terms offered that did not help to predict
    # missing terms, then parameters that they move by more than their intervals; share of the
    # squared residuals that they explain
    MISSING_TERM = "missing-term"
    FOLLOWED = "followed"  # rms error of free runs, over the rms motion
    MISFIT = "misfit"  # error of free runs, over the sensor noise
    NO_MISFIT = "no-misfit"  # the same, where sensor noise explains it
    NEIGHBOURS_STILL = "neighbours-still"  # other joints without columns, said to be clamped
    # other joints; the torque that their motion made, over that of the drive, rms
    NEIGHBOURS_CORRECTED = "neighbours-corrected"
    ABSOLUTE = "absolute"
    RATIOS = "ratios"
    PLANT = "plant"  # share by which the simulator's own error moves the value that it hits most
    UNIT_ASSUMED = "unit-assumed"  # p4, and the unit that the input was taken in
    HELD = "held"  # logs whose input was held between samples, as nobody says
    RESTS_ON = "rests-on"  # scales that no log can show, given without an uncertainty


KINDS = frozenset(map(str, FindingKind))
_FORBIDDING = {FindingKind.POOR_FIT, FindingKind.UNIT_ERROR, FindingKind.UNREPEATED}
_DOUBTING = {
    *(FindingKind.SEARCH_STOPPED, FindingKind.APPROXIMATE, FindingKind.ASKED),
    *(FindingKind.SOURCES_CONFLICT, FindingKind.CONTRADICTED),
    *(FindingKind.KNOWN_CONFLICT, FindingKind.PRIOR_CONFLICT, FindingKind.UNIT_UNREAD),
    *(FindingKind.MOTOR_CONFLICT, FindingKind.LOGS_LOST),
    *(FindingKind.NEIGHBOURS_UNSEEN, FindingKind.NEIGHBOURS_MOVED),
}
_GRAVITY = {str(kind): number for number, kind in enumerate(FindingKind)}


@dataclass(frozen=True)
class Finding:
    """A finding about ``parameters`` and ``logs`` (all if none is named), with its number."""

    kind: FindingKind
    parameters: tuple[str, ...] = ()
    _: KW_ONLY
    number: float | None = None
    logs: tuple[str, ...] = ()

    @property
    def impossible(self) -> bool:
        """Whether no joint with such values can be simulated."""
        if self.kind is FindingKind.POOR_FIT:
            return self.number is not None and not math.isfinite(self.number)
        return self.kind in {FindingKind.NO_INERTIA, FindingKind.NEGATIVE}

    @property
    def forbids(self) -> bool:
        """Whether it makes the values unusable."""
        return self.impossible or self.kind in _FORBIDDING

    @property
    def doubts(self) -> bool:
        """Whether values that it concerns are no better than *use with care*."""
        return self.kind in _DOUBTING

    @property
    def level(self) -> Level:
        """How grave it is."""
        if self.forbids:
            return Level.WARNING
        return Level.CARE if self.gravity <= _GRAVITY[FindingKind.SCATTER] else Level.NOTE

    @property
    def gravity(self) -> int:
        """Its place among all kinds, the gravest first."""
        return _GRAVITY[self.kind]


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
