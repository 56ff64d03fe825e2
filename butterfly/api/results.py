"""What validate, design, select and residual answer, and the physical parameters."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from operator import itemgetter
from statistics import mean, median
from typing import Any

import numpy as np

from butterfly.files import finite
from butterfly.identification.data import DataSet
from butterfly.identification.design import Candidate, Plan
from butterfly.identification.estimate import Estimate, left_out_content
from butterfly.identification.estimators import Estimator
from butterfly.identification.free_run import FitSummary
from butterfly.identification.identify import held_out_fits
from butterfly.identification.parameter import unit_of
from butterfly.identification.physical import PhysicalParameters
from butterfly.identification.residuals import residual_units, residuals_of
from butterfly.identification.validate import Bootstrap, CrossValidation, Structure
from butterfly.logs.log import Log
from butterfly.report.finding_texts import estimate_verdict
from butterfly.report.format import cell_text, counted, fit_text, label_of, with_error
from butterfly.report.numbers import RESIDUAL_CAPTION, residual_numbers, residual_row, rests_on
from butterfly.report.page import Fact, PageTable, views
from butterfly.report.parameter_table import PHYSICAL_TITLE, physical_numbers, physical_sentences
from butterfly.report.summary import (
    held_out_sentences,
    medians_of,
    next_run_text,
    selection_texts,
)
from butterfly.result import Answer
from butterfly.verdict import Verdict

_ERROR = "error in % of the motion"  # column
_SAID_BY_LABEL = {"log", "added mass in kg", "frequency in rad/s"}
_SEEN, _HELD_OUT = "FIT in sample in %", "FIT held out in %"  # columns
_WELL = 90  # % FIT of a well-predicted log

Row = Mapping[str, Any]


def about_log(log: Log) -> dict[str, Any]:
    """Return the first cells of a log's row: name, added mass and frequency."""
    sine = log.excitation
    return {
        "log": log.name,
        "added mass in kg": log.added_mass.mass,
        "frequency in rad/s": sine.omega if sine else np.nan,
    }


def of_logs(title: str, rows: Sequence[Row], *names: str, **more: Any) -> PageTable:  # noqa: ANN401
    """Tabulate rows of logs, each by its short name; only ``names`` of their columns if given."""
    chosen = names or [name for name in rows[0] if name not in _SAID_BY_LABEL]
    columns: dict[str, Callable[[Row], object]] = {name: itemgetter(name) for name in chosen}
    return PageTable.of(title, rows, {"log": label_of, **columns}, **more)


def fit_facts(rows: Sequence[Row], column: str, label: str) -> list[Fact]:
    """Return median and worst of a column of FITs."""
    fits = {row["log"]: row[column] for row in rows if row[column] is not None}
    if not fits:
        return []
    worst = min(fits, key=lambda name: fits[name])
    return [
        Fact(f"FIT {label}, median", f"{fit_text(median(fits.values()))} %"),
        Fact(f"FIT {label}, worst", f"{fit_text(fits[worst])} %", worst.rsplit("/", 1)[-1]),
    ]


def validation_answer(
    data: DataSet,
    estimator: Estimator,
    held: CrossValidation,
    whole: Estimate,
    drawn: Bootstrap | None = None,
) -> Answer:
    """Tabulate FITs in sample and held out, the estimate from all logs, and its bootstrap."""
    seen, horizon = data.simulations.fits(whole), data.simulations.horizon(whole)
    within, without, left_out = FitSummary.of(seen, horizon), held.summary, held.division.left_out
    unused, verdict = held_out_fits(data, whole), estimate_verdict(whole)
    rows = finite(
        [
            {**about_log(log), _SEEN: float(seen[k]), _HELD_OUT: float(held.fits[k])}
            for k, log in enumerate(data.logs)
        ]
    )
    parts = [
        part
        for name, estimate in held.estimates.items()
        for part in left_out_content(estimate.names, {name: estimate.values})
    ]
    title = f"{estimator.label} of {data.name!r}, {left_out} at a time"
    fits: dict[str, Sequence[float]] = {"in sample": seen.tolist(), left_out: held.fits.tolist()}
    fits["held out by name"] = [*unused.values()]
    facts = [
        *fit_facts(rows, _HELD_OUT, "held out"),
        *fit_facts(rows, _SEEN, "in sample")[:1],
        Fact("held out at a time", left_out.removesuffix(" held out")),
        Fact("logs", str(len(rows))),
        Fact("method", estimator.label),
    ]
    tables = [
        of_logs(title, rows, detail=True),
        PageTable(
            f"{data.name}: FIT in %{within.over}",
            ("", "median", "mean", "worst", f"above {_WELL} %"),
            [(name, *_fit_cells(column)) for name, column in fits.items() if column],
        ),
        _estimates_table(data, whole, parts),
    ]
    if drawn is not None:
        tables.append(_bootstrap_table(data, whole, drawn))
    return Answer(
        kind="validation",
        title=title,
        summary=(
            *verdict.after(
                f"Held-out median FIT{without.over} {fit_text(without.median)} % (mean "
                f"{fit_text(without.mean)} %, worst {fit_text(without.worst)} %); in-sample "
                f"median FIT {fit_text(within.median)} %."
            ),
            held.division.sentence,
            *held_out_sentences(unused),
        ),
        judged=verdict,
        content={
            **rests_on(data, whole, estimator),
            "left_out_together": left_out,
            "left_out": parts,
            "fit": {"seen": within.numbers(), "left_out": without.numbers()},
            "held_out": unused,
            "bootstrap": drawn
            and {
                name: {"lower": float(drawn.lower[k]), "upper": float(drawn.upper[k])}
                for k, name in enumerate(whole.names)
            },
            "rows": rows,
            **views(tables, facts, "fits"),
        },
        units={"fit": "%", "fit.horizon": "s", "fits": "%", "held_out": "%"},
    )


