"""`validate` and `select`: how well estimators predict unseen logs, and which does it best."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from operator import itemgetter
from statistics import mean, median
from typing import Any

import numpy as np

from butterfly.api.sources import Data, read
from butterfly.api.verbs import Method, prepared
from butterfly.arguments import checked
from butterfly.comparison.answers import Entry, equals
from butterfly.errors import InputError
from butterfly.experiment.methods import make_estimator
from butterfly.files import finite
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate, left_out_content
from butterfly.identification.estimators import DEFAULT_METHOD, Estimator
from butterfly.identification.free_run import FitSummary
from butterfly.identification.identify import held_out_fits, judged
from butterfly.identification.trust import DRAWS, unit_of
from butterfly.identification.validate import (
    Bootstrap,
    CrossValidation,
    Split,
    Structure,
    cross_validate,
    cross_validate_choice,
    select_terms,
)
from butterfly.identification.validate import bootstrap as bootstrap_of
from butterfly.model.terms import COMMON, OF_ANGLE, PARAMETERS, offered
from butterfly.progress import Track, untracked
from butterfly.report.finding_texts import estimate_verdict
from butterfly.report.format import fit_text, with_error
from butterfly.report.inspection import Row, about_log, fit_facts, of_logs
from butterfly.report.numbers import estimate_numbers, rests_on
from butterfly.report.page import Fact, PageTable, views
from butterfly.report.summary import held_out_sentences, medians_of, selection_texts
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
    rows, facts = finite([*map(_entry, entries)]), []
    for name, methods in winners.items():
        if (fit := sets[name][0].held_out) is not None:
            label = "predict best, no clear winner" if len(methods) > 1 else "predicts best"
            detail = f"held out: median FIT {fit_text(fit.median)} %, {name}"
            facts.append(Fact(label, ", ".join(methods), detail))
    facts.append(Fact("methods", str(len({entry.method for entry in entries}))))
    facts.append(Fact("data sets", str(len(sets))))
    return Answer(
        kind="leaderboard",
        title=_ranking_title(sets),
        summary=verdict.after(*map(_best_sentence, sets.values())),
        judged=verdict,
        content={
            "entries": rows,
            "winners": winners,
            **views(_ranked_tables([*sets], rows), facts, "leaderboard"),
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
    "verdict": lambda row: row["verdict"] or "no estimate",
    **{
        f"FIT held out, {which} in %": _median_or_worst("held_out", which)
        for which in ("median", "worst")
    },
}
"""Columns of a ranking, each of an entry."""

_RANKED_IN_DETAIL: dict[str, Callable[[Row], object]] = {
    **{
        f"FIT in sample, {which} in %": _median_or_worst("in_sample", which)
        for which in ("median", "worst")
    },
    "time in s": lambda row: f"{row['seconds']:.2f}",
    **{name: _value(name) for name in PARAMETERS[:5]},
    "remark": itemgetter("error"),
}
"""Columns of what each method fitted, each of an entry."""


def _ranking_title(sets: Iterable[str]) -> str:
    return f"Ranking of methods: {', '.join(sets)}"


def _ranked_tables(sets: Collection[str], rows: Sequence[Row]) -> list[PageTable]:
    """Tabulate what predicts best, then what each method fitted to all logs."""
    names: dict[str, Callable[[Row], object]] = {"estimator": itemgetter("method")}
    names |= {"data": itemgetter("data")} if len(sets) > 1 else {}
    fits = f"Fits to all logs: {', '.join(sets)}"
    return [
        PageTable.of(_ranking_title(sets), rows, names | _RANKED),
        PageTable.of(fits, rows, names | _RANKED_IN_DETAIL, detail=True),
    ]


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


_SEEN, _HELD_OUT = "FIT in sample in %", "FIT held out in %"  # columns


_WELL = 90  # % FIT of a well-predicted log


@checked
def validate(
    data: Data,
    method: Method | Sequence[Method] = DEFAULT_METHOD,
    *,
    others: Sequence[Data] = (),
    split: str = Split.AUTO,
    folds: int | None = None,
    holdout: Sequence[str] = (),
    bootstrap: int = 0,
    track: Track = untracked,
    **options: Any,  # noqa: ANN401 - the fields of the estimator
) -> Answer:
    """Cross-validate an estimator on held-out logs, or rank several.

    With several methods or data sets, ranks the methods by their median FIT on held-out logs.

    Parameters
    ----------
    data
        A data set (logs, a folder of logs, a manifest, a saved result, or a shipped name), or
        several to rank methods on. In Python the first, as in `identify`.
    method, holdout, track, options
        As in `identify`; of several methods, each has its defaults.
    others
        More data sets to rank the methods on.
    split
        What to hold out at a time: an added mass (``mass``), sine frequencies (``frequency``), logs
        (``log``), a section of every log (``time``), or the first of these that the data allow
        (``auto``).
    folds
        Number of parts for frequency, log and time. Default: 5, or fewer if the data require it.
    bootstrap
        Number of bootstrap samples of the logs, for 95 % intervals.
    """
    if split not in [*Split]:
        raise InputError("validate", "split", split, " or ".join(Split))
    fewest = DRAWS if bootstrap else 0
    for name, value, least in (("folds", folds, 2), ("bootstrap", bootstrap, fewest)):
        if value is None:
            continue
        if not isinstance(value, int) or isinstance(value, bool) or value < least:
            raise InputError("validate", name, value, f"an integer of {least} or more")
    if others or not isinstance(method, str | Estimator):
        for name, value in {"folds": folds, "bootstrap": bootstrap or None, **options}.items():
            if value is not None:
                expected = "no such option with several methods or data sets"
                raise InputError("validate", name, value, expected)
        from butterfly.comparison.answers import leaderboard  # noqa: PLC0415 - slow to import

        methods = [method] if isinstance(method, str | Estimator) else method
        estimators = [make_estimator(candidate, {}) for candidate in methods]
        if not estimators:
            raise InputError("validate", "method", "none", "at least one method")
        sets = [read(source).holding_out(holdout) for source in (data, *others)]
        return ranking_answer(leaderboard(sets, estimators, split=Split(split), track=track))
    logs, estimator = prepared(data, method, options, holdout)
    (logs, whole), drawn = judged(logs, estimator), None
    held = cross_validate(logs, estimator, Split(split), folds=folds, track=track)
    if bootstrap:
        drawn = bootstrap_of(logs, estimator, whole, repetitions=bootstrap, track=track)
    return validation_answer(logs, estimator, held, whole, drawn)


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


@checked
def select(
    data: Data,
    method: Method = "output-error",
    *,
    candidates: Collection[str] = COMMON,
    holdout: Sequence[str] = (),
    nested: bool = False,
    track: Track = untracked,
    **options: Any,  # noqa: ANN401 - the fields of the estimator
) -> Answer:
    """Choose terms as identify does, and show how well each choice predicts.

    Each round adds the term that improves the prediction of held-out logs most, or removes one that
    does not help. Every set of terms has its FIT in sample and on held-out added masses, or logs.
    The verdict is on the model with the chosen terms.

    Parameters
    ----------
    data, method, holdout, track, options
        As in `identify`, without ``terms``.
    candidates
        Terms to choose from.
    nested
        Nested cross-validation: repeats the choice without each held-out part, for an unbiased FIT
        (slow).
    """
    if isinstance(candidates, str) or not isinstance(candidates, Collection):
        raise InputError("select", "candidates", candidates, f"names, such as {COMMON}")
    logs = read(data).holding_out(holdout)
    estimator = make_estimator(method, options)
    wanted = tuple(candidates)
    if wanted == COMMON:
        able = offered(estimator.method)
        unable = OF_ANGLE if any(log.integrated for log in logs.logs) else ()
        wanted = tuple(name for name in wanted if name in able and name not in unable)
    passed = select_terms(logs, estimator, wanted, track=track)
    chosen = estimator.with_terms(passed[-1].terms)
    _, estimate = judged(logs, chosen)
    anew = cross_validate_choice(logs, estimator, wanted, track=track) if nested else None
    return selection_answer(logs, chosen, wanted, passed, estimate=estimate, nested=anew)


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
