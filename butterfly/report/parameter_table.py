"""The tables of parameters, forecasts and a robot's own model, and conditions that disagree."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any

from butterfly.identification.agreement import Condition, Contrast
from butterfly.identification.derived_quantities import SYMBOLS
from butterfly.identification.estimate import Estimate
from butterfly.identification.forecast import Forecast, Identifiability
from butterfly.identification.identified import Identified
from butterfly.identification.physical import Missing, PhysicalParameters
from butterfly.identification.trust import Parameter, Trust, or_nan, or_none, unit_of
from butterfly.model.parameters import JointKind
from butterfly.model.prior import plain
from butterfly.report.format import interval, limit_text, upwards, with_error
from butterfly.report.page import Marked, PageTable
from butterfly.twin.model_rows import ModelRow, facts_of, model_rows

FORECAST_HEADERS = ("parameter", "meaning", "before the fit", "expected", "remedy")
"""Headers of `forecast_rows`."""

_NEXT_TO_ZERO = 10.0  # times the true value, from which a deviation in per cent says nothing

PHYSICAL_TITLE = "Physical parameters and derived quantities"
"""Title of `physical_table`."""


def parameter_table(
    title: str,
    rows: Sequence[Parameter],
    *columns: object,
    more: Mapping[Any, Sequence[object]] = MappingProxyType({}),
    **fields: Any,  # noqa: ANN401 - of the table
) -> PageTable:
    """Tabulate parameters by names of `_CELLS`, or of ``more``, which has cells of its own."""
    headers: Any = ["" if column in _UNTITLED else column for column in columns]
    cells = [
        [more[name][k] if name in more else _CELLS[name](row) for name in columns]
        for k, row in enumerate(rows)
    ]
    return PageTable(title, headers, cells, **fields)


def values_table(
    title: str,
    rows: Sequence[Parameter],
    more: Mapping[Any, Sequence[object]] = MappingProxyType({}),
    **fields: Any,  # noqa: ANN401 - of the table
) -> PageTable:
    """Tabulate the values of parameters, ``more``, and the true ones if these are known."""
    known = any(row.true is not None for row in rows)
    compared = ("true", "deviation", "unit") if known else ("unit", "meaning")
    columns = ("name", "value ± 95 %", *more, *compared, "mark")
    return parameter_table(title, rows, *columns, more=more, **fields)


def value_text(row: Parameter) -> str:
    """Write a value to the digits of its error; *open* where there is none."""
    return "open" if row.value is None else with_error(row.value, or_nan(row.standard_error))


def limited_text(row: Parameter) -> str:
    """Write a value with its limit; of an open one what is known."""
    if row.value is None:
        return f"at most {limit_text(or_nan(row.upper))}"
    return with_limit(row.value, None if row.known else row.farther)


def _error(row: Parameter) -> str:
    if row.known:
        return "known"
    return "–" if row.standard_error is None else f"{row.standard_error:#.2g}"


def _interval(row: Parameter) -> str:
    return "–" if row.known else interval(or_nan(row.lower), or_nan(row.upper))


def _width(row: Parameter) -> str:
    """Return the half-width in per cent of the value, or why there is none."""
    trust = row.rated()
    if not row.known and trust in {Trust.OPEN, Trust.ZERO}:
        return trust.badge
    if row.known or not row.value or row.farther is None:
        return "–"
    return f"± {upwards(row.farther / abs(row.value))}"


def _left_out(row: Parameter) -> str:
    if row.least_left_out is None or row.largest_left_out is None:
        return ""
    return interval(row.least_left_out, row.largest_left_out)


def _deviation(row: Parameter) -> str:
    """Return its distance from the truth in per cent; in its unit where that is next to 0."""
    if row.deviation is None or row.value is None or row.true is None:
        return ""
    if abs(row.deviation) <= _NEXT_TO_ZERO:
        return f"{100 * row.deviation:+z.2f} %"
    return f"{row.value - row.true:+.3g} {row.unit}"


def badge_of(row: Parameter) -> Marked:
    """Return how far a parameter can be trusted, in short, as in the verdict; "" if unknown."""
    return Marked(row.trust.badge, level=row.trust.level)


_CELLS: Mapping[Any, Callable[[Parameter], object]] = {
    "name": lambda row: row.name,
    "name, with its meaning": lambda row: Marked(row.name, meaning=row.meaning),
    "parameter": lambda row: row.name,
    "meaning": lambda row: row.meaning,
    "unit": lambda row: row.unit,
    "value": value_text,
    "value ± 95 %": limited_text,
    "±": _width,
    "standard error": _error,
    "std error": _error,
    "95 % interval": _interval,
    "leave-one-mass-out": _left_out,
    "true": lambda row: "" if row.true is None else f"{row.true:.5g}",
    "deviation": _deviation,
    "badge": badge_of,
    "mark": lambda row: str(badge_of(row)),
}
"""What of a parameter is a cell, by its header; "" where there is nothing to say."""

_UNTITLED = {"name", "name, with its meaning", "badge", "mark"}
"""Columns that need no header."""


def with_limit(value: float, farther: float | None) -> str:
    """Write a value and how far its farther limit is, to two digits of that."""
    half = or_nan(farther)
    if not half > 0:
        return f"{value:.5g}"
    return f"{with_error(value, half)} ± " + f"{half:#.2g}".rstrip(".")


def forecast_sentences(forecasts: Sequence[Forecast]) -> list[str]:
    """Say which parameters are identifiable, and why the others are not."""
    rated, refused = dict[str, list[str]](), dict[str, list[str]]()
    for forecast in forecasts:
        reason = ": ".join(filter(None, (forecast.why, forecast.mend)))
        group, key = (
            (refused, reason) if forecast.half_width is None else (rated, str(forecast.word))
        )
        group.setdefault(key, []).append(forecast.name)
    text = "; ".join(
        f"{', '.join(rated[word])} {word}" for word in Identifiability if word in rated
    )
    lacks = [f"Not identifiable: {', '.join(names)}, as {why}." for why, names in refused.items()]
    return [f"Before the fit: {text}.", *lacks] if text else lacks


def forecast_rows(forecasts: Sequence[Forecast]) -> list[tuple[str, ...]]:
    """Format forecasts; none if all but given values are refused: `forecast_sentences` say why."""
    rows: list[tuple[str, ...]] = []
    for forecast in forecasts:
        width = (
            "over 100 %"
            if forecast.word is Identifiability.NOT and forecast.half_width is not None
            else ""
        )
        if forecast.name == "delay" and forecast.half_width:
            width = f"± {1e3 * forecast.half_width:.2g} ms"
        elif forecast.word in {Identifiability.IDENTIFIABLE, Identifiability.WEAK}:
            width = f"± {upwards(forecast.expected or 0.0)}"
        rows.append((forecast.name, forecast.meaning, str(forecast.word), width, forecast.mend))
    determined = [
        forecast.word is not Identifiability.KNOWN and forecast.half_width is not None
        for forecast in forecasts
    ]
    return rows if any(determined) else []


def physical_table(parameters: PhysicalParameters, zeros: Mapping[str, float]) -> PageTable:
    """Tabulate physical parameters, then encoder zeros in rad, if any."""
    given = any(parameter.given is not None for parameter in parameters.parameters)
    rows = [
        (
            parameter.name,
            with_limit(parameter.value, parameter.half_width),
            *(["" if parameter.given is None else str(parameter.given)] * given),
            parameter.unit,
            SYMBOLS[parameter.name].meaning,
        )
        for parameter in parameters.parameters
    ]
    if zeros:
        ends = dict.fromkeys(
            f"{round(extreme(zeros.values()), 4) + 0.0:.4f}" for extreme in (min, max)
        )
        unknown = [""] * given
        rows.append(
            ("zero", " to ".join(ends), *unknown, "rad", "encoder's angle less the model's")
        )
    caption = "Derived from the parameters, and from what is known of motor and joint."
    headers = ("", "value ± 95 %", *(["given"] * given), "unit", "meaning")
    return PageTable(PHYSICAL_TITLE, headers, rows, caption=caption, name="physical")


def physical_numbers(parameters: PhysicalParameters) -> dict[str, dict[str, Any]]:
    """Return the same for programs, by name."""
    return {
        parameter.name: {
            "value": parameter.value,
            "standard_error": or_none(parameter.standard_error),
            "lower": or_none(parameter.value - parameter.half_width),
            "upper": or_none(parameter.value + parameter.half_width),
            "told": parameter.given and plain(parameter.given),
            "unit": parameter.unit,
        }
        for parameter in parameters.parameters
    }


def physical_sentences(parameters: PhysicalParameters) -> list[str]:
    """Say what is left open, and which measurement would determine it."""
    return [
        _SENTENCES[gap.missing].format(
            names=" and ".join(gap.names),
            has="has" if len(gap.names) == 1 else "have",
            most=f" k_emf is at most {gap.most.value:.3g} V s/rad." if gap.most else "",
        )
        for gap in parameters.unidentified
    ]


_SENTENCES = {
    Missing.MASS: (
        "m_p and l_c enter only as p3 = m_p g l_c, J_p and m_p l_c² only as their sum in p1: weigh "
        "the moving part (hand_mass)."
    ),
    Missing.GRAVITY: (
        "Without gravity in the plane of motion l_c and J_p stay unknown, even if the moving part "
        "is weighed: log it with its axis level."
    ),
    Missing.ROTOR: (
        "The load's inertia and the rotor's N² J_r enter only as their sum p1: take J_r from the "
        "motor's data sheet (rotor_inertia)."
    ),
    Missing.ROTOR_OF_SLIDE: (
        "The sliding mass and the rotor's N² J_r enter only as their sum p1: weigh the slide "
        "(hand_mass), or take J_r from the motor's data sheet (rotor_inertia)."
    ),
    Missing.GAIN: (
        "k_t and R enter only as p4 = N k_t/R: measure R at standstill (resistance), or take k_t "
        "from the motor's data sheet (torque_constant)."
    ),
    Missing.BACK_EMF: (
        "k_f and the back EMF enter only as p2 = k_f + N k_emf p4: turn the motor and read the "
        "voltage on its open leads (back_emf_constant; without losses equal to k_t in SI units)."
        "{most}"
    ),
    Missing.GEAR: "The motor of a slide needs its gear ratio first, in rad per m (gear_ratio).",
    Missing.COMMAND: (
        "The unit of the command is unknown. Give p4 if you know it: 1 where the command is N m at "
        "the joint, the gear ratio where it is N m at the motor, N k_t where it is A."
    ),
    Missing.SUPPLY: (
        "R, k_t and k_emf of a duty command need its supply (the column supply, or supply of the "
        "loop): p4 = N k_t/R is then per V."
    ),
    Missing.UNUSED: (
        "{names} {has} no effect here: the command is a torque or a current, and the current loop "
        "hides R and back EMF."
    ),
}


def model_table(identified: Identified) -> PageTable:
    """Tabulate attributes of the robot's model: identified, and in the file; empty without one."""
    facts = facts_of(identified)
    if facts is None:
        return PageTable()
    rows = [
        (
            f"{row.name} {row.attribute}" if row.element != "joint" else row.attribute,
            with_limit(row.value, row.half_width) if math.isfinite(row.half_width) else "–",
            "" if row.now is None else f"{row.now:.5g}",
            row.unit,
            _place(row),
        )
        for row in model_rows(identified)
    ]
    headers = ("", "value ± 95 %", "in the file", "unit", "")
    title = f"Joint {facts.joint!r} of {facts.file}"
    caption = "Attributes of the model: what was identified, and what its file says."
    return PageTable(title, headers, rows, caption=caption, name="model")


