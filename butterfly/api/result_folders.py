"""Results on disk, as `inspect` shows them: a run, a sweep, or all in a folder."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from butterfly.api.experiments import RESULT, run_answer, sweep_answer
from butterfly.api.saved import load
from butterfly.api.sources import is_run, is_sweep, results_below
from butterfly.errors import InputError
from butterfly.experiment.record import OK, RunRecord
from butterfly.experiment.store import ResultStore, table_file
from butterfly.experiment.sweep_tables import MISSING, RUNS
from butterfly.logs.manifest import MANIFEST_NAME
from butterfly.progress import Track, untracked
from butterfly.report.format import counted, field_name
from butterfly.report.page import PageTable, views
from butterfly.result import Answer
from butterfly.verdict import VERDICTS


def results_answer(path: Path, *, track: Track = untracked) -> Answer:
    """Show the run, sweep or saved result that a path names, or list those in a folder."""
    if is_run(path):
        return _of_run(path.parent, path.name)
    if is_sweep(path):
        return _of_sweep(path)
    return _listed(path, track) if path.is_dir() else load(path)


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


def _of_run(folder: Path, run: str) -> Answer:
    record, store = run_record(folder, run), ResultStore(folder)
    logs = store.files_path(record.key)
    note = f"Its logs: {logs} (`butterfly identify` takes this folder)." if logs.exists() else ""
    return run_answer(record, f"Run {record.key}", note=note, data={"name": store.sweep().name})


def _of_sweep(folder: Path) -> Answer:
    store = ResultStore(folder)
    if RESULT in (store.sweep().output_digests or ()):
        manifest = folder / MANIFEST_NAME
        note = f"Its logs: `butterfly inspect {manifest}` checks them." if manifest.exists() else ""
        return replace(load(folder / RESULT), note=note)
    note = f"All rows: {folder / table_file(RUNS)}, and a row for each estimate beside it."
    return sweep_answer(store, note=note)


def _listed(folder: Path, track: Track) -> Answer:
    """List the results in a folder, and count their verdicts."""
    paths = results_below(folder)
    rows = [_row(path) for path in track(paths, "Reading")]
    runs, done = (sum(row[name] or 0 for row in rows) for name in ("runs", "done"))
    parts = [_counts_text({v.verdict: sum(row[v.verdict] for row in rows) for v in VERDICTS})]
    parts += [f"{runs - done} of {counted(runs, 'run')} without a result"] * (done < runs)
    verdicts = "; ".join(filter(None, parts))
    return Answer(
        kind="results",
        title=f"Results in {folder.resolve().name!r}",
        summary=(f"{counted(len(rows), 'result')}{': ' * bool(verdicts)}{verdicts}.",),
        content={"rows": rows, **views([PageTable.of("Results", rows, _COLUMNS)])},
        note=f"To see one: `butterfly inspect {paths[0]}`.",
    )


def _row(path: Path) -> dict[str, Any]:
    """Return what is known of a result without showing it."""
    row: dict[str, Any] = {"result": path.name, "kind": None, "error": "", "varied": []}
    row |= dict.fromkeys(("runs", "done", "failed"))
    counts = Counter[str | None]()
    try:
        if path.is_dir():
            store = ResultStore(path)
            table, row["varied"] = store.tables()[RUNS], [*map(field_name, store.sweep().fields)]
            states, counts = (Counter(table[name].to_pylist()) for name in ("status", "verdict"))
            row |= {"kind": "sweep" if table.num_rows > 1 else "run", "runs": table.num_rows}
            row |= {"done": (done := states[OK])}
            row["failed"] = table.num_rows - states[MISSING] - done
        else:
            answer = load(path)
            row["kind"], counts = answer.kind, Counter([answer.standing])
    except InputError:
        row["error"] = "unreadable, or another version's"
    return row | {level.verdict: counts[level.verdict] for level in VERDICTS}


def _counts_text(counts: Mapping[str, Any]) -> str:
    """Say how often there is each verdict."""
    numbers = {level.verdict: counts[level.verdict] for level in VERDICTS}
    return ", ".join(f"{number} {verdict}" for verdict, number in numbers.items() if number)


def _verdict(row: Mapping[str, Any]) -> str | None:
    """Return the verdict of a run or result, how often a sweep has each, or what is wrong."""
    text = _counts_text(row)
    return (text if row["kind"] == "sweep" else text.removeprefix("1 ")) or row["error"] or None


_COLUMNS: dict[str, Callable[[Mapping[str, Any]], object]] = {
    "result": lambda row: row["result"],
    "verdict": _verdict,
    "is": lambda row: row["kind"],
    "runs": lambda row: row["runs"],
    "done": lambda row: row["done"],
    "failed": lambda row: row["failed"],
    "varied": lambda row: ", ".join(row["varied"]) or None,
}
