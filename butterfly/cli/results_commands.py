"""`butterfly results`: look at what sweeps have left."""

from __future__ import annotations

import math
from collections import Counter
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import pyarrow as pa
import typer
from pyarrow import csv, parquet

from butterfly.cli.console import say, say_verdict, show_pairs, show_table
from butterfly.cli.json_answer import JsonAnswer, answers_in_json
from butterfly.cli.options import (
    FiguresOption,
    LimitOption,
    ReportOption,
    require_report,
)
from butterfly.cli.picked_rows import chosen_rows, without_formulas
from butterfly.cli.shown_rows import show_rows, shown_text
from butterfly.errors import InputError, nearest
from butterfly.experiment.columns import ESTIMATES, RUNS, TABLES
from butterfly.experiment.record import OK
from butterfly.experiment.source import EXPERIMENT, read_experiment
from butterfly.experiment.store import SWEEP, ResultStore
from butterfly.files import replacing
from butterfly.identification.parameter import or_nan
from butterfly.logs.log import InputKind
from butterfly.report.finding_texts import estimate_verdict
from butterfly.report.format import field_label, field_name
from butterfly.report.numbers.record_numbers import (
    told_record,
    told_rows,
    told_runs,
    told_table,
)
from butterfly.report.parameter_table import parameter_rows, with_error

if TYPE_CHECKING:
    from butterfly.experiment.record import RunRecord
    from butterfly.identification.parameter import Parameter

FolderArgument = Annotated[Path, typer.Argument(help="A sweep's results, as results/NAME.")]
FilterOption = Annotated[
    str | None,
    typer.Option(
        "--filter",
        help="Rows to keep: COLUMN=VALUE, separated by commas; numbers within 1e-9.",
        show_default="all",
    ),
]
ColumnsOption = Annotated[
    str | None,
    typer.Option("--columns", help="Columns of the table, by commas.", show_default="all"),
]
TableOption = Annotated[str, typer.Option(help="Which table: runs or estimates.")]


@answers_in_json("results")
def list_command(
    folder: Annotated[Path, typer.Argument(help="Where to look for results.")] = Path("results"),
    *,
    answer: JsonAnswer,
) -> None:
    """List the sweeps whose results lie in a folder, and how many of their runs are done."""
    said: list[dict[str, Any]] = []
    rows: list[tuple[str, ...]] = []
    for path in sorted(folder.glob(f"*/{SWEEP}")) or sorted(folder.glob(SWEEP)):
        store = ResultStore(path.parent)
        try:
            sweep = store.sweep()
        except InputError:
            rows.append((str(path.parent), "–", "–", "–", "of another version"))
            said.append({"sweep": path.parent.name, "runs": None})
            continue
        records = (store.read(run.key) for run in sweep.runs)
        states = Counter(record and record.status for record in records)
        done = states[OK]
        counts = (len(sweep.runs), done, states.total() - states[None] - done)
        rows.append((str(path.parent), *map(str, counts), ", ".join(map(field_name, sweep.fields))))
        numbers = dict(zip(("runs", "done", "failed"), counts, strict=True))
        said.append({"sweep": path.parent.name, **numbers, "varied": list(sweep.fields)})
    if rows:
        show_table(f"Results in {folder}", ("sweep", "runs", "done", "failed", "varied"), rows)
    else:
        say(f"No results in {folder}: butterfly run EXPERIMENT makes some.")
    answer.give(lambda: told_table("results", "Results", said))