def _place(row: ModelRow) -> str:
    """Say how the file's value and the interval lie."""
    if row.inside is None or row.now is None:
        return ""
    if row.inside:
        return "the file agrees"
    return "not in the file" if row.now == 0 else "the file differs"


def model_sentences(identified: Identified) -> Iterator[str]:
    """Say what was taken from the model, and what was assumed of the other joints."""
    facts = facts_of(identified)
    if facts is None:
        return
    share = f"{100 * facts.links.uncertainty:.3g} %"
    how = "each independently" if facts.links.independent else "with one common factor"
    yield f"Masses of the links are taken from {facts.file}, ± {share}, {how}."
    if facts.others:
        first, several = facts.poses[0].pose, len(facts.poses) > 1
        at = ", ".join(f"{name} {angle:.4g}" for name, angle in first.items())
        yield f"Pose of the other joints{f' (first of {len(facts.poses)})' * several}: {at}."
    yield from facts.warnings


_WITH_MASS = ("the added mass's own inertia", "its arm", "the clock", "a moving base")
_FRICTION = ("a friction term missing in the model",)
_PLAY = ("backlash", "an eccentric encoder")
_WARM = ("friction that changes within a log (warm-up)",)
_RESONANCE = ("an elastic joint", "a moving base")  # which make a gain grow; a lag lowers it
_SCATTER = ("a varying resistance", "drive saturation", "a moving base")
_FOLLOWS = {
    Condition.MASS: "the added mass",
    Condition.COMMAND: "the command",
    Condition.SWING: "the swing",
    Condition.FREQUENCY: "the frequency",
    Condition.SPEED: "the speed",
    Condition.TIME: "time in the log",
    Condition.DIRECTION: "the sign of the input",
    Condition.LOG: "the log",
    Condition.REGIME: "the clock's mean sampling interval",
}

