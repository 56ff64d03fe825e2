"""Answers that are a table and rest on an estimate, as numbers for programs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from butterfly.document import Told
from butterfly.identification.data import DataSet
from butterfly.identification.design import Candidate
from butterfly.identification.diagnostics.findings import Finding
from butterfly.identification.diagnostics.misfit import Misfit
from butterfly.identification.estimate import Estimate, left_out_content
from butterfly.identification.estimators import Estimator
from butterfly.identification.free_run import FitSummary
from butterfly.identification.identification import about_data, chosen_options
from butterfly.identification.identify import held_out_fits
from butterfly.identification.validate import Bootstrap, CrossValidation, Structure
from butterfly.logs.log import Log
from butterfly.report.finding_texts import estimate_verdict, values_of
from butterfly.report.format import fit_text
from butterfly.report.numbers.estimate_numbers import (
    estimate_numbers,
    misfit_numbers,
    misfit_units,
)
from butterfly.report.summary import best_experiment_text, chosen_terms_text, held_out_sentences

_FIT_UNITS = {"fit": "%", "fit.horizon": "s", "fits": "%", "held_out": "%"}


def rests_on(
    data: DataSet,
    estimate: Estimate,
    estimator: Estimator | None = None,
    *,
    more: Sequence[Finding] = (),
) -> dict[str, Any]:
    """Return what every answer says of the data and the estimate that it rests on."""
    return {
        "data": about_data(data),
        "chosen": chosen_options(estimator, estimate),
        **estimate_numbers(estimate, more=more),
    }


def told_validation(
    data: DataSet,
    estimator: Estimator,
    held: CrossValidation,
    whole: Estimate,
    drawn: Bootstrap | None = None,
) -> Told:
    """Tell what was held out, beside an estimate from all logs, and intervals by bootstrap."""
    predictor = data.simulations
    seen = predictor.fits(whole)
    rows = [
        {**about(log), "FIT seen in %": float(inside), "FIT left out in %": float(outside)}
        for log, inside, outside in zip(data.logs, seen, held.fits, strict=True)
    ]
    within = FitSummary.of(seen, predictor.horizon(whole))
    without, judged = held.summary, estimate_verdict(whole)
    unused = held_out_fits(data, whole)
    return Told(
        kind="validation",
        title=f"{estimator.label} of {data.name!r}, {held.division.left_out} at a time",
        verdict=judged,
        summary=(
            judged.sentence,
            held.division.said,
            f"What was left out is followed with a median FIT{without.over} of "
            f"{fit_text(without.median)} % (mean {fit_text(without.mean)} %, worst "
            f"{fit_text(without.worst)} %); those that were seen, {fit_text(within.median)} %.",
            *held_out_sentences(unused),
        ),
        content={
            **rests_on(data, whole, estimator),
            "left_out": _refits(held),
            "fit": {"seen": within.numbers(), "left_out": without.numbers()},
            "held_out": unused,
            "bootstrap": drawn and _intervals(whole, drawn),
            "rows": rows,
        },
        units=_FIT_UNITS,
    )


def _refits(held: CrossValidation) -> list[dict[str, Any]]:
    return [
        part
        for name, found in held.estimates.items()
        for part in left_out_content(found.names, {name: found.values})
    ]


def _intervals(whole: Estimate, drawn: Bootstrap) -> dict[str, Any]:
    rows = zip(whole.names, drawn.lower.tolist(), drawn.upper.tolist(), strict=True)
    return {name: {"lower": lower, "upper": upper} for name, lower, upper in rows}


def told_residual(
    data: DataSet,
    estimator: Estimator | None,
    found: Estimate,
    misfit: Misfit,
    said: Sequence[str],
) -> Told:
    """Tell what an estimate leaves over of the logs."""
    judged = estimate_verdict(found)
    about_estimate = rests_on(data, found, estimator, more=misfit.findings)
    return Told(
        kind="residual",
        title=f"What {found.method} leaves over of {data.name!r}",
        verdict=judged,
        summary=(judged.sentence, *said),
        content={**misfit_numbers(misfit, values_of(found)), **about_estimate},
        units=misfit_units(data.joint, ""),
    )


def told_design(
    data: DataSet,
    estimator: Estimator | None,
    found: Estimate,
    ranked: Sequence[Candidate],
) -> Told:
    """Tell candidates: standard errors after each, over those now."""
    rows = [
        {
            "added mass": str(each.added_mass),
            "input": each.what,
            f"swing in {data.joint.way}": each.swing,
            "mean": each.score,
            **dict(zip(found.names, map(float, each.errors), strict=True)),
            "warning": each.warning,
        }
        for each in ranked
    ]
    judged = estimate_verdict(found)
    return Told(
        kind="design",
        title=f"Next experiments after {data.name!r}: standard errors over those now",
        verdict=judged,
        summary=(judged.sentence, best_experiment_text(ranked[0])),
        content={**rests_on(data, found, estimator), "rows": rows},
        units={"rows.mean": "1"} | {f"rows.{name}": "1" for name in found.names},
    )


def told_selection(
    data: DataSet,
    estimator: Estimator,
    candidates: Sequence[str],
    passed: Sequence[Structure],
    found: Estimate,
) -> Told:
    """Tell the sets of terms that were passed through, the last being the one that is chosen."""
    judged = estimate_verdict(found)
    rows = [
        {
            "terms": list(each.terms),
            "in_sample": each.in_sample.numbers(),
            "left_out": {str(split): fit.numbers() for split, fit in each.held_out.items()},
        }
        for each in passed
    ]
    return Told(
        kind="selection",
        title=f"Terms chosen for {data.name!r} by {estimator.method}",
        verdict=judged,
        summary=(judged.sentence, chosen_terms_text(passed)),
        content={
            **rests_on(data, found, estimator),
            "candidates": list(candidates),
            "rows": rows,
        },
        units={"rows.in_sample": "%", "rows.left_out": "%"},
    )


def about(log: Log) -> dict[str, Any]:
    """Name a log and what was done in it."""
    sine = log.excitation
    return {
        "log": log.name,
        "added mass in kg": log.added_mass.mass,
        "frequency in rad/s": sine.omega if sine else np.nan,
    }
