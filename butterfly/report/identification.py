"""The identification report: one HTML file that opens offline."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from butterfly.experiment.estimate_record import ParameterRecord
from butterfly.files import replacing
from butterfly.model.linear import resonance_frequency
from butterfly.report.figures import frequency_response_figure, time_figure, time_figures
from butterfly.report.misfit import (
    correlation_figure,
    correlation_figures,
    misfit_numbers,
    misfit_sentences,
    misfit_table,
)
from butterfly.report.page import render, write_beside
from butterfly.report.parameter_rows import parameter_rows
from butterfly.report.physical import (
    HEADERS,
    physical_numbers,
    physical_rows,
    physical_sentences,
)
from butterfly.report.words import sentences, summary, verdict_on

if TYPE_CHECKING:
    from pathlib import Path

    from butterfly.identify.identification import Identification
    from butterfly.model.parameters import LumpedParameters


def write_report(
    identification: Identification,
    path: Path,
    truth: LumpedParameters | None = None,
    *,
    figures: bool = False,
) -> None:
    """Write the report of an identification: one HTML file, and its numbers as JSON beside it.

    Parameters
    ----------
    identification
        The result.
    path
        The file; its folder is made if need be.
    truth
        True parameters, where they are known.
    figures
        Whether to write the figures as PNG and SVG too.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    estimate, rows = identification.estimate, parameter_rows(identification, truth)
    parameters = estimate.parameters
    estimated = [name for name in estimate.names if name not in estimate.unestimated]
    runs, data, misfit = identification.free_runs, identification.data, identification.misfit
    response = frequency_response_figure(identification)
    middle = int(np.argsort(identification.fits)[len(runs) // 2])
    page = render(
        "identification.html.j2",
        name=data.name,
        description=data.description,
        kind="identification",
        verdict=verdict_on(estimate),
        summary=[*summary(identification)[1:], *misfit_sentences(misfit)],
        parameters=rows,
        own={name: row.value for name, row in zip(estimated, rows, strict=False)},
        with_truth=truth is not None,
        resonances=[
            {
                "mass": str(mass),
                "linearised": f"{resonance_frequency(parameters.with_added_mass(mass)):.4f}",
                "thesis": f"{identification.estimate.resonances.get(mass, np.nan):.4f}",
                "equilibrium": f"{angle:.4f}" if data.hangs else "–",
            }
            for mass, angle in data.equilibria.items()
        ],
        with_thesis=bool(identification.estimate.resonances),
        comparisons=identification.comparisons,
        fit=identification.summary,
        logs=list(zip(data.points, data.health, runs, strict=True)),
        held_out=identification.held_out,
        first=middle,
        response=response.to_json(),
        series=json.dumps(time_figures(runs)),
        physical=physical_rows(identification.physical) if data.known.physical else [],
        physical_headers=HEADERS,
        unseparated=physical_sentences(identification.physical),
        misfit=misfit_table(misfit.logs),
        correlations=json.dumps(correlation_figures(misfit)),
    )
    drawn = {}
    if figures:
        drawn = {
            "frequency-response": response,
            "time": time_figure(runs[middle]),
            "left-over": correlation_figure(misfit.logs[middle]),
        }
    write_beside(path, drawn, _numbers(identification, truth))
    with replacing(path) as draft:
        draft.write_text(page, encoding="utf-8")


def _numbers(identification: Identification, truth: LumpedParameters | None) -> dict[str, Any]:
    """Return what the report says, for programs."""
    estimate, fit = identification.estimate, identification.summary
    records = ParameterRecord.all_of(estimate, truth)
    return verdict_on(estimate).numbers() | {
        "method": estimate.method,
        "parameters": {each.parameter: each.numbers() for each in records},
        "fit": fit.numbers(),
        "fits": {run.log.name: run.fit for run in identification.free_runs},
        "held_out": identification.held_out,
        "physical": physical_numbers(identification.physical),
        "misfit": misfit_numbers(identification.misfit),
        "ending": estimate.ending,
        "findings": [
            asdict(finding) for finding in (*estimate.findings, *identification.misfit.findings)
        ],
        "summary": sentences(estimate),
    }