def _fit_cells(fits: Sequence[float]) -> tuple[str, ...]:
    """Return median, mean and worst FIT in %, and how many logs are predicted well."""
    known = [fit for fit in fits if np.isfinite(fit)]
    numbers = [of(known) for of in (median, mean, min)] if known else [None] * 3
    return (*map(fit_text, numbers), f"{sum(fit > _WELL for fit in known)} of {len(known)}")


def _estimates_table(data: DataSet, whole: Estimate, parts: Sequence[Row]) -> PageTable:
    """Tabulate the estimates from all logs, and without each part."""
    estimates = {"nothing": whole.named} | {part["without"]: part["values"] for part in parts}
    names = dict.fromkeys(name for values in estimates.values() for name in values)
    columns: dict[str, Callable[[str], object]] = {"": str}
    columns |= {part: values.get for part, values in estimates.items()}
    columns["unit"] = lambda name: unit_of(name, data.input_kind, data.joint)
    return PageTable.of("Estimates by held-out part", [*names], columns)


def _bootstrap_table(data: DataSet, whole: Estimate, drawn: Bootstrap) -> PageTable:
    """Tabulate values with the limits of their intervals, to the digits that tell them apart."""
    rows = []
    for name, *numbers in zip(whole.names, whole.values, drawn.lower, drawn.upper, strict=True):
        _, lower, upper = numbers
        cells = [with_error(float(number), (upper - lower) / 4) for number in numbers]
        rows.append((name, *cells, unit_of(name, data.input_kind, data.joint)))
    headers = ("", "estimate", "lower", "upper", "unit")
    return PageTable("95 % intervals by bootstrap over logs", headers, rows)


def design_answer(
    data: DataSet,
    estimator: Estimator | None,
    estimate: Estimate,
    ranked: Sequence[Plan[Candidate]],
    *,
    goal: float,
    now: float,
) -> Answer:
    """Tabulate next runs, the cheapest way first; ``goal``: share, ``now``: largest half-width."""
    verdict = estimate_verdict(estimate)
    rows = finite(
        [
            {
                "added mass": str(plan.recipe.log.added_mass),
                "input": plan.recipe.what,
                f"swing in {data.joint.way}": plan.recipe.swing,
                "runs": plan.runs,
                "robot time in s": round(plan.seconds),
                "reached in %": 100 * goal * plan.expected[1],
                **dict(zip(estimate.names, map(float, plan.errors), strict=True)),
                "warning": plan.recipe.warning,
            }
            for plan in ranked
        ]
    )
    best, title = rows[0], f"Next runs for {data.name!r}"
    title += ": standard errors after one over the present ones"
    cells = [
        (str(k), *(f"{v:.2f}" if isinstance(v, float) else cell_text(v) for v in row.values()))
        for k, row in enumerate(rows, start=1)
    ]
    reached, current, aim = map(cell_text, (best["reached in %"], 100 * now, 100 * goal))
    facts = [
        Fact("next run", best["input"], best["added mass"]),
        Fact("robot time", f"{best['robot time in s']} s", counted(best["runs"], "run")),
        Fact("largest half-width after", f"{reached} %", f"now {current} %, goal {aim} %"),
        Fact("candidates", str(len(rows))),
    ]
    return Answer(
        kind="design",
        title=title,
        summary=verdict.after(next_run_text(ranked[0], estimate.names, goal, now)),
        judged=verdict,
        content={
            **rests_on(data, estimate, estimator),
            "goal": goal,
            "half_width": now,
            "rows": rows,
            **views([PageTable(title, ("", *best), cells)], facts, "ranking"),
        },
        units={f"rows.{name}": "1" for name in estimate.names},
    )