@answers_in_json("run-record")
def show_command(
    folder: FolderArgument,
    run: Annotated[str, typer.Argument(help="A run: its number, or the start of its key.")],
    *,
    answer: JsonAnswer,
) -> None:
    """Show one run: what it set, what it found, how long it took, and with which versions."""
    store = ResultStore(folder)
    record = _record(store, run)
    for each in record.estimates:
        if each.estimate is not None:
            say(f"{each.estimator}: {estimate_verdict(each.estimate).sentence}")
    pairs = [("key", record.key), ("status", record.status), ("seed", str(record.seed))]
    pairs += [(field_label(name), str(value)) for name, value in record.overrides.items()]
    pairs += [(f"seconds, {name}", f"{s:.3g}") for name, s in record.seconds.items()]
    pairs += [(f"version, {name}", value) for name, value in record.versions.items()]
    if record.error:
        pairs.append(("error", record.error))
    show_pairs(pairs)
    for each in record.estimates:
        if each.parameters:
            show_table(
                each.estimator,
                ("", "true", "estimate", "95 % interval", "unit"),
                [
                    (row.symbol, row.true, row.value, row.interval, row.unit)
                    for row in parameter_rows(each.parameters)
                ],
            )
        if not each.converged:
            say(f"ending: {each.ending}")
        if each.error:
            say(each.error)
    logs = store.files_path(record.key)
    if logs.exists():
        typer.echo(f"Logs: {logs} (butterfly identify takes this folder)")
    answer.give(lambda: told_record(record))


@answers_in_json("table")
def table_command(
    folder: FolderArgument,
    table: TableOption = RUNS,
    where: FilterOption = None,
    chosen_columns: ColumnsOption = None,
    limit: LimitOption = 50,
    *,
    answer: JsonAnswer,
) -> None:
    """Print rows of a table.

    Example: `butterfly results table results/large-sweep --table estimates --filter parameter=p1`
    """
    found = chosen_rows(_table(folder, table), where, chosen_columns)
    if found.num_rows > limit:
        say(
            f"{limit} of {found.num_rows} rows; --limit shows more, butterfly results export "
            "writes all."
        )
    show_rows(f"{folder}: {table}", found, limit, asked=chosen_columns is not None)
    answer.give(lambda: told_rows(table, found, limit, _input_kind(folder)))


def export_command(
    folder: FolderArgument,
    out: Annotated[Path, typer.Option(help="File to write: .csv or .parquet.")],
    table: TableOption = ESTIMATES,
    where: FilterOption = None,
    chosen_columns: ColumnsOption = None,
) -> None:
    """Write rows of a table to a CSV or Parquet file.

    In CSV, texts that a spreadsheet would take for a formula (they begin with =, +, - or @) begin
    with an apostrophe.
    """
    found = chosen_rows(_table(folder, table), where, chosen_columns)
    if out.suffix not in {".csv", ".parquet"}:
        raise InputError(out, "--out", out.suffix or "no ending", ".csv or .parquet")
    with replacing(out) as draft:
        if out.suffix == ".csv":
            csv.write_csv(without_formulas(found), draft)
        else:
            parquet.write_table(found, draft)
    typer.echo(f"{found.num_rows} rows: {out}")


@answers_in_json("change")
def compare_command(
    folder: Annotated[
        Path, typer.Argument(help="A saved identification; or a sweep's results, as results/NAME.")
    ],
    one: Annotated[
        str,
        typer.Argument(
            help="A later identification; or a run of the sweep: its number, or the start of its "
            "key."
        ),
    ],
    other: Annotated[
        str | None, typer.Argument(help="Another run of the sweep.", show_default=False)
    ] = None,
    other_results: Annotated[
        Path | None,
        typer.Option(
            help="Results that hold the other run, if not the same ones.", show_default=False
        ),
    ] = None,
    *,
    report: ReportOption = None,
    figures: FiguresOption = False,
    answer: JsonAnswer,
) -> None:
    """Tell whether a robot has changed between two identifications, or compare two runs.

    Of two that were saved (`butterfly identify --save FILE`) each parameter is tested for a change,
    and all of them together: at most one comparison in twenty of a robot that has not changed says
    that it has. Of two runs of a sweep: what they set, and what they found.

    Examples: `butterfly results compare spring.json autumn.json`,
    `butterfly results compare results/large-sweep 0 1`
    """
    if other is None:
        require_report(figures, report)
        _compare_identifications(folder, Path(one), answer, report, figures=figures)
        return
    first = _record(ResultStore(folder), one)
    second = _record(ResultStore(other_results or folder), other)
    others = {each.estimator: each for each in second.estimates}
    for each in first.estimates:
        for name, of in ((one, each), (other, others.get(each.estimator))):
            if of is not None and of.estimate is not None:
                say(f"{each.estimator}, {name}: {estimate_verdict(of.estimate).sentence}")
    said = [run.overrides | {"seed": run.seed, "status": run.status} for run in (first, second)]
    pairs = {name: [each.get(name) for each in said] for name in dict.fromkeys(chain(*said))}
    unlike = [
        (field_label(name), *map(shown_text, pair))
        for name, pair in pairs.items()
        if pair[0] != pair[1]
    ]
    if unlike:
        show_table("What was set", ("", one, other), unlike)
    else:
        say("Nothing was set otherwise.")
    for each in first.estimates:
        if each.estimator not in others:
            continue
        twins = {row.name: row for row in others[each.estimator].parameters}
        show_table(
            each.estimator,
            ("parameter", one, other, "difference", "in std. errors"),
            [
                (row.name, *_difference(row, twins[row.name]))
                for row in each.parameters
                if row.name in twins
            ],
        )
    answer.give(lambda: told_runs((first, second)))


