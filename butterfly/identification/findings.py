"""Findings about a fit, as data; `report.finding_texts` has their sentences."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass
from enum import StrEnum

from butterfly.verdict import Level


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
