"""What `validate` answers of several estimators: which one predicts best."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from operator import itemgetter
from typing import Any

from butterfly.comparison.leaderboard import Entry, equals
from butterfly.files import finite
from butterfly.model.terms import PARAMETERS
from butterfly.report.finding_texts import estimate_verdict
from butterfly.report.format import fit_text
from butterfly.report.log_table import Row
from butterfly.report.numbers import estimate_numbers
from butterfly.report.page import Fact, PageTable, views
from butterfly.result import Answer
from butterfly.verdict import Level, Verdict


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
    """Return the cell of a FIT, in sample or held out."""
    return lambda row: fit_text(row[name] and row[name][which])


def _value(name: str) -> Callable[[Row], str]:
    """Return the cell of a parameter; a dash where there is no estimate."""

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