_CAUSES: dict[tuple[Condition, str], tuple[str, ...]] = {
    (Condition.MASS, "p1"): _WITH_MASS,
    (Condition.MASS, "p2"): ("friction that depends on the load", *_WITH_MASS),
    (Condition.MASS, "p3"): ("wrong masses", *_WITH_MASS),
    (Condition.MASS, "p4"): ("the motor's resistance", "wrong masses", *_WITH_MASS),
    (Condition.MASS, "coulomb"): ("friction that depends on the load", *_WITH_MASS),
    (Condition.SWING, "p1"): _PLAY,
    (Condition.SWING, "p2"): _FRICTION,
    (Condition.SWING, "p3"): ("a spring, such as a cable", *_PLAY),
    (Condition.SWING, "p4"): (*_PLAY, "a spring, such as a cable"),
    (Condition.SWING, "coulomb"): (*_FRICTION, "backlash"),
    (Condition.FREQUENCY, "p1"): ("a moving base", "an elastic joint", "a spring", "drive lag"),
    (Condition.FREQUENCY, "p2"): _FRICTION,
    (Condition.FREQUENCY, "p3"): ("a spring, such as a cable", "a moving base"),
    (Condition.FREQUENCY, "p4"): ("drive lag", "an elastic joint", "a moving base"),
    (Condition.FREQUENCY, "coulomb"): _FRICTION,
    (Condition.REGIME, "delay"): (
        "the two regimes of the clock have different delays (term slow_delay of output-error)",
    ),
    (Condition.TIME, "p4"): ("the motor's resistance, which grows with temperature", "the supply"),
}
"""What may make a parameter follow a condition, the likeliest first."""