def selection_answer(
    data: DataSet,
    estimator: Estimator,
    candidates: Sequence[str],
    passed: Sequence[Structure],
    *,
    estimate: Estimate,
    nested: CrossValidation | None = None,
) -> Answer:
    """Tabulate the sets of terms tried; the last one is chosen."""
    verdict = estimate_verdict(estimate)
    title = f"Terms chosen for {data.name!r} by {estimator.method}"
    answer, *others = selection_texts(passed, nested)
    rows = finite(
        [
            {
                "terms": list(structure.terms),
                "in_sample": structure.in_sample.numbers(),
                "left_out": {str(k): fit.numbers() for k, fit in structure.held_out.items()},
                "gain": None if structure.gain is None else structure.gain._asdict(),
            }
            for structure in passed
        ]
    )
    chosen, medians = ", ".join(rows[-1]["terms"]) or "none", medians_of(rows[-1])
    facts = [
        Fact("terms chosen", chosen, "besides p1..p4, coulomb"),
        *(Fact(f"FIT {name}", f"{fit_text(fit)} %", "median") for name, fit in medians.items()),
    ]
    columns: dict[str, Callable[[Row], object]] = {
        "terms": lambda row: ", ".join(row["terms"]) or "none",
        **{f"FIT {name} in %": _median_fit(name) for name in medians},
        "gain in FIT": lambda row: " ± ".join(map(fit_text, (row["gain"] or {}).values())),
    }
    return Answer(
        kind="selection",
        title=title,
        summary=(*verdict.after(answer), *others),
        judged=verdict,
        content={
            **rests_on(data, estimate, estimator),
            "candidates": list(candidates),
            "rows": rows,
            "nested": None if nested is None else nested.mean._asdict(),
            **views([PageTable.of(title, rows, columns)], facts, "choices"),
        },
        units={"rows.in_sample": "%", "rows.left_out": "%", "rows.gain": "%", "nested": "%"},
    )


def _median_fit(name: str) -> Callable[[Row], str]:
    """Return the cell of a median FIT of a set of terms."""
    return lambda row: fit_text(medians_of(row)[name])


def residual_answer(
    data: DataSet, estimator: Estimator | None, estimate: Estimate, chosen: Sequence[int]
) -> Answer:
    """Analyse the residuals of an estimate, and tabulate those of the chosen logs."""
    from butterfly.report.residual import residual_sentences, with_residual_figures  # noqa: PLC0415 - slow to import

    verdict, residuals = estimate_verdict(estimate), residuals_of(data, estimate)
    worst = max(chosen, key=lambda k: residuals.logs[k].relative)
    title = f"Residuals of {estimate.method} on {data.name!r}"
    rows = finite([about_log(data.logs[k]) | residual_row(residuals.logs[k]) for k in chosen])
    first = max(rows, key=lambda row: math.inf if row[_ERROR] is None else row[_ERROR])
    error, times = (cell_text(first[key]) for key in (_ERROR, "error over sensor noise"))
    facts = [
        Fact("largest error", f"{error} %", f"of the motion, {label_of(first)}"),
        Fact("over sensor noise", f"{times} ×", "encoder resolution and noise"),
        Fact("correlations", "outside" if first["outside its bands"] else "inside", "bands"),
    ]
    return Answer(
        kind="residual",
        title=title,
        summary=(*verdict.lines, *residual_sentences(residuals)),
        judged=verdict,
        content={
            **rests_on(data, estimate, estimator),
            "rows": rows,
            "residuals": residual_numbers(residuals, estimate),
            **views([of_logs(title, rows, caption=RESIDUAL_CAPTION)], facts),
        },
        units=residual_units(data.joint),
        live=partial(with_residual_figures, data, estimate, worst, residuals.logs[worst]),
    )


def physical_answer(parameters: PhysicalParameters, name: str, judged: Verdict) -> Answer:
    """Tabulate the physical parameters of the robot of some data, and say what is left open."""
    rows = finite([{"parameter": k} | row for k, row in physical_numbers(parameters).items()])
    title = f"{PHYSICAL_TITLE} of {name!r}"
    return Answer(
        kind="physical",
        title=title,
        summary=(*judged.lines, *physical_sentences(parameters)),
        content={"rows": rows, **views([PageTable.of(title, rows)])},
        judged=judged,
    )
