"""The report of a sweep: how well the parameters were recovered, against each field that varied."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from butterfly.experiment.columns import MISSING
from butterfly.experiment.record import OK, SweepRecord
from butterfly.identification.diagnostics.findings import Ending
from butterfly.model.terms import TERMS
from butterfly.report.format import field_label, field_name
from butterfly.report.numbers.record_numbers import told_sweep
from butterfly.report.page import Fact, Link, Page, Section, Table
from butterfly.report.sweep_figures import (
    Estimates,
    axis_figure,
    column,
    heat_maps,
    parallel_figure,
    short,
)
from butterfly.verdict import VERDICTS

if TYPE_CHECKING:
    import pyarrow as pa


_LISTED = 100  # runs in a table of what went wrong
_TOLD = ("number", "key", "estimator", "ending", "findings")
_NUMBERS = ("value", "lower", "upper", "true", "deviation", "fit_median")
_WANTED = (*_TOLD, *_NUMBERS, "parameter", "known", "verdict")


def sweep_page(sweep: SweepRecord, runs: pa.Table, estimates: pa.Table) -> Page:
    """Put together the report of a sweep.

    Parameters
    ----------
    sweep
        What was asked.
    runs, estimates
        The tables of a result store.
    """
    wanted = {*_WANTED, *sweep.fields} & {*estimates.column_names}
    every = Estimates({name: column(estimates, name) for name in wanted})
    table = every.take(~every["known"].astype(bool))  # what was known is no estimate
    fields, status = sweep.fields, column(runs, "status")
    deviating = table.take(np.isfinite(table["deviation"]))
    sections = [
        Section(
            title="Recovery of the parameters",
            text="Deviation of the estimates from the truth over all runs, where it is not 0; "
            "coverage is the share of 95 % intervals that hold the truth.",
            tables=(_recovery_table(table),),
        )
    ]
    if table["value"].size:
        sections.insert(0, _verdicts_section(table))
    if len(table.distinct("estimator")) > 1:
        ranked = _ranking_table(table)
        sections.insert(0, Section(title="Estimators, the best first", tables=(ranked,)))
    sections += _against_fields(deviating, fields)
    worst = _worst_table(table, fields, sweep.worst)
    if worst.rows:
        sections.append(Section(title="Worst runs", tables=(worst,)))
    unconverged = _unconverged_table(table)
    if unconverged.rows:
        title = "Estimates that did not converge"
        sections.append(Section(title=title, tables=(unconverged,)))
    if not np.isin(status.astype(str), [OK, MISSING]).all():
        sections.append(Section(title="Runs without a result", tables=(_failures(runs),)))
    if "orbit_amplitude" in runs.column_names and runs["orbit_amplitude"].null_count < len(runs):
        sections.append(Section(title="Orbits", tables=(_orbits(runs),)))
    said = _summary(table, status, fields)
    return Page(
        name=sweep.name,
        description=sweep.description,
        kind="sweep",
        facts=_facts(table, status),
        summary=said,
        sections=sections,
        numbers=told_sweep(sweep, said, _numbers(table, status)).document(),
    )


def _against_fields(deviating: Estimates, fields: Sequence[str]) -> list[Section]:
    """Show how estimates deviate by what was varied: all at once, one by one, in pairs."""
    sections = []
    together = parallel_figure(deviating, fields)
    if together is not None:
        text = "A line is an estimate, through what was varied and what came of it."
        section = Section(title="All fields at once", text=text, figures={"together": together})
        sections.append(section)
    for number, field in enumerate(fields):
        figure = axis_figure(deviating, field)
        if figure is not None:
            section = Section(
                title=f"Against {field_name(field)}",
                text="Median deviation, with the middle half of the runs.",
                figures={f"axis-{number}": figure},
            )
            sections.append(section)
    maps = heat_maps(deviating, fields)
    if maps:
        text = "Median of the parameters' mean absolute deviation in %, over the other fields."
        sections.append(Section(title="Two fields at a time", text=text, figures=maps))
    return sections


def _facts(table: Estimates, status: NDArray[Any]) -> list[Fact]:
    """Return the numbers that matter most, as far as there are any."""
    facts = [Fact("runs with a result", f"{int((status == OK).sum())}", f"of {status.size}")]
    size = np.abs(table["deviation"][np.isfinite(table["deviation"])])
    if size.size:
        facts += [
            Fact("deviation from the truth", f"{100 * np.median(size):.2g} %", "median"),
            Fact("95 % intervals hold the truth", _share(table.coverage, " %")),
            Fact("FIT of a run's logs", f"{np.median(table['fit_median']):.2f} %", "median"),
        ]
    return facts


def _verdicts(table: Estimates) -> dict[str, dict[str, int]]:
    """Count the estimates of each verdict, by estimator."""
    estimates = zip(*(table[name].tolist() for name in ("estimator", "number")), strict=True)
    verdicts = dict(zip(estimates, table["verdict"].tolist(), strict=True))
    return {
        method: {
            each.verdict: sum(
                text == each.verdict for (own, _), text in verdicts.items() if own == method
            )
            for each in VERDICTS
        }
        for method in table.distinct("estimator")
    }


def _verdicts_section(table: Estimates) -> Section:
    rows = [
        (method, *(str(count) for count in counts.values()))
        for method, counts in _verdicts(table).items()
    ]
    return Section(
        title="Verdicts",
        text="How many estimates may be used, by what their own data say, not by the truth.",
        tables=(Table(headers=("estimator", *(each.verdict for each in VERDICTS)), rows=rows),),
    )


def _groups(table: Estimates) -> list[tuple[str, str, Estimates]]:
    return [
        (method, name, table.take((table["estimator"] == method) & (table["parameter"] == name)))
        for method in table.distinct("estimator")
        for name in table.distinct("parameter")
        if ((table["estimator"] == method) & (table["parameter"] == name)).any()
    ]


def _recovery_table(table: Estimates) -> Table:
    rows = []
    for method, name, group in _groups(table):
        deviation = group["deviation"][np.isfinite(group["deviation"])]
        statistics: tuple[str, ...] = ("–", "–", "–")
        if deviation.size:
            rms, middle = math.sqrt(np.mean(deviation**2)), float(np.median(deviation))
            largest = float(np.abs(deviation).max())
            statistics = tuple(f"{100 * value:.3g}" for value in (middle, rms, largest))
        count = str(group["value"].size)
        rows.append((method, TERMS[name].symbol, count, *statistics, _share(group.coverage)))
    headers = (
        *("estimator", "parameter", "runs", "median deviation in %", "rms in %"),
        *("largest in %", "coverage in %"),
    )
    return Table(headers=headers, rows=rows)


def _ranking_table(table: Estimates) -> Table:
    rows = []
    for method in table.distinct("estimator"):
        group = table.take(table["estimator"] == method)
        size = np.abs(group["deviation"][np.isfinite(group["deviation"])])
        fits = group["fit_median"]
        middle = float(np.median(size)) if size.size else math.inf
        rows.append((middle, method, float(np.median(fits)), group.coverage))
    return Table(
        headers=("estimator", "median |deviation| in %", "median FIT in %", "coverage in %"),
        rows=[
            (method, f"{100 * size:.3g}" if size < math.inf else "–", f"{fit:.2f}", _share(share))
            for size, method, fit, share in sorted(rows, key=lambda row: row[:2])
        ],
        caption="FIT is in sample. Deviations are over all parameters that are not 0.",
    )


def _worst_table(table: Estimates, fields: Sequence[str], count: int) -> Table:
    """List the runs with the largest deviation of p1, p3 or p4."""
    main = table.take(np.isin(table["parameter"].astype(str), ["p1", "p3", "p4"]))
    order = np.argsort(-np.nan_to_num(np.abs(main["deviation"])), kind="stable")
    rows: list[tuple[str | Link, ...]] = []
    seen: set[tuple[Any, Any]] = set()
    for k in order.tolist():
        run = (main["key"][k], main["estimator"][k])
        if run in seen or len(rows) == count:
            continue
        seen.add(run)
        link = _link(main["number"][k], str(main["key"][k]))
        name = str(main["parameter"][k])
        deviation = f"{TERMS[name].symbol} {100 * main['deviation'][k]:+.3g}"
        values = (short(main[field][k]) for field in fields)
        rows.append((link, run[1], deviation, f"{main['fit_median'][k]:.1f}", *values))
    told = ("run", "estimator", "deviation in %", "median FIT in %")
    caption = (
        "The number leads to the run's record (JSON); butterfly results show FOLDER NUMBER tells "
        "it in words."
    )
    headers = (*told, *map(field_label, fields))
    return Table(headers=headers, rows=rows, words=(1,), caption=caption)


def _endings(table: Estimates) -> dict[tuple[float, str], str]:
    """Return how each estimate ended, by its run and estimator."""
    estimates = zip(table["number"].tolist(), table["estimator"].tolist(), strict=True)
    return dict(zip(estimates, table["ending"].tolist(), strict=True))


def _unconverged_table(table: Estimates) -> Table:
    rest = table.take(table["ending"] != Ending.CONVERGED)
    listed = dict.fromkeys(
        zip(*(rest[name].tolist() for name in _TOLD), strict=True),
    )
    rows = [(_link(*run[:2]), *run[2:]) for run in list(listed)[:_LISTED]]
    return Table(
        headers=("run", "estimator", "ending", "findings"),
        rows=rows,
        words=(1, 2, 3),
        caption=f"{len(listed)} in all.",
    )


def _link(number: float, key: str) -> Link:
    """Return a link from a run's number to its record."""
    return Link(f"{number:.0f}", f"runs/{key[:2]}/{key}.json")


