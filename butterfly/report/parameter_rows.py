"""The parameters of an identification as rows of texts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from butterfly.experiment.estimate_record import ParameterRecord, or_nan
from butterfly.identification.identification import Identification
from butterfly.logs.log import InputKind
from butterfly.model.kinematics import Term
from butterfly.model.parameters import JointKind, LumpedParameters
from butterfly.model.terms import TERMS
from butterfly.report.format import interval, with_error
from butterfly.report.whisker import Whisker

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
_INPUT_UNITS = {InputKind.VOLTAGE: "V", InputKind.TORQUE: "unit"}


@dataclass(frozen=True, kw_only=True)
class ParameterRow:
    """One line of the table of parameters, as text; empty where there is nothing to say.

    ``whisker`` is the same to be drawn.
    """

    symbol: str
    meaning: str
    unit: str
    value: str
    error: str
    interval: str
    width: str
    left_out: str
    true: str
    deviation: str
    whisker: Whisker


def parameter_rows(
    identification: Identification, truth: LumpedParameters | None = None
) -> list[ParameterRow]:
    """Tabulate the estimate, beside the true parameters if they are known."""
    records = ParameterRecord.all_of(identification.estimate, truth)
    return rows_of(records, identification.data.input_kind, identification.data.joint)


def rows_of(
    parameters: Sequence[ParameterRecord],
    input_kind: InputKind,
    joint: JointKind = JointKind.HINGE,
) -> list[ParameterRow]:
    """Tabulate the records of parameters; what drives which joint tells the units."""
    return [
        ParameterRow(
            symbol=TERMS[each.parameter].symbol,
            meaning=_meaning(TERMS[each.parameter], joint),
            unit=unit_of(each.parameter, input_kind, joint),
            value=with_error(each.value, or_nan(each.standard_error)),
            error=_error(each),
            interval="–" if each.known else interval(or_nan(each.lower), or_nan(each.upper)),
            width=_width(each),
            left_out=_left_out(each),
            true="" if each.true is None else f"{each.true:.5g}",
            deviation="" if each.deviation is None else f"{100 * each.deviation:+z.2f} %",
            whisker=_whisker(each),
        )
        for each in parameters
    ]


def _meaning(term: Term, joint: JointKind) -> str:
    """Say in a few words what a parameter is, on a slide of mass and force."""
    said = (term.looks_like or term.meaning).removeprefix("a ").removeprefix("an ")
    if joint is JointKind.HINGE:
        return said
    return said.replace("inertia", "mass that moves").replace("torque", "force")


def _width(record: ParameterRecord) -> str:
    """Return half the interval over the value; of one that may as well be 0, that it may."""
    if record.known or record.lower is None or record.upper is None:
        return "–"
    if record.lower <= 0 <= record.upper:
        return "may be 0"
    if not record.value:
        return "–"
    return f"± {50 * (record.upper - record.lower) / abs(record.value):.2g} %"


def _whisker(record: ParameterRecord) -> Whisker:
    """Return what a figure shows of a parameter; of one that was known there is no interval."""
    lower, upper = (None, None) if record.known else (record.lower, record.upper)
    least, largest = record.least_left_out, record.largest_left_out
    return Whisker(
        value=record.value,
        limits=None if lower is None or upper is None else (lower, upper),
        left_out=None if least is None or largest is None else (least, largest),
        true=record.true,
    )


def _left_out(record: ParameterRecord) -> str:
    if record.least_left_out is None or record.largest_left_out is None:
        return ""
    return interval(record.least_left_out, record.largest_left_out)


def _error(record: ParameterRecord) -> str:
    if record.known:
        return "known"
    return "–" if record.standard_error is None else f"{record.standard_error:#.2g}"


def unit_of(parameter: str, input_kind: InputKind, joint: JointKind = JointKind.HINGE) -> str:
    """Return the unit of a parameter, that of the input filled in; on a slide a way's in m."""
    unit = TERMS[parameter].unit
    if joint is JointKind.SLIDE:
        unit = _ON_SLIDES.get(unit, unit)
    return unit.replace("unit", _INPUT_UNITS[input_kind])
