"""The table of hypotheses about units, columns and masses, and those that inputs alone decide.

Each hypothesis has the template of its sentence, which errors end with.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from enum import StrEnum
from typing import Self

import numpy as np
from scipy.special import stdtrit

from butterfly.arrays import Samples
from butterfly.errors import ButterflyError, InputError, listed
from butterfly.identification.segments import driven
from butterfly.identification.trust import MATTERS, SHOWS, Finding, FindingKind
from butterfly.logs.log import InputKind, Log
from butterfly.logs.units import UNITS
from butterfly.model.parameters import AddedMass
from butterfly.signals.frequency_response import ResponsePoint, dominant_frequency
from butterfly.verdict import CONFIDENCE

SAME_FACTOR = 0.1
"""Relative distance within which two factors are taken for one."""

_DETUNED = MATTERS / 2  # relative error of an omega; that of the inertia is twice it
_HEAVIEST = 10.0  # kg, above which a mass is asked about: 7 of 110 random robots have more
_SINE = 0.8  # share of a signal that one sine explains, if it is one

_AGREE = "the model fits the logs"
_OF_COLUMN = {  # beginning of the sentence on a unit, and what is true in SI units
    "angle": ("The angle looks", _AGREE),
    "time": ("The timestamps look", _AGREE),
    "omega": ("The omegas in the manifest look", "they are the frequencies of the recorded inputs"),
    "arm": ("The arms look", _AGREE),
}
# counts per turn of common encoders, after their fourfold evaluation too; 360 are degrees
_COUNTS = {2**k for k in range(6, 25)} | {
    a * 10**k for a in (100, 125, 200, 250, 360, 400, 500, 512, 720) for k in range(5)
} - {360}
# of common gears
_RATIOS = (*range(2, 11), 12, 15, 16, 20, 25, 30, 36, 40, 50, 64, 80, 100, 120, 150, 200)

_Row = tuple[str, str, str, tuple[float, ...]]


def _advice(column: str, key: str) -> str:
    """Return the template of the sentence on how a unit is given."""
    return f"Set --units {column}={key}, or units: {{{{{column}: {key}}}}} in the manifest."


def _unit(name: str, column: str, unit: str, key: str, times: str, *factors: float) -> _Row:
    """Return the row of a unit of a column; its factor, written `times`, is that of `UNITS`."""
    looks, holds = _OF_COLUMN[column]
    text = f"{looks} like {unit}: multiplied by {times}, {holds}. {_advice(column, key)}"
    return name, column, text, factors or (UNITS[column][key],)


class UnitError(StrEnum):
    """The table of hypotheses: each has a name, the wrong column, a text and factors.

    The text is a template (see `unit_error_text`). One of the factors makes the column right; there
    are none where what is right follows from the logs.
    """

    column: str
    text: str
    factors: tuple[float, ...]

    def __new__(
        cls, name: str, column: str = "", text: str = "", factors: tuple[float, ...] = ()
    ) -> Self:
        """Return a row; a value that is looked up has its name alone."""
        row = str.__new__(cls, name)
        row._value_ = name
        row.column, row.text, row.factors = column, text, factors
        return row

    DEGREES = _unit("degrees", "angle", "degrees", "deg", "pi/180 (0.01745)")
    TURNS = _unit("turns", "angle", "turns", "turns", "2 pi (6.283)")
    COUNTS = _unit(
        *("counts", "angle", "encoder counts", "counts/{turn:.0f}"),
        "{number:.4g} (2 pi/{turn:.0f})",
        *(2 * math.pi / count for count in sorted(_COUNTS)),
    )
    MILLISECONDS = _unit("milliseconds", "time", "milliseconds", "ms", "0.001")
    MICROSECONDS = _unit("microseconds", "time", "microseconds", "us", "1e-6")
    SWAPPED = (
        *("swapped", "columns"),
        f"Input and angle look swapped: exchanged, {_AGREE}. Set columns in the manifest, or "
        "--columns.",
        (1.0,),
    )
    SIGN = (
        *("sign", "sign"),
        f"Input and angle look counted in opposite directions: with the input negated, {_AGREE}. "
        + _advice("input", "-{unit}"),
        (-1.0,),
    )
    PER_MINUTE = _unit("per-minute", "omega", "revolutions per minute", "rpm", "2 pi/60 (0.1047)")
    HERTZ = _unit("hertz", "omega", "Hz", "Hz", "2 pi")
    OMEGA = (
        *("omega", "omega"),
        "The omega in the manifest looks wrong for {logs}: multiplied by {number:.4g}, it is the "
        "frequency of the recorded input{right}.",
    )
    MILLIMETRES = _unit("millimetres", "arm", "millimetres", "mm", "0.001")
    CENTIMETRES = _unit("centimetres", "arm", "centimetres", "cm", "0.01")
    DIAMETER = _unit("diameter", "arm", "diameters", "0.5", "0.5", 0.5)
    MASS = (
        *("mass", "mass"),
        f"The added masses contradict each other: {_AGREE} if {{given}} is really "
        "{thousandths:.3g} g{in_logs}.{others}",
    )
    GRAMS = (
        *("grams", "mass"),
        "Is an added mass of {number:.4g} kg right? The motion does not distinguish kilograms from "
        "grams. If it is in grams, all values except the delay are a thousand times too large. "
        + _advice("mass", "g")
        + " If it is right, confirm it: --known mass_scale=1+-0.001.",
    )
    LATE = (
        *("late", "delay"),
        "In {logs} the input looks {early} relative to the angle: shifted by {thousandths:.3g} ms, "
        f"{_AGREE}.",
    )
    SETPOINT = (
        *("setpoint", "input"),
        "The input looks like a set-point that the joint follows. In the manifest, set input: "
        "setpoint and the servo's loop, such as loop: {{law: dynamixel-x, kp: 400}}.",
        (1.0, 0.8, 1.25),  # of the angle that is subtracted; all but the first are springs
    )
    GAIN = (
        *("gain", "loop"),
        "The P gain of the servo's loop looks wrong: multiplied by {number:.3g}, "
        f"{_AGREE}. Check law and kp of the loop.",
    )
    GEAR = (
        *("gear", "angle"),
        f"The angle looks measured on the other side of a gear: multiplied by {{number:.4g}}, "
        f"{_AGREE}. In the manifest, set the side with encoder and the ratio with known: "
        "{{gear_ratio: ...}}.",
        tuple(1 / ratio for ratio in _RATIOS),
    )


def _turned(factor: float, log: Log) -> Log:
    """Return the log of an angle times a factor; a set-point that it follows is in its unit."""
    turned = replace(log, angle=factor * log.angle)
    if not log.closed or log.setpoint is None:
        return turned
    goal, kind = factor * log.setpoint, InputKind.SETPOINT
    return driven(replace(turned, input=goal, setpoint=None, lead=None, input_kind=kind))


RIGHT: dict[str, Callable[[float, Log], Log]] = {
    "angle": _turned,
    "arm": lambda factor, log: replace(
        log, added_mass=replace(log.added_mass, arm=factor * log.added_mass.arm)
    ),
    "columns": lambda _, log: replace(log, input=log.angle, angle=log.input, lead=None),
    "delay": lambda early, log: replace(
        log, input=np.interp(log.time + early, log.time, log.input), lead=None
    ),
    "input": lambda share, log: replace(log, input=log.input - share * log.angle, lead=None),
    "sign": lambda factor, log: replace(log, input=factor * log.input, lead=None),
    "time": lambda factor, log: replace(log, time=factor * log.time, lead=None),
}
"""Functions that correct a column of a log, by a factor or another number."""


def unit_error(
    error: UnitError, factor: float, *more: str, logs: Sequence[str] = (), moves: bool = True
) -> Finding:
    """Return the finding of a unit error; ``moves``: whether its correction moves values."""
    kind = FindingKind.UNIT_ERROR if moves else FindingKind.SUSPECTED
    return Finding(kind, (error, *more), number=factor, logs=tuple(logs))


def unit_error_text(finding: Finding) -> str:
    """Return the sentence that names the unit error of a finding, and its correction."""
    error, *more = finding.parameters
    number, logs = finding.number or 0.0, listed(finding.logs)
    given, ways = more if len(more) > 1 else ("", "1")
    return UnitError(error).text.format(
        number=number,
        thousandths=1e3 * abs(number),
        turn=2 * math.pi / (number or math.inf),
        early="early" if number < 0 else "late",
        logs=logs,
        in_logs=f" in {logs}" if logs else "",
        right=f" ({more[0]})" if more else "",
        unit=more[0] if more else "1",
        given=given,
        others="" if ways == "1" else f" This is one of {ways} explanations: weigh the masses.",
    )


def with_unit_errors(error: ButterflyError, errors: Sequence[Finding]) -> ButterflyError:
    """Return an error with the sentences of unit errors at its end; itself if there are none."""
    if not errors:
        return error
    texts = " ".join(map(unit_error_text, errors))
    if isinstance(error, InputError):
        return InputError(error.source, error.field, error.value, f"{error.expected}. {texts}")
    return type(error)(f"{error}. {texts}")


def unit_errors_of_refused(logs: Sequence[Log]) -> list[Finding]:
    """Return the unit errors that explain inputs of sines at other frequencies than given."""
    sines = [log for log in logs if log.excitation is not None]
    if not sines:
        return []
    ratios, shares = _ratios(sines, "input")
    if np.median(shares) >= _SINE:
        clear = np.flatnonzero(shares >= _SINE).tolist()
        return unit_errors_of_omegas([sines[k] for k in clear], ratios[clear])
    ratios, shares = _ratios(sines, "angle")
    right = (shares > _SINE) & (np.abs(ratios - 1) < SAME_FACTOR)
    return [unit_error(UnitError.SWAPPED, 1.0)] if np.mean(right) > _SINE else []


def unit_errors_of_omegas(sines: Sequence[Log], ratios: Samples) -> list[Finding]:
    """Return the unit errors of omegas, by (n,) measured over given frequencies of n inputs.

    It is a unit or a factor of all of them, or else the omegas of single logs.
    """
    wrong = np.flatnonzero(np.abs(ratios - 1) > _DETUNED).tolist()
    if not wrong:
        return []
    for error in UnitError:
        for factor in error.factors if error.column in {"time", "omega"} else ():
            if np.all(np.abs(ratios / factor - 1) < SAME_FACTOR):
                return [unit_error(error, factor)]
    common = float(np.median(ratios))
    if len(wrong) == len(sines) and np.all(np.abs(ratios / common - 1) < _DETUNED):
        return [_of_omega(common, *sines)]
    return [_of_omega(float(ratios[k]), sines[k]) for k in wrong]


@np.errstate(over="ignore", invalid="ignore")
def unit_errors_of_still(logs: Sequence[Log]) -> list[Finding]:
    """Return the finding of swapped columns if angles are constant and inputs decay."""
    still = [log.input for log in logs if np.ptp(log.angle) == 0 and np.isfinite(log.input).all()]
    halves = [[half.std() for half in np.array_split(series, 2)] for series in still]
    rested = bool(still) and all(2 * second < first for first, second in halves)
    return [unit_error(UnitError.SWAPPED, 1.0)] if rested else []


def clock_error(points: Sequence[ResponsePoint]) -> float:
    """Return the relative excess of the sines' frequencies over omega; 0 if insignificant."""
    shares = np.array([point.detuning for point in points])
    if shares.size < 2:  # noqa: PLR2004 - which have a scatter
        return 0.0
    share = float(shares.mean())
    error = float(shares.std(ddof=1)) / math.sqrt(shares.size)
    least = max(stdtrit(shares.size - 1, 0.5 + CONFIDENCE / 2) * error, SHOWS / 2)
    return share if abs(share) > least else 0.0