_OF_ANY = {
    Condition.WEIGHED: ("a wrong mass", *_WITH_MASS),
    Condition.DIRECTION: (
        "friction that differs between directions",
        "a drive that differs between directions",
    ),
}
"""The same where it does not depend on the parameter."""


def causes(contrast: Contrast) -> tuple[str, ...]:
    """Return what may be the cause of a contrast, the likeliest first; several look alike."""
    condition, name = contrast.condition, contrast.parameter
    if condition is Condition.COMMAND:
        # the condition is 1 over the command: what grows with it falls with the command
        drive = "drive saturation" if contrast.grows else "a dead zone of the drive"
        return (drive,) if name == "p4" else (*_FRICTION, drive)
    if condition is Condition.SPEED:
        # the condition is 1 over the speed; a lag that a faster joint has more of is no gap
        return ("backlash",) if contrast.grows else _FRICTION
    if condition is Condition.LOG:
        return _SCATTER if name == "p4" else ("temperature", "lubrication", "wear")
    if (condition, name) == (Condition.FREQUENCY, "p4") and contrast.grows:
        return _RESONANCE
    return _OF_ANY.get(condition) or _CAUSES.get((condition, name), _WARM)


def contrast_text(contrast: Contrast, estimate: Estimate) -> str:
    """Say in a sentence what follows what, from where to where, and what may be the cause."""
    first, *others = causes(contrast)
    why = f"Possible cause{'s' if others else ''}"
    if contrast.condition is Condition.WEIGHED:
        given, wanted = 1e3 * contrast.first, 1e3 * contrast.last
        return (
            f"The logs with the added mass of {given:.4g} g agree with the others if it is really "
            f"{wanted:.4g} g. {why}: {', '.join([first, *others])}."
        )
    if contrast.play > 0:
        size = f"{contrast.play:.2g} {estimate.joint.way}"
        if estimate.joint is JointKind.HINGE:
            size += f" ({math.degrees(contrast.play):.2g}°)"
        first = f"{first} of about {size}"
    unit = unit_of(contrast.parameter, estimate.input_kind, estimate.joint)
    low, high = contrast.first, contrast.last
    if contrast.condition in {Condition.COMMAND, Condition.SPEED}:  # the condition is 1 over it
        low, high = high, low
    way = f"{'grows' if high > low else 'falls'} with {_FOLLOWS[contrast.condition]}"
    if contrast.condition is Condition.LOG:
        way = "varies between logs"
    digits = _digits(low, high)
    moves = f"{contrast.parameter} {way}, from {low:.{digits}g} to {high:.{digits}g} {unit}"
    return f"{moves}. {why}: {', '.join([first, *others])}."


def _digits(one: float, other: float) -> int:
    """Return how many digits show by how much two values differ: three, or two of that."""
    difference, size = abs(one - other), max(abs(one), abs(other))
    return 3 if not difference else min(max(3, 2 + math.floor(math.log10(size / difference))), 9)


def agreement_table(contrasts: Sequence[Contrast]) -> PageTable:
    """Return a row for each parameter that follows a condition."""
    rows = [
        (
            contrast.parameter,
            _FOLLOWS.get(contrast.condition, "one added mass, as given"),
            f"{contrast.first:.{_digits(contrast.first, contrast.last)}g}",
            f"{contrast.last:.{_digits(contrast.first, contrast.last)}g}",
            f"{100 * contrast.share:.0f} %",
            ", ".join(causes(contrast)),
        )
        for contrast in contrasts
    ]
    columns = ("parameter", "follows", "from", "to", "explains", "possible causes")
    return PageTable("Parameters that differ between conditions", columns, rows, detail=True)
