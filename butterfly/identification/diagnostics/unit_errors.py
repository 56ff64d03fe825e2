"""Mistakes of whoever recorded or described the logs: wrong units, columns, omegas and masses.

Each has its name and its text; those of clocks, omegas and columns show in the inputs alone. One is
named only where undoing it makes the logs agree with a joint, or with their manifest.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit

from butterfly.arrays import Samples
from butterfly.errors import ButterflyError, InputError, listed
from butterfly.identification.diagnostics.findings import Finding, FindingKind
from butterfly.identification.levels import CONFIDENCE, MATTERS, PRECISE, SHOWS
from butterfly.logs.log import Log
from butterfly.model.parameters import AddedMass
from butterfly.signals.frequency_response import ResponsePoint
from butterfly.signals.spectrum import dominant_frequency

_DETUNED = MATTERS / 2  # relative difference of an omega, by whose square inertia changes
_HEAVIEST = 10.0  # kg, above which a mass is asked about: 7 of 110 random robots have more
_SINE = 0.8  # share of a signal that one sine explains, if it is one


class UnitError(StrEnum):
    """What may have been mistaken."""

    DEGREES = "degrees"
    TURNS = "turns"
    COUNTS = "counts"
    MILLISECONDS = "milliseconds"
    MICROSECONDS = "microseconds"
    SWAPPED = "swapped"
    PER_MINUTE = "per-minute"
    HERTZ = "hertz"
    OMEGA = "omega"
    MILLIMETRES = "millimetres"
    CENTIMETRES = "centimetres"
    DIAMETER = "diameter"
    MASS = "mass"
    GRAMS = "grams"
    LATE = "late"
    SETPOINT = "setpoint"
    GAIN = "gain"
    GEAR = "gear"


class Unit(NamedTuple):
    """A unit in which numbers were recorded or described, and are not said to be."""

    column: str  # of what
    factor: float  # that makes SI units of it
    name: str
    key: str  # by which it is said
    times: str  # the factor, as a person would write it


_LOOKS = {
    "angle": "The angle looks",
    "time": "The timestamps look",
    "omega": "The omegas in the manifest look",
    "arm": "The arms look",
}

TABLE = {
    UnitError.DEGREES: Unit("angle", math.pi / 180, "degrees", "deg", "pi/180 (0.01745)"),
    UnitError.TURNS: Unit("angle", 2 * math.pi, "turns", "turns", "2 pi (6.283)"),
    UnitError.MILLISECONDS: Unit("time", 1e-3, "milliseconds", "ms", "0.001"),
    UnitError.MICROSECONDS: Unit("time", 1e-6, "microseconds", "us", "1e-6"),
    UnitError.PER_MINUTE: Unit(
        "omega", 2 * math.pi / 60, "revolutions per minute", "rpm", "2 pi/60 (0.1047)"
    ),
    UnitError.HERTZ: Unit("omega", 2 * math.pi, "Hz", "Hz", "2 pi"),
    UnitError.MILLIMETRES: Unit("arm", 1e-3, "millimetres", "mm", "0.001"),
    UnitError.CENTIMETRES: Unit("arm", 1e-2, "centimetres", "cm", "0.01"),
    UnitError.DIAMETER: Unit("arm", 0.5, "diameters", "0.5", "0.5"),
}
"""What is mistaken for SI units; all else has a text of its own."""

_OF_INPUT = {
    UnitError.SWAPPED: "Input and angle look swapped: exchanged, the logs agree with a joint. Set "
    "columns in the manifest, or --columns.",
    UnitError.SETPOINT: "The input looks like a set-point that the joint follows. In the manifest, "
    "set input: setpoint and the servo's loop, such as loop: {{law: dynamixel-x, kp: 400}}.",
    UnitError.GAIN: "The P gain of the servo's loop looks wrong: multiplied by {:.3g}, the logs "
    "agree with a joint. Check law and kp of the loop.",
    UnitError.GEAR: "The angle looks measured on the other side of a gear: multiplied by {:.4g}, "
    "the logs agree with a joint. In the manifest, set the side with encoder and the ratio with "
    "known: {{gear_ratio: ...}}.",
}

RATIOS = (*range(2, 11), 12, 15, 16, 20, 25, 30, 36, 40, 50, 64, 80, 100, 120, 150, 200)
"""Of common gears."""

COUNTS = tuple(
    sorted(
        {2**k for k in range(6, 25)}
        | {a * 10**k for a in (100, 125, 200, 250, 360, 400, 500, 512, 720) for k in range(5)}
        - {360}
    )
)
"""Counts per turn of common encoders, after their fourfold evaluation too; 360 are degrees."""


def unit_error(
    error: UnitError, factor: float, *more: str, logs: Iterable[Log] = (), moves: bool = True
) -> Finding:
    """Return the finding that names a mistake, what undoes it, and whether that moves values."""
    kind = FindingKind.UNIT_ERROR if moves else FindingKind.SUSPECTED
    return Finding(kind, (error, *more), number=factor, logs=tuple(log.name for log in logs))


def unit_error_text(finding: Finding) -> str:
    """Name the mistake that a finding is about, and what undoes it."""
    error, *more = finding.parameters
    number, where = finding.number or 0.0, listed(finding.logs)
    match UnitError(error):
        case UnitError.SWAPPED | UnitError.SETPOINT | UnitError.GAIN | UnitError.GEAR as kind:
            return _OF_INPUT[kind].format(number)
        case UnitError.OMEGA:
            at = f" ({more[0]})" if more else ""
            return (
                f"The omega in the manifest looks wrong for {where}: multiplied by {number:.4g}, "
                f"it is the frequency of the recorded input{at}."
            )
        case UnitError.MASS:
            given, ways = more
            choice = (
                "" if ways == "1" else f" This is one of {ways} explanations: weigh the masses."
            )
            return (
                "The added masses contradict each other: the logs agree with a joint if "
                f"{given} is really {1e3 * number:.3g} g{' in ' * bool(where)}{where}.{choice}"
            )
        case UnitError.LATE:
            return (
                f"In {where} the input looks {'early' if number < 0 else 'late'} relative to the "
                f"angle: shifted by {1e3 * abs(number):.3g} ms, the logs agree with a joint."
            )
        case UnitError.GRAMS:
            return (
                f"Is an added mass of {number:.4g} kg right? The motion cannot tell kilograms from "
                "grams. If it is in grams, all values except the delay are a thousand times too "
                f"large. {_advice('mass', 'g')}"
            )
        case UnitError.COUNTS:
            turn = f"{2 * math.pi / number:.0f}"
            times = f"{number:.4g} (2 pi/{turn})"
            unit = Unit("angle", number, "encoder counts", f"counts/{turn}", times)
        case other:
            unit = TABLE[other]
    agree = "the logs agree with a joint"
    then = "they are the frequencies of the recorded inputs" if unit.column == "omega" else agree
    looks = f"{_LOOKS[unit.column]} like {unit.name}"
    return f"{looks}: multiplied by {unit.times}, {then}. {_advice(unit.column, unit.key)}"


def _advice(what: str, unit: str) -> str:
    return f"Set --units {what}={unit}, or units: {{{what}: {unit}}} in the manifest."


def with_unit_errors(error: ButterflyError, errors: Sequence[Finding]) -> ButterflyError:
    """Return an error that names errors besides; itself if there are none."""
    if not errors:
        return error
    said = " ".join(map(unit_error_text, errors))
    if isinstance(error, InputError):
        return InputError(error.source, error.field, error.value, f"{error.expected}. {said}")
    return type(error)(f"{error}. {said}")


def unit_errors_of_refused(logs: Sequence[Log]) -> list[Finding]:
    """Tell why the inputs of sines are not at the frequencies that the manifest gives them."""
    sines = [log for log in logs if log.excitation is not None]
    if not sines:
        return []
    ratios, shares = _ratios(sines, "input")
    if np.median(shares) < _SINE:
        ratios, shares = _ratios(sines, "angle")
        right = (shares > _SINE) & (np.abs(ratios - 1) < PRECISE)
        return [unit_error(UnitError.SWAPPED, 1.0)] if np.mean(right) > _SINE else []
    wrong = np.abs(ratios - 1) > _DETUNED
    common = float(np.median(ratios))
    if abs(common - 1) <= _DETUNED:
        return [_of_omega(float(ratios[k]), sines[k]) for k in np.flatnonzero(wrong)]
    for error, unit in TABLE.items():
        if unit.column in {"time", "omega"} and np.all(np.abs(ratios / unit.factor - 1) < PRECISE):
            return [unit_error(error, unit.factor)]
    return [_of_omega(common, *sines)] if np.all(np.abs(ratios / common - 1) < _DETUNED) else []


def unit_errors_of_still(logs: Sequence[Log]) -> list[Finding]:
    """Tell why angles stand still: of joints that were let go, the inputs do, and come to rest."""
    still = [log.input for log in logs if np.ptp(log.angle) == 0 and np.isfinite(log.input).all()]
    halves = [[half.std() for half in np.array_split(each, 2)] for each in still]
    rested = bool(still) and all(2 * second < first for first, second in halves)
    return [unit_error(UnitError.SWAPPED, 1.0)] if rested else []


def unit_errors_of_omega(
    logs: Sequence[Log], points: Sequence[ResponsePoint | None]
) -> list[Finding]:
    """Tell of which logs the input is next to, not at, the frequency that the manifest gives."""
    near = [
        (log, point.detuning)
        for log, point in zip(logs, points, strict=True)
        if point is not None and abs(point.detuning) > _DETUNED
    ]
    if not near:
        return []
    worst = max((detuning for _, detuning in near), key=abs)
    moves = 2 * abs(worst) > PRECISE  # of inertia, by the square of the time
    return [_of_omega(1 + worst, *(log for log, _ in near), moves=moves)]


def clock_error(points: Sequence[ResponsePoint]) -> float:
    """Return by which share the sines of all logs run faster than omega; 0 within its error."""
    apart = np.array([point.detuning for point in points])
    if apart.size < 2:  # noqa: PLR2004 - which have a scatter
        return 0.0
    share = float(apart.mean())
    error = float(apart.std(ddof=1)) / math.sqrt(apart.size)
    least = max(stdtrit(apart.size - 1, 0.5 + CONFIDENCE / 2) * error, SHOWS / 2)
    return share if abs(share) > least else 0.0


def unit_errors_of_masses(masses: Sequence[AddedMass]) -> list[Finding]:
    """Ask whether a heavy mass was meant to be grams, which no motion can tell."""
    heaviest = max(mass.mass for mass in masses)
    return [unit_error(UnitError.GRAMS, heaviest, moves=False)] if heaviest > _HEAVIEST else []


def _ratios(sines: Sequence[Log], signal: str) -> tuple[Samples, Samples]:
    """(n,) measured over given frequency of a signal of n logs, and (n,) shares it explains."""
    omegas = np.array([log.excitation.omega for log in sines if log.excitation])
    found = [dominant_frequency(log.time, getattr(log, signal)) for log in sines]
    measured, shares = np.array(found).T
    return measured / omegas, shares


def _of_omega(ratio: float, *logs: Log, moves: bool = True) -> Finding:
    """Name a wrong omega; of one log by what it should be too."""
    sines = [log.excitation for log in logs if log.excitation]
    measured = [f"{ratio * each.omega:.4g} rad/s" for each in sines] if len(logs) == 1 else []
    return unit_error(UnitError.OMEGA, ratio, *measured, logs=logs, moves=moves)