def unit_errors_of_masses(masses: Sequence[AddedMass]) -> list[Finding]:
    """Return the question whether the heaviest mass is in grams, which motion cannot decide."""
    heaviest = max(mass.mass for mass in masses)
    asked = Finding(FindingKind.ASKED, (UnitError.GRAMS,), number=heaviest)
    return [asked] if heaviest > _HEAVIEST else []


def _ratios(sines: Sequence[Log], signal: str) -> tuple[Samples, Samples]:
    """Return (n,) measured over given frequencies of n logs, and the (n,) shares they explain."""
    omegas = np.array([log.excitation.omega for log in sines if log.excitation])
    pairs = [dominant_frequency(log.time, getattr(log, signal)) for log in sines]
    measured, shares = np.array(pairs).T
    return measured / omegas, shares


def _of_omega(ratio: float, *logs: Log) -> Finding:
    """Return the finding of a wrong omega, with the right one in rad/s if it is of one log."""
    sines = [log.excitation for log in logs if log.excitation]
    measured = [f"{ratio * sine.omega:.4g} rad/s" for sine in sines] if len(logs) == 1 else []
    moves = 2 * abs(ratio - 1) > SAME_FACTOR  # of inertia, by the square of the time
    names = [log.name for log in logs]
    return unit_error(UnitError.OMEGA, ratio, *measured, logs=names, moves=moves)
