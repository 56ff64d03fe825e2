"""The report of a sweep: how well the parameters were recovered, against each field that varied."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from operator import itemgetter
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from butterfly.experiment.record import OK, SweepRecord
from butterfly.experiment.sweep_tables import MISSING, Estimates, column
from butterfly.identification.trust import Ending
from butterfly.identification.validate import Gain
from butterfly.report.format import cell_text, counted, field_label, field_name
from butterfly.report.orbit_page import degrees_said, size_text
from butterfly.report.page import Fact, Marked, Page, PageTable, Section, tabulated
from butterfly.report.parameter_table import parameter_table
from butterfly.report.sweep_figures import (
    affected,
    axis_figure,
    heat_maps,
    parallel_figure,
    recovery_figure,
)
from butterfly.result import document
from butterfly.verdict import VERDICTS

if TYPE_CHECKING:
    import pyarrow as pa

_LISTED = 100  # runs in a table of what went wrong
_LEAST = 1e-12  # deviation that is told from 0
_ORBITS = 200  # runs in the table of orbits
_SHOWN = 20  # runs that are printed
_SHARES = ("median_deviation", "rms_deviation", "largest_deviation", "coverage")  # of `recovery`


def sweep_page(sweep: SweepRecord, runs: pa.Table, estimates: pa.Table) -> Page:
    """Put together the report of a sweep of the tables of its result store."""
    table, fields = Estimates.of(estimates, sweep.fields), sweep.fields
    status, recovered = column(runs, "status"), list(table.recovery())
    drawn = recovery_figure(table.deviating)
    summary = _summary(table, status, fields)
    numbers = {
        "data": {"name": sweep.name, "description": sweep.description},
        "seed": sweep.seed,
        "varied": list(sweep.fields),
        "runs": int(status.size),
        "ok": int((status == OK).sum()),
        "verdicts": table.verdicts,
        "unconverged": table.unconverged,
        "recovery": recovered,
    }
    sections = [
        *tabulated("Estimators", _ranking_table(table)),
        *tabulated(
            "Verdicts",
            _verdicts_table(table),
            "How many estimates got which verdict. A verdict comes from the logs alone; it does "
            "not know the true values.",
        ),
        Section(
            title="Recovery of the parameters",
            text="How far the estimates of all runs are from the true values, for parameters whose "
            "true value is not 0. Dot: median; thick line: the middle half of the runs; thin line: "
            "95 % of them. Coverage: the share of 95 % intervals that contain the true value.",
            figures={} if drawn is None else {"recovery": drawn},
            tables=(_recovery_table(recovered),),
        ),
        *_against_fields(table.deviating, fields),
        *tabulated("Worst runs", worst_table(table, fields, sweep.worst)),
        *tabulated("Estimates that did not converge", _unconverged_table(table)),
        *tabulated("Runs without a result", _failures_table(runs)),
        *tabulated("Orbits", _orbits_table(runs)),
    ]
    return Page(
        name=sweep.name,
        description=sweep.description,
        kind="sweep",
        facts=_facts(table, status),
        summary=summary,
        sections=sections,
        numbers=document(
            "sweep",
            f"Sweep {sweep.name!r}",
            numbers,
            summary=summary,
            units={f"recovery.{name}": "1" for name in _SHARES},
        ),
    )


def _against_fields(deviating: Estimates, fields: Sequence[str]) -> list[Section]:
    """Show how estimates deviate by what was varied: all at once, one by one, in pairs."""
    sections = []
    if (together := parallel_figure(deviating, fields)) is not None:
        text = (
            "Each line is an estimate. It crosses the varied fields on the left at their values in "
            "that run, then its largest deviation from the truth and its FIT on the right; its "
            "colour ranks that deviation."
        )
        figures = {"together": together}
        sections.append(Section(title="All fields at once", text=text, figures=figures))
    for number, field in enumerate(fields):
        if len(deviating.distinct(field)) < 2:  # noqa: PLR2004 - nothing varies
            continue
        names = affected(deviating, field)
        flat = [name for name in deviating.distinct("parameter") if name not in names]
        figure = axis_figure(deviating, field, [*names])
        drawn = "Median deviation from the truth; the error bars hold the middle half of the runs."
        text = drawn * (figure is not None)
        text += f"\nNo visible effect on {', '.join(flat)}." * bool(flat)
        figures = {} if figure is None else {f"axis-{number}": figure}
        title = f"Against {field_name(field)}"
        sections.append(Section(title=title, text=text.strip(), figures=figures))
    if maps := heat_maps(deviating, fields):
        text = (
            "A cell has the runs with these two values: the median, over these runs, of the "
            "largest deviation of a parameter from the truth, in %."
        )
        sections.append(Section(title="Two fields at a time", text=text, figures=maps))
    return sections


def _facts(table: Estimates, status: NDArray[Any]) -> list[Fact]:
    """Return the numbers that matter most, as far as there are any."""
    facts = [Fact("runs with a result", f"{int((status == OK).sum())}", f"of {status.size}")]
    size = np.abs(table.deviating["deviation"])
    if size.size:
        coverage = _percent(table.coverage)
        facts += [
            Fact("deviation from the truth", f"{100 * np.median(size):.2g} %", "median"),
            Fact(
                "95 % intervals contain the truth", coverage if coverage == "–" else f"{coverage} %"
            ),
            Fact("FIT of a run's logs", f"{table.median_fit:.2f} %", "median"),
        ]
    return facts


def _verdicts_table(table: Estimates) -> PageTable:
    counts = table.verdicts.items() if table["value"].size else ()
    rows = [(estimator, *map(str, tally.values())) for estimator, tally in counts]
    return PageTable(headers=("estimator", *(level.verdict for level in VERDICTS)), rows=rows)


def _recovery_table(recovered: Sequence[Mapping[str, Any]]) -> PageTable:
    return PageTable.of("", recovered, _RECOVERY, words=(1,))


def closest(table: Estimates) -> list[str]:
    """Return the most accurate estimator, then those not worse by over two standard errors."""
    means: dict[str, dict[float, float]] = {}
    medians: dict[str, float] = {}
    for method in table.estimators:
        group = table.deviating.where(estimator=method)
        size = np.abs(group["deviation"])
        if size.size:
            numbers, run = np.unique(group["number"], return_inverse=True)
            logarithms = np.log(np.maximum(np.bincount(run, size) / np.bincount(run), _LEAST))
            means[method] = dict(zip(numbers.tolist(), logarithms.tolist(), strict=True))
            medians[method] = float(np.median(size))
    first, *others = sorted(medians, key=lambda method: medians[method]) or [""]
    methods = [first] if first else []
    for method in others:
        both = means[first].keys() & means[method].keys()
        farther = np.array([means[method][run] - means[first][run] for run in both])
        gain = Gain.of(farther) if both else None
        methods += [method] if gain is None or not gain.mean > 2 * gain.error else []
    return methods


def _ranking_table(table: Estimates) -> PageTable:
    """Rank estimators, if there are several."""
    rows, equal = [], closest(table)
    for method in table.estimators if len(table.estimators) > 1 else ():
        group = table.where(estimator=method)
        size = np.abs(group.deviating["deviation"])
        middle = float(np.median(size)) if size.size else math.inf
        rows.append((middle, method, group.median_fit, group.coverage))
    return PageTable(
        headers=(
            *("estimator", "median |deviation| in %", "median FIT in %", "coverage in %"),
            "significantly worse than the first",
        ),
        rows=[
            (
                *(method, _percent(size, ".3g"), f"{fit:.2f}", _percent(share)),
                "yes" if method not in equal else "–" if method == equal[0] else "no",
            )
            for size, method, fit, share in sorted(rows, key=lambda row: row[:2])
        ],
        caption="FIT: of the logs that were fitted. Deviations: of all parameters whose true value "
        "is not 0.",
    )


def worst_table(table: Estimates, fields: Sequence[str], count: int) -> PageTable:
    """List the runs with the largest deviation of a parameter."""
    every = table.worst()
    worst = every.take(
        np.argsort(-np.nan_to_num(np.abs(every["deviation"])), kind="stable")[:count]
    )
    runs = zip(worst["number"].tolist(), worst["key"].tolist(), strict=True)
    of_run: dict[Any, Sequence[object]] = {
        "run": [_link(*run) for run in runs],
        "estimator": worst["estimator"].tolist(),
        "median FIT in %": [f"{fit:.1f}" for fit in worst["fit_median"]],
        **{field_label(field): [*map(cell_text, worst[field].tolist())] for field in fields},
    }
    first, second, *others = of_run
    return parameter_table(
        "",
        worst.rows(),
        *(first, second, "parameter", "deviation", *others),
        more=of_run,
        words=(1, 2),
        caption="The number of a run links to its record (JSON), which butterfly inspect "
        "FOLDER/NUMBER prints.",
    )


def _unconverged_table(table: Estimates) -> PageTable:
    rest = table.take(table["ending"] != Ending.CONVERGED)
    names = ("number", "key", "estimator", "ending", "findings")
    estimates = dict.fromkeys(zip(*(rest[name].tolist() for name in names), strict=True))
    return PageTable(
        headers=("run", "estimator", "ending", "findings"),
        rows=[(_link(*run[:2]), *run[2:]) for run in list(estimates)[:_LISTED]],
        words=(1, 2, 3),
        caption=f"{len(estimates)} in all.",
    )


def _link(number: float, key: str) -> Marked:
    """Return a link from a run's number to its record."""
    return Marked(f"{number:.0f}", f"runs/{key[:2]}/{key}.json")


