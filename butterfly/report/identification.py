"""The identification report: one HTML file that opens offline."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from butterfly.files import replacing
from butterfly.model.linear import resonance_frequency
from butterfly.model.terms import TERMS
from butterfly.report.figures import frequency_response_figure, time_figure
from butterfly.report.format import interval, with_error
from butterfly.report.page import render, write_beside
from butterfly.report.words import sentences

if TYPE_CHECKING:
    from pathlib import Path

    from butterfly.identify.identification import Identification
    from butterfly.model.parameters import LumpedParameters


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
    estimate = identification.estimate
    errors = estimate.standard_errors
    rows = []
    for k, name in enumerate(estimate.names):
        value, error = float(estimate.values[k]), float(errors[k])
        others = [float(values[k]) for values in estimate.left_out.values()]
        true = None if truth is None else float(getattr(truth, name))
        rows.append(
            ParameterRow(
                symbol=TERMS[name].symbol,
                unit=TERMS[name].unit.replace("unit", _input_unit(identification)),
                value=with_error(value, error),
                error=f"{error:#.2g}" if np.isfinite(error) else "–",
                interval=interval(estimate.lower[k], estimate.upper[k]),
                left_out=interval(min(others), max(others)) if others else "–",
                true="" if true is None else f"{true:.5g}",
                deviation=f"{100 * (value / true - 1):+.2f} %" if true else "",
            )
        )
    return rows


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
    parameters = identification.estimate.parameters
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
        parameters=parameter_rows(identification, truth),
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
    columns = zip(
        estimate.names,
        *(
            each.tolist()
            for each in (
                estimate.values,
                estimate.standard_errors,
                estimate.lower,
                estimate.upper,
            )
        ),
        strict=True,
    )
    return {
        "method": estimate.method,
        "parameters": {
            name: {
                "value": value,
                "standard_error": error,
                "lower": lower,
                "upper": upper,
                "true": None if truth is None else getattr(truth, name),
            }
            for name, value, error, lower, upper in columns
        },
        "fit": {"median": fit.median, "mean": fit.mean, "worst": fit.worst},
        "fits": {run.log.name: run.fit for run in identification.free_runs},
        "ending": estimate.ending,
        "findings": [asdict(finding) for finding in estimate.findings],
        "verdict": sentences(estimate),
    }


def _input_unit(identification: Identification) -> str:
    return "V" if identification.data.input_kind == "voltage" else "unit"
