"""`butterfly results`: look at what sweeps have left."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from butterfly.cli.options import Limit, Out
from butterfly.cli.output import asked, say, show_table, write_json
from butterfly.errors import InputError

Folder = Annotated[Path, Parameter(name="FOLDER")]


def list_sweeps(folder: Folder = Path("results"), /) -> None:
    """List the sweeps whose results lie in a folder, and how many of their runs are done.

    Parameters
    ----------
    folder
        Where to look for results.
    """
    from butterfly.experiment.record import OK  # noqa: PLC0415 - slow to import, as all of these
    from butterfly.experiment.store import SWEEP, ResultStore  # noqa: PLC0415
    from butterfly.report.format import field_name  # noqa: PLC0415
    from butterfly.result import document  # noqa: PLC0415

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
    write_json(document("results", "Results", {"count": len(said), "rows": said}))


def show_run(folder: Folder, run: Annotated[str, Parameter(name="RUN")], /) -> None:
    """Show one run: what it set, what it found, how long it took, and with which versions.

    Parameters
    ----------
    folder
        A sweep's results, as results/NAME.
    run
        A run: its number, or the start of its key.
    """
    from butterfly.cli.sweeps import run_record  # noqa: PLC0415 - slow to import
    from butterfly.experiment.store import ResultStore  # noqa: PLC0415
    from butterfly.identification.diagnostics.findings import Ending  # noqa: PLC0415
    from butterfly.report.finding_texts import estimate_verdict  # noqa: PLC0415
    from butterfly.report.format import field_label  # noqa: PLC0415
    from butterfly.report.parameter_table import parameter_texts  # noqa: PLC0415
    from butterfly.report.records import record_document  # noqa: PLC0415

    record = run_record(folder, run)
    for each in record.estimates:
        if each.estimate is not None:
            first, *others = estimate_verdict(each.estimate).lines
            say(f"{each.estimator}: {first}")
            for line in others:
                say(line)
    pairs = [("key", record.key), ("status", record.status), ("seed", str(record.seed))]
    pairs += [(field_label(name), str(value)) for name, value in record.overrides.items()]
    pairs += [(f"seconds, {name}", f"{s:.3g}") for name, s in record.seconds.items()]
    pairs += [(f"version, {name}", value) for name, value in record.versions.items()]
    if record.error:
        pairs.append(("error", record.error))
    show_table("", (), pairs, lead=2)
    for each in record.estimates:
        if each.parameters:
            show_table(
                each.estimator,
                ("", "true", "estimate", "95 % interval", "unit"),
                [
                    [row[key] for key in ("symbol", "true", "value", "interval", "unit")]
                    for row in map(parameter_texts, each.parameters)
                ],
            )
        if each.ending is not Ending.CONVERGED:
            say(f"ending: {each.ending}")
        if each.error:
            say(each.error)
    logs = ResultStore(folder).files_path(record.key)
    if logs.exists():
        say(f"Logs: {logs} (butterfly identify takes this folder)")
    write_json(record_document(record))


def table(
    folder: Folder,
    /,
    *,
    table: Annotated[Literal["runs", "estimates"] | None, Parameter(metavar="TABLE")] = None,
    where: Annotated[str | None, Parameter(name="--filter", metavar="PAIRS")] = None,
    columns: Annotated[str | None, Parameter(metavar="NAMES")] = None,
    limit: Limit = 50,
    out: Out = None,
) -> None:
    """Print rows of a table, or write them.

    With --out all rows go to a CSV or Parquet file, of the estimates if no table is named. In CSV,
    texts that a spreadsheet would take for a formula (they begin with =, +, - or @) begin with an
    apostrophe.

    Example: butterfly results table results/large-sweep --table estimates --filter parameter=p1

    Parameters
    ----------
    folder
        A sweep's results, as results/NAME.
    table
        Which table; runs if not given.
    where
        Rows to keep: COLUMN=VALUE, by commas; numbers within 1e-9.
    columns
        Columns of the table, by commas; all if not given.
    limit
        Rows to print, at most.
    out
        Write all rows to this file: .csv or .parquet.
    """
    from pyarrow import csv, parquet  # noqa: PLC0415 - slow to import, as all of these

    from butterfly.cli.sweeps import (  # noqa: PLC0415
        chosen_rows,
        input_kind_of,
        show_rows,
        without_formulas,
    )
    from butterfly.experiment.store import ResultStore  # noqa: PLC0415
    from butterfly.experiment.sweep_tables import ESTIMATES, RUNS  # noqa: PLC0415
    from butterfly.files import replacing  # noqa: PLC0415
    from butterfly.report.records import rows_document  # noqa: PLC0415

    if out is not None and out.suffix not in {".csv", ".parquet"}:
        raise InputError(out, "--out", out.suffix or "no ending", ".csv or .parquet")
    name = table or (RUNS if out is None else ESTIMATES)
    found = chosen_rows(ResultStore(folder).table(name), where, columns)
    if out is None:
        if found.num_rows > limit:
            say(f"{limit} of {found.num_rows} rows; --limit shows more, --out FILE writes all.")
        show_rows(f"{folder}: {name}", found, limit, asked=columns is not None)
    else:
        with replacing(out) as draft:
            if out.suffix == ".csv":
                csv.write_csv(without_formulas(found), draft)
            else:
                parquet.write_table(found, draft)
        say(f"{found.num_rows} rows: {out}")
    if asked.json is not None:
        write_json(rows_document(name, found, limit, input_kind_of(folder)))


def clean(folder: Folder, /, *, failed: bool = False) -> None:
    """Remove records that the sweep no longer has, and files that were never finished.

    Parameters
    ----------
    folder
        A sweep's results, as results/NAME.
    failed
        Also runs without a result, to do them again.
    """
    from butterfly.experiment.store import ResultStore  # noqa: PLC0415 - slow to import

    removed = ResultStore(folder).clean(failed=failed)
    for path in removed:
        say(f"removed {path}")
    say(f"{len(removed)} removed.")