def runs_table(runs: pa.Table, fields: Sequence[str]) -> PageTable:
    """List runs, those with the gravest verdict first, at most `_SHOWN`."""
    columns: dict[str, Callable[[Mapping[str, Any]], object]] = {
        "run": lambda row: row["number"],
        "verdict": lambda row: row["verdict"],
        **{field_label(field): itemgetter(field) for field in fields},
        "without a result": lambda row: None if row["status"] == OK else row["status"],
    }
    worst = {OK: 0, MISSING: -1}
    verdicts = {None: 0} | {level.verdict: k for k, level in enumerate(VERDICTS)}
    rows = sorted(
        runs.to_pylist(),
        key=lambda row: (-worst.get(row["status"], 1), -verdicts[row["verdict"]], row["number"]),
    )
    title = f"{_SHOWN} of {len(rows)} runs, worst first" if len(rows) > _SHOWN else "Runs"
    return PageTable.of(title, rows[:_SHOWN], columns)


def _failures_table(runs: pa.Table) -> PageTable:
    bad = runs.filter(~np.isin(column(runs, "status"), (OK, MISSING)))
    rows = [
        (_link(row["number"], row["key"]), row["status"], row["error"])
        for row in bad.slice(0, _LISTED).to_pylist()
    ]
    caption = f"{counted(bad.num_rows, 'run')} without a result in all."
    return PageTable(headers=("run", "status", "error"), rows=rows, words=(1, 2), caption=caption)