def _compare_identifications(
    before: Path, after: Path, answer: JsonAnswer, report: Path | None, *, figures: bool
) -> None:
    """Print whether a robot has changed, first in words."""
    from butterfly.api.changed import changed  # noqa: PLC0415 - slow to import

    for path, which in ((before, "FOLDER"), (after, "ONE")):
        if path.is_dir() or not path.suffix:
            expected = "a saved identification (.json); or a sweep's results and two of its runs"
            raise InputError("butterfly results compare", which, path, expected)
    found = changed(before, after)
    verdict, *others = found.summary
    say_verdict(verdict)
    for sentence in others:
        say(sentence)
    rows = found.shown_rows()
    show_table(found.title, tuple(rows[0]), [tuple(row.values()) for row in rows])
    if report is not None:
        found.report(report, figures=figures)
        typer.echo(f"Report: {report}")
    answer.give(found.told)


def clean_command(
    folder: FolderArgument,
    *,
    failed: Annotated[
        bool, typer.Option("--failed", help="Also runs without a result, to do them again.")
    ] = False,
) -> None:
    """Remove records that the sweep no longer has, and files that were never finished."""
    removed = ResultStore(folder).clean(failed=failed)
    for path in removed:
        typer.echo(f"removed {path}")
    typer.echo(f"{len(removed)} removed.")


def _input_kind(folder: Path) -> InputKind:
    """Return what the input of results commands, as the experiment beside them says."""
    path = folder / EXPERIMENT
    return read_experiment(path).input_kind if path.exists() else InputKind.TORQUE


def _table(folder: Path, name: str) -> pa.Table:
    if name not in TABLES:
        raise InputError(folder, "--table", name, nearest(name, TABLES))
    return ResultStore(folder).table(name)


def _record(store: ResultStore, run: str) -> RunRecord:
    runs = store.sweep().runs
    keys = [each.key for each in runs if str(each.number) == run] or [
        each.key for each in runs if each.key.startswith(run)
    ]
    if len(set(keys)) != 1:
        expected = f"a number from 0 to {len(runs) - 1}, or a key's beginning that is one run's"
        raise InputError(store.folder, "run", run, expected)
    record = store.read(keys[0])
    if record is None:
        raise InputError(store.folder, "run", run, "one that was done (butterfly run does it)")
    return record


def _difference(row: Parameter, twin: Parameter) -> tuple[str, ...]:
    change = twin.value - row.value
    errors = [each.standard_error for each in (row, twin) if each.standard_error is not None]
    spread = math.hypot(*errors)
    in_errors = f"{change / spread:.2g}" if len(errors) == 2 and spread > 0 else "–"  # noqa: PLR2004 - both
    values = (with_error(each.value, or_nan(each.standard_error)) for each in (row, twin))
    return *values, f"{change:.3g}", in_errors