def _failures(runs: pa.Table) -> Table:
    bad = [row for row in runs.to_pylist() if row["status"] not in {OK, MISSING}]
    rows = [
        (_link(row["number"], row["key"]), row["status"], row["error"]) for row in bad[:_LISTED]
    ]
    caption = f"{len(bad)} in all."
    return Table(headers=("run", "status", "error"), rows=rows, words=(1, 2), caption=caption)


def _orbits(runs: pa.Table) -> Table:
    found = [row for row in runs.to_pylist() if row["orbit_amplitude"] is not None]
    names = ("orbit_target", "orbit_amplitude", "orbit_error_generic", "orbit_error_recalibrated")
    rows = [
        (
            str(row["number"]),
            *(f"{math.degrees(row[name]):.4g}" for name in names),
            str(row["orbit_rounds"]),
        )
        for row in found[:200]
    ]
    headers = ("run", "target in °", "reached in °", "generic, rms in °", "re-calibrated", "rounds")
    return Table(headers=headers, rows=rows)


def _summary(table: Estimates, status: NDArray[Any], fields: Sequence[str]) -> list[str]:
    done = int((status == OK).sum())
    varied = ", ".join(map(field_name, fields)) or "nothing but the seed"
    sentences = [f"{status.size} runs, {done} of them with a result; varied: {varied}."]
    missing = int((status == MISSING).sum())
    if missing:
        sentences.append(f"{missing} of them are still to be done.")
    endings = list(_endings(table).values())
    if endings:
        counts = _verdicts(table).values()
        told = (f"{sum(each[kind.verdict] for each in counts)} {kind.verdict}" for kind in VERDICTS)
        sentences.append(f"Verdicts on {len(endings)} estimates: {', '.join(told)}.")
        missed = sum(ending != Ending.CONVERGED for ending in endings)
        sentences.append(
            f"{missed} of {len(endings)} estimates did not converge."
            if missed
            else "Every estimate converged."
        )
    size = np.abs(table["deviation"][np.isfinite(table["deviation"])])
    if size.size:
        sentences += [
            f"Half of all estimates are within {100 * np.median(size):.3g} % of the truth, "
            f"95 % of them within {100 * np.percentile(size, 95):.3g} %.",
            *_coverage_said(table),
            f"The models follow their logs with a median FIT of "
            f"{np.median(table['fit_median']):.2f} %.",
        ]
    return sentences


def _coverage_said(table: Estimates) -> list[str]:
    share = table.coverage
    if share is None:
        return []
    return [f"The 95 % intervals hold the truth in {100 * share:.1f} % of the cases."]


def _share(share: float | None, unit: str = "") -> str:
    """Return a share in per cent; a dash for none."""
    return "–" if share is None else f"{100 * share:.1f}{unit}"


def _numbers(table: Estimates, status: NDArray[Any]) -> dict[str, Any]:
    return {
        "runs": int(status.size),
        "ok": int((status == OK).sum()),
        "verdicts": _verdicts(table),
        "unconverged": sum(ending != Ending.CONVERGED for ending in _endings(table).values()),
        "recovery": [
            {
                "estimator": method,
                "parameter": name,
                "runs": int(group["value"].size),
                "rms_deviation": _rms(group["deviation"]),
                "coverage": group.coverage,
            }
            for method, name, group in _groups(table)
        ],
    }


def _rms(values: NDArray[np.float64]) -> float | None:
    finite = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(finite**2))) if finite.size else None
