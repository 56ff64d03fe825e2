"""The parameters of an identification as rows of texts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from butterfly.experiment.estimate_record import ParameterRecord, or_nan
from butterfly.logs.log import InputKind
from butterfly.model.parameters import JointKind
from butterfly.model.terms import TERMS
from butterfly.report.format import interval, with_error

if TYPE_CHECKING:
    from collections.abc import Sequence

    from butterfly.identify.identification import Identification
    from butterfly.model.parameters import LumpedParameters

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
    """One line of the table of parameters, as text; empty where there is nothing to say."""

    symbol: str
    unit: str
    value: str
    error: str
    interval: str
    left_out: str
    true: str
    deviation: str


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
            unit=unit_of(each.parameter, input_kind, joint),
            value=with_error(each.value, or_nan(each.standard_error)),
            error=_error(each),
            interval="–" if each.known else interval(or_nan(each.lower), or_nan(each.upper)),
            left_out=_left_out(each),
            true="" if each.true is None else f"{each.true:.5g}",
            deviation="" if each.deviation is None else f"{100 * each.deviation:+.2f} %",
        )
        for each in parameters
    ]


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
