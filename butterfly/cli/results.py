"""`butterfly results`: list, show, tabulate and clean up results of sweeps."""

from __future__ import annotations

import math
from collections import Counter
from itertools import chain
from pathlib import Path
from typing import Annotated, Any, Literal

import pyarrow as pa
from cyclopts import Parameter as Option

from butterfly.cli.options import OUT
from butterfly.cli.output import ExitCode, say, show, show_progress, show_table, write_json
from butterfly.cli.written import OutputFile
from butterfly.errors import InputError, nearest
from butterfly.experiment.record import OK, RunRecord
from butterfly.experiment.source import EXPERIMENT, read_experiment
from butterfly.experiment.store import SWEEP, ResultStore
from butterfly.experiment.sweep_tables import ESTIMATES, RUNS
from butterfly.identification.parameter import Parameter, or_nan
from butterfly.logs.log import InputKind
from butterfly.report.finding_texts import estimate_verdict
from butterfly.report.format import field_label, field_name, field_unit, with_error
from butterfly.report.numbers import rows_document, write_columns
from butterfly.report.parameter_table import value_text
from butterfly.result import document

Folder = Annotated[Path, Option(help="A sweep's results, such as results/NAME.")]
Folders = Annotated[Path, Option(help="Folder with results.")]
Run = Annotated[str, Option(help="The run's number, or the start of its key.")]
Failed = Annotated[bool, Option(help="Remove failed runs too, to repeat them.")]

_NAMES = ("number", "estimator", "parameter")
"""Columns that name a row."""
_ASKED = (
    *("key", "seed", "repetition", "findings", "condition", "standard_error"),
    *("least_left_out", "largest_left_out", "fit_mean", "held_out_worst", "holdout_worst"),
)
"""Columns shown only on request, to keep tables readable."""

_MOST = 50  # rows that are printed
_NOTHING = {"", "–"}


def list_sweeps(folder: Folders = Path("results"), /) -> None:
    """List sweeps, and how many of their runs are done."""
    sweeps: list[dict[str, Any]] = []
    rows: list[tuple[str, ...]] = []
    for path in sorted(folder.glob(f"*/{SWEEP}")) or sorted(folder.glob(SWEEP)):
        store = ResultStore(path.parent)
        try:
            sweep = store.sweep()
        except InputError:
            rows.append((str(path.parent), "–", "–", "–", "another version's"))
            sweeps.append({"sweep": path.parent.name, "runs": None})
            continue
        records = (store.read(run.key) for run in show_progress(sweep.runs, "Reading"))
        states = Counter(record and record.status for record in records)
        done = states[OK]
        counts = (len(sweep.runs), done, states.total() - states[None] - done)
        rows.append((str(path.parent), *map(str, counts), ", ".join(map(field_name, sweep.fields))))
        numbers = dict(zip(("runs", "done", "failed"), counts, strict=True))
        sweeps.append({"sweep": path.parent.name, **numbers, "varied": list(sweep.fields)})
    if rows:
        show_table(f"Results in {folder}", ("sweep", "runs", "done", "failed", "varied"), rows)
    else:
        say(f"No results in {folder}. To make some: butterfly run EXPERIMENT.")
    write_json(document("results", "Results", {"count": len(sweeps), "rows": sweeps}))


def show_run(folder: Folder, run: Run, /) -> None:
    """Show one run: settings, estimates, times and versions."""
    from butterfly.api.experiments import run_answer  # noqa: PLC0415 - slow to import

    record, store = run_record(folder, run), ResultStore(folder)
    show(run_answer(record, f"Run {record.key}", data={"name": store.sweep().name}))
    logs = store.files_path(record.key)
    if logs.exists():
        say(f"Logs: {logs} (butterfly identify takes this folder)")


def table(
    folder: Folder,
    /,
    *,
    table: Annotated[Literal["runs", "estimates"] | None, Option(metavar="TABLE")] = None,
    columns: Annotated[str | None, Option(metavar="NAMES")] = None,
    out: Annotated[Path | None, OUT, OutputFile((".csv", ".parquet"))] = None,
) -> None:
    """Print a sweep's table, or export it.

    In CSV, text that starts with =, +, - or @ gets a leading apostrophe, to keep spreadsheets from
    running it as a formula.

    Parameters
    ----------
    table
        Which table. Default: runs; estimates with --out.
    columns
        Columns, separated by commas. Default: the most useful; all with --out.
    out
        Write all rows to this file: .csv or .parquet.
    """
    name = table or (RUNS if out is None else ESTIMATES)
    selection = chosen_columns(ResultStore(folder).table(name), columns)
    if out is None:
        if selection.num_rows > _MOST:
            say(f"The first {_MOST} of {selection.num_rows} rows; --out FILE writes all.")
        show_rows(f"{folder}: {name}", selection, asked=columns is not None)
    else:
        write_columns(
            out, "table", dict(zip(selection.column_names, selection.columns, strict=True))
        )
        say(f"{selection.num_rows} rows: {out}")
    plan = folder / EXPERIMENT
    kind = read_experiment(plan).input_kind if plan.exists() else InputKind.TORQUE
    write_json(rows_document(name, selection, kind))


def clean(folder: Folder, /, *, failed: Failed = False) -> None:
    """Remove outdated records and unfinished files."""
    removed = ResultStore(folder).clean(failed=failed)
    for path in removed:
        say(f"Removed {path}")
    say(f"{len(removed)} removed.")


