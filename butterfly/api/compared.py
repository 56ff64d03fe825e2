"""What comparisons answer: simulators with logs, and estimators with each other."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from operator import itemgetter
from typing import TYPE_CHECKING, Any

import numpy as np

from butterfly.api.results import Row, about_log, fit_facts, of_logs
from butterfly.comparison.leaderboard import Entry, equals
from butterfly.files import finite
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators import Estimator
from butterfly.identification.residuals import Residuals, residual_units
from butterfly.model.terms import PARAMETERS
from butterfly.report.finding_texts import estimate_verdict
from butterfly.report.format import counted, fit_text, label_of
from butterfly.report.numbers import (
    RESIDUAL_CAPTION,
    RESIDUAL_COLUMNS,
    estimate_numbers,
    residual_numbers,
    residual_row,
    rests_on,
)
from butterfly.report.page import Fact, PageTable, views
from butterfly.result import Answer
from butterfly.verdict import Level, Verdict

if TYPE_CHECKING:
    from butterfly.comparison.three_way import ThreeWay  # with MuJoCo, which is slow


_STEPS = "MuJoCo is stepped as `run` steps it; `export` measures its file in its own steps."


def comparison_answer(
    data: DataSet,
    estimator: Estimator | None,
    compared: Sequence[ThreeWay],
    residuals: Residuals,
    estimate: Estimate,
) -> Answer:
    """Tabulate MuJoCo, the grey-box model and the logs, given the same input."""
    from butterfly.report.residual import residual_sentences  # noqa: PLC0415 - slow to import
    from butterfly.report.three_way_page import with_courses  # noqa: PLC0415 - slow to import

    verdict, way = estimate_verdict(estimate), data.joint.way
    title, column = (
        f"MuJoCo, grey-box model and logs of {data.name!r}",
        f"simulators apart in {way}",
    )
    judged = {log.name: log for log in residuals.logs}
    log_residuals = tuple(judged[one.log.name] for one in compared)
    fits = {name: f"FIT {name} in %" for name in compared[0].fits}
    responses = [*_responses(compared[0])]
    rows = finite(
        [
            {
                **about_log(one.log),
                **{fits[name]: fit for name, fit in one.fits.items()},
                column: one.difference,
                **_responses(one),
                **residual_row(log),
            }
            for one, log in zip(compared, log_residuals, strict=True)
        ]
    )
    errors: dict[str, Callable[[Row], object]] = {"log": label_of}
    errors |= {name: _signed(name) for name in responses}
    tables = [
        of_logs(title, rows, *fits.values(), column),
        PageTable.of("Amplitude and phase", rows, errors, detail=True),
        of_logs("Residuals", rows, *RESIDUAL_COLUMNS, caption=RESIDUAL_CAPTION),
    ]
    difference = f"{max(one.difference for one in compared):.2g} {way}"
    facts = [
        *fit_facts(rows, fits["MuJoCo"], "of MuJoCo"),
        *fit_facts(rows, fits["grey box"], "of the grey box"),
        Fact("MuJoCo − grey box", difference, "largest difference"),
        Fact("logs compared", str(len(rows)), f"of {len(data.logs)}"),
    ]
    return Answer(
        kind="comparison",
        title=title,
        summary=(
            *verdict.after(_comparison_sentence(compared)),
            _STEPS,
            *residual_sentences(replace(residuals, logs=log_residuals)),
        ),
        judged=verdict,
        content={
            **rests_on(data, estimate, estimator),
            "rows": rows,
            "residuals": residual_numbers(residuals, estimate),
            **views(tables, facts, "fits", "frequency"),
        },
        units=residual_units(data.joint),
        live=partial(with_courses, compared, log_residuals),
    )


def _responses(comparison: ThreeWay) -> dict[str, float]:
    """Return how the steady responses of the simulators differ from that of the log."""
    cells = {}
    for name in comparison.fits:
        gain = comparison.gains.get(name, complex(np.nan, np.nan))
        cells[f"amplitude error {name} in %"] = float(100 * (np.abs(gain) - 1))
        cells[f"phase error {name} in °"] = float(np.degrees(np.angle(gain)))
    return cells


def _signed(name: str) -> Callable[[Row], str]:
    """Return the cell of an error, with its sign; a dash for none."""
    return lambda row: "–" if row[name] is None else f"{row[name]:+.2g}"


def _comparison_sentence(compared: Sequence[ThreeWay]) -> str:
    """State how far the simulators are from each other, and the fit of both."""
    difference = max(comparison.difference for comparison in compared)
    way = compared[0].log.added_mass.joint.way
    fits = {
        key: np.array([comparison.fits[key] for comparison in compared]) for key in compared[0].fits
    }
    medians = ", ".join(
        f"{key} {np.median(fit):.2f} % (worst {fit.min():.2f} %)" for key, fit in fits.items()
    )
    return (
        f"MuJoCo and grey box differ by at most {difference:.2g} {way}, with the same parameters "
        f"and recorded input of {counted(len(compared), 'log')}. Median FIT: {medians}."
    )


def ranking_answer(entries: Sequence[Entry]) -> Answer:
    """Tabulate the ranked estimators of each data set, the best of each first."""
    sets = {entry.data: [e for e in entries if e.data == entry.data] for entry in entries}
    verdict = Verdict.of_several(
        {
            f"{name}, {entry.method}": estimate_verdict(entry.estimate)
            if entry.estimate
            else Verdict(Level.WARNING, (entry.error,))
            for name, (entry, *_) in sets.items()
        }
    )
    winners = {name: [entry.method for entry in equals(ranked)] for name, ranked in sets.items()}
    title, rows = "Ranking of methods: " + ", ".join(sets), finite([*map(_entry, entries)])
    facts = []
    for name, methods in winners.items():
        if (fit := sets[name][0].held_out) is not None:
            label = "predict best, no clear winner" if len(methods) > 1 else "predicts best"
            detail = f"held out: median FIT {fit_text(fit.median)} %, {name}"
            facts.append(Fact(label, ", ".join(methods), detail))
    facts.append(Fact("methods", str(len({entry.method for entry in entries}))))
    facts.append(Fact("data sets", str(len(sets))))
    return Answer(
        kind="leaderboard",
        title=title,
        summary=verdict.after(*map(_best_sentence, sets.values())),
        judged=verdict,
        content={
            "entries": rows,
            "winners": winners,
            **views([PageTable.of(title, rows, _RANKED)], facts, "leaderboard"),
        },
        units={"entries.held_out": "%", "entries.in_sample": "%", "entries.seconds": "s"},
    )


def _median_or_worst(name: str, which: str) -> Callable[[Row], str]:
    return lambda row: fit_text(row[name] and row[name][which])


def _value(name: str) -> Callable[[Row], str]:
    def text(row: Row) -> str:
        parameters = row.get("parameters") or {}
        return f"{parameters[name]['value']:#.4g}" if name in parameters else "–"

    return text


_RANKED: dict[str, Callable[[Row], object]] = {
    "estimator": itemgetter("method"),
    "data": itemgetter("data"),
    "verdict": itemgetter("verdict"),
    **{
        f"FIT {name.replace('_', ' ')}, {which} in %": _median_or_worst(name, which)
        for name in ("held_out", "in_sample")
        for which in ("median", "worst")
    },
    "time in s": lambda row: f"{row['seconds']:.2f}",
    **{name: _value(name) for name in PARAMETERS[:5]},
    "remark": itemgetter("error"),
}
"""Columns of a ranking, each of an entry."""


def _best_sentence(entries: Sequence[Entry]) -> str:
    """Name the methods with the best held-out FIT on a data set."""
    best, equal = entries[0], equals(entries)
    if best.held_out is None:
        return f"{best.data}: no method could predict the held-out logs."
    fit = f"median FIT{best.held_out.over} {best.held_out.median:.1f} %"
    how = f"{fit} ({best.left_out} at a time)"
    if len(equal) == 1:
        return f"{best.data}: {best.method} predicts held-out logs best, {how}."
    names = " and ".join(entry.method for entry in equal)
    return f"{best.data}: no clear winner; {names} do not differ significantly, {how}."


def _entry(entry: Entry) -> dict[str, Any]:
    numbers: dict[str, Any] = {"verdict": None, "reasons": []}
    if entry.estimate is not None:
        numbers = estimate_verdict(entry.estimate).numbers() | estimate_numbers(entry.estimate)
    return {
        **numbers,
        "data": entry.data,
        "method": entry.method,
        "left_out_together": entry.left_out or None,
        "seconds": entry.seconds,
        "error": entry.error,
        "held_out": entry.held_out and entry.held_out.numbers(),
        "in_sample": entry.in_sample and entry.in_sample.numbers(),
    }