def _orbits_table(runs: pa.Table) -> PageTable:
    names = ("orbit_amplitude", "orbit_speed")
    held = runs.filter(np.isfinite([column(runs, name) for name in names]).any(axis=0))
    rows = []
    for row in held.slice(0, _ORBITS).to_pylist():
        turns = row["orbit_speed"] is not None
        sizes = ("target_speed", "speed") if turns else ("target", "amplitude")
        texts = [size_text(row[f"orbit_{name}"], turns) for name in sizes]
        errors = ("error_generic", "error_recalibrated")
        texts += [degrees_said(row[f"orbit_{name}"]) for name in errors]
        rows.append((str(row["number"]), *texts, str(row["orbit_rounds"])))
    headers = (
        "run",
        "target",
        "reached",
        "rms error of the first model in °",
        "re-calibrated in °",
        "rounds",
    )
    return PageTable(headers=headers, rows=rows)


def _summary(table: Estimates, status: NDArray[Any], fields: Sequence[str]) -> list[str]:
    sentences = _closeness(table)
    if failed := int((status != OK).sum()) - (missing := int((status == MISSING).sum())):
        sentences.append(
            f"{counted(failed, 'run')} without a result: `butterfly inspect FOLDER/NUMBER` says "
            "why."
        )
    done, varied = int((status == OK).sum()), ", ".join(map(field_name, fields)) or "only the seed"
    sentences.append(f"{status.size} runs, {done} with a result; varied: {varied}.")
    if missing:
        sentences.append(f"{missing} have not run yet.")
    count = len(table.by_estimate("ending"))
    if count:
        counts, missed = table.verdicts.values(), table.unconverged
        verdicts = (f"{sum(tally[v.verdict] for tally in counts)} {v.verdict}" for v in VERDICTS)
        sentences.append(f"Verdicts on {count} estimates: {', '.join(verdicts)}.")
        some = f"{missed} of {count} estimates did not converge."
        sentences.append(some if missed else "Every estimate converged.")
    if table.deviating["deviation"].size:
        sentences.append(
            f"The models reproduce their logs with a median FIT of {table.median_fit:.2f} %."
        )
    return sentences


def _closeness(table: Estimates) -> list[str]:
    """Say how close the estimates are to the truth, then which estimator to take."""
    size = np.abs(table.deviating["deviation"])
    if not size.size:
        return []
    inside = ""
    if math.isfinite(table.coverage):
        inside = f"; {100 * table.coverage:.1f} % of the 95 % intervals contain it"
    sentences = [
        f"Half of all estimates are within {100 * np.median(size):.3g} % of the truth, 95 % of "
        f"them within {100 * np.percentile(size, 95):.3g} %{inside}."
    ]
    equal = closest(table)
    if len(table.estimators) > 1:
        sentences.append(
            f"No clear winner: {', '.join(equal)} do not differ significantly."
            if len(equal) > 1
            else f"{equal[0]} is closest to the truth."
        )
    return sentences


def _percent(share: float, digits: str = ".1f") -> str:
    """Return a share in per cent; a dash for none."""
    return f"{100 * share:{digits}}" if math.isfinite(share) else "–"


_RECOVERY: dict[str, Callable[[Mapping[str, Any]], object]] = {
    "estimator": itemgetter("estimator"),
    "parameter": itemgetter("parameter"),
    "runs": itemgetter("runs"),
    "median deviation in %": lambda row: _percent(row["median_deviation"], ".3g"),
    "rms in %": lambda row: _percent(row["rms_deviation"], ".3g"),
    "largest in %": lambda row: _percent(row["largest_deviation"], ".3g"),
    "coverage in %": lambda row: _percent(row["coverage"]),
}
"""Columns of the recovery, of its rows for programs."""