def show_rows(title: str, table: pa.Table, *, asked: bool) -> None:
    """Print the first rows of a sweep's table; all columns if they were ``asked`` for."""
    rows = table.to_pylist()
    if not rows:
        say(f"{title}: no rows.")
        return
    shown = [name for name in table.column_names if asked or name not in _ASKED]
    cells = {name: [shown_text(row[name]) for row in rows] for name in shown}
    if len(rows) == 1:
        pairs = [(field_label(name), text) for name, (text,) in cells.items()]
        show_table("", (), [pair for pair in pairs if pair[1] not in _NOTHING], lead=2)
        return
    same = [] if asked else [name for name in shown if len({*cells[name]}) == 1]
    named = [name for name in _NAMES if name in cells and name not in same]
    others = [name for name in shown if name not in {*same, *named}]
    constants = [
        f"{field_name(name)} {cells[name][0]} {field_unit(name)}".rstrip()
        for name in same
        if cells[name][0] not in _NOTHING
    ]
    if constants:
        say(f"Same in all rows: {', '.join(constants)}.")
    if not asked:
        omitted = [
            name
            for name in table.column_names
            if name in _ASKED and table[name].null_count < table.num_rows
        ]
        say(f"Not shown: {', '.join(omitted)}. To show columns: --columns NAME,NAME.")
    columns = [*named, *others]
    show_table(
        title,
        [field_label(name) for name in columns],
        list(zip(*(cells[name][:_MOST] for name in columns), strict=True)),
        lead=max(len(named), 1),
    )


def shown_text(value: Any) -> str:  # noqa: ANN401 - a cell of any table
    """Format a cell; a missing value is a dash."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def chosen_columns(table: pa.Table, columns: str | None) -> pa.Table:
    """Return a table's named columns; all without names."""
    if columns is None:
        return table
    names, chosen = table.column_names, []
    for name in [part.strip() for part in columns.split(",")]:
        meant = [
            column for column in names if column.endswith(f".{name}") or field_name(column) == name
        ]
        meant = [name] if name in names else meant  # or last part, or header
        if len(meant) != 1:
            expected = ", or ".join(meant) or nearest(name, names)
            raise InputError("--columns", name, "an unknown column", expected)
        chosen += meant
    return table.select(chosen)


def is_run(path: Path) -> bool:
    """Whether a path names a run of a sweep: RESULTS/NUMBER, or RESULTS/KEY."""
    return (path.parent / SWEEP).exists() and not path.suffix


def run_record(folder: Path, run: str) -> RunRecord:
    """Return the record of a run of a sweep, by its number or the start of its key."""
    store = ResultStore(folder)
    runs = store.sweep().runs
    keys = [planned.key for planned in runs if str(planned.number) == run] or [
        planned.key for planned in runs if planned.key.startswith(run)
    ]
    if len(set(keys)) != 1:
        expected = f"a number from 0 to {len(runs) - 1}, or the start of exactly one run's key"
        raise InputError(store.folder, "run", run, expected)
    record = store.read(keys[0])
    if record is None:
        raise InputError(store.folder, "run", run, "a finished run (start it with butterfly run)")
    return record


def compare_runs(one: Path, other: Path) -> ExitCode:
    """Print the differences between the settings and estimates of two runs."""
    from butterfly.api.experiments import run_answer  # noqa: PLC0415 - slow to import

    runs = [run_record(path.parent, path.name) for path in (one, other)]
    names = [path.name if one.parent == other.parent else str(path) for path in (one, other)]
    others = {entry.estimator: entry for entry in runs[1].estimates}
    for entry in runs[0].estimates:
        for name, of in zip(names, (entry, others.get(entry.estimator)), strict=True):
            if of is not None and of.estimate is not None:
                say(f"{entry.estimator}, {name}: {estimate_verdict(of.estimate).lines[0]}")
    settings = [run.overrides | {"seed": run.seed, "status": run.status} for run in runs]
    both = {
        name: [setting.get(name) for setting in settings]
        for name in dict.fromkeys(chain(*settings))
    }
    pairs = [(field_label(name), *pair) for name, pair in both.items() if pair[0] != pair[1]]
    if unlike := [(name, *map(shown_text, pair)) for name, *pair in pairs]:
        show_table("Settings that differ", ("", *names), unlike)
    else:
        say("The settings are the same.")
    for entry in [record for record in runs[0].estimates if record.estimator in others]:
        twins = {row.name: row for row in others[entry.estimator].parameters}
        show_table(
            entry.estimator,
            ("parameter", *names, "difference", "standard errors"),
            [
                (row.name, *_difference(row, twins[row.name]))
                for row in entry.parameters
                if row.name in twins
            ],
        )
    answers = [run_answer(run, f"Run {run.key}").to_dict() for run in runs]
    title = " beside ".join(answer["title"] for answer in answers)
    first = [
        f"{answer['title']}: {answer['summary'][0]}" for answer in answers if answer["summary"]
    ]
    write_json(document("runs", title, {"runs": answers}, summary=first))
    return ExitCode.DONE


def _difference(row: Parameter, twin: Parameter) -> tuple[str, ...]:
    if row.value is None or twin.value is None:
        return *map(value_text, (row, twin)), "–", "–"
    change, errors = twin.value - row.value, [or_nan(entry.standard_error) for entry in (row, twin)]
    spread = math.hypot(*errors)
    values = map(with_error, (row.value, twin.value), errors)
    return *values, f"{change:.3g}", f"{change / spread:.2g}" if spread > 0 else "–"
