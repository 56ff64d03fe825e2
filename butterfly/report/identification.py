"""The identification report: one HTML file that opens offline."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from butterfly.experiment.estimate_record import ParameterRecord, or_nan
from butterfly.files import replacing
from butterfly.logs.log import InputKind
from butterfly.model.linear import resonance_frequency
from butterfly.model.terms import TERMS
from butterfly.report.figures import frequency_response_figure, time_figure
from butterfly.report.format import interval, with_error
from butterfly.report.page import render, write_beside
from butterfly.report.words import sentences

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from butterfly.identify.identification import Identification
    from butterfly.model.parameters import LumpedParameters

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
    return rows_of(_records(identification, truth), identification.data.input_kind)


def rows_of(parameters: Sequence[ParameterRecord], input_kind: InputKind) -> list[ParameterRow]:
    """Tabulate the records of parameters; ``input_kind`` tells the unit of p4."""
    return [
        ParameterRow(
            symbol=TERMS[each.parameter].symbol,
            unit=unit_of(each.parameter, input_kind),
            value=with_error(each.value, or_nan(each.standard_error)),
            error="–" if each.standard_error is None else f"{each.standard_error:#.2g}",
            interval=interval(or_nan(each.lower), or_nan(each.upper)),
            left_out=interval(or_nan(each.least_left_out), or_nan(each.largest_left_out)),
            true="" if each.true is None else f"{each.true:.5g}",
            deviation="" if each.deviation is None else f"{100 * each.deviation:+.2f} %",
        )
        for each in parameters
    ]


def unit_of(parameter: str, input_kind: InputKind) -> str:
    """Return the unit of a parameter, that of the input filled in."""
    return TERMS[parameter].unit.replace("unit", _INPUT_UNITS[input_kind])


def summary(identification: Identification) -> list[str]:
    """Say in plain words what was found."""
    fit, data = identification.summary, identification.data
    flagged = sum(bool(health.findings) for health in data.health)
    voltage = data.input_kind == "voltage"
    return [
        f"{len(data.logs)} logs with {len(data.masses)} added masses, driven by "
        f"{'voltage' if voltage else 'torque command'}, "
        f"method: {identification.estimate.method}.",
        f"Simulated from the first sample on with the recorded input alone, the model follows "
        f"the measured angle with a median FIT of {fit.median:.1f} % (mean {fit.mean:.1f} %, "
        f"worst {fit.worst:.1f} %); 100 % is perfect, 0 % no better than a constant.",
        *sentences(identification.estimate),
        f"{flagged} of {len(data.logs)} logs have findings in their health record.",
    ]


def write_report(
    identification: Identification, path: Path, truth: LumpedParameters | None = None
) -> None:
    """Write the report of an identification: one HTML file, pictures and numbers beside it.

    Parameters
    ----------
    identification
        The result.
    path
        The file; its folder is made if need be.
    truth
        True parameters, where they are known.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    estimate, rows = identification.estimate, parameter_rows(identification, truth)
    parameters = estimate.parameters
    runs, data = identification.free_runs, identification.data
    response = frequency_response_figure(identification)
    series = [time_figure(run) for run in runs]
    middle = int(np.argsort(identification.fits)[len(runs) // 2])
    page = render(
        "identification.html.j2",
        name=data.name,
        description=data.description,
        kind="identification",
        summary=summary(identification),
        parameters=rows,
        own={name: row.value for name, row in zip(estimate.names, rows, strict=True)},
        with_truth=truth is not None,
        resonances=[
            {
                "mass": str(mass),
                "linearised": f"{resonance_frequency(parameters.with_added_mass(mass)):.4f}",
                "thesis": f"{identification.estimate.resonances.get(mass, np.nan):.4f}",
                "equilibrium": f"{angle:.4f}",
            }
            for mass, angle in data.equilibria.items()
        ],
        with_thesis=bool(identification.estimate.resonances),
        comparisons=identification.comparisons,
        fit=identification.summary,
        logs=list(zip(data.points, data.health, runs, strict=True)),
        first=middle,
        response=response.to_json(),
        series=[figure.to_json() for figure in series],
    )
    pictures = {"frequency-response": response, "time": series[middle]}
    write_beside(path, pictures, _numbers(identification, truth))
    with replacing(path) as draft:
        draft.write_text(page, encoding="utf-8")


def _numbers(identification: Identification, truth: LumpedParameters | None) -> dict[str, Any]:
    """Return what the report says, for programs."""
    estimate, fit = identification.estimate, identification.summary
    return {
        "method": estimate.method,
        "parameters": {each.parameter: each.numbers() for each in _records(identification, truth)},
        "fit": {"median": fit.median, "mean": fit.mean, "worst": fit.worst},
        "fits": {run.log.name: run.fit for run in identification.free_runs},
        "ending": estimate.ending,
        "findings": [asdict(finding) for finding in estimate.findings],
        "verdict": sentences(estimate),
    }


def _records(
    identification: Identification, truth: LumpedParameters | None
) -> tuple[ParameterRecord, ...]:
    return ParameterRecord.all_of(identification.estimate, truth)
