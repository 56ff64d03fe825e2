"""The tables of parameters and of forecasts, and what is left open in words."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

from butterfly.identification.derived_quantities import SYMBOLS
from butterfly.identification.forecast import Forecast, Identifiability
from butterfly.identification.parameter import Parameter, Trust, or_nan, or_none
from butterfly.identification.physical import Missing, PhysicalParameters
from butterfly.model.prior import plain
from butterfly.report.format import interval, limit_text, upwards, with_error
from butterfly.report.page import Marked, PageTable

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
