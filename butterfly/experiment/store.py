"""Results of sweeps on disk: one JSON record for each run, and tables in Parquet.

    FOLDER/sweep.json               the runs in order with their addresses, and versions
    FOLDER/runs/ab/abcd....json     record of one finished run
    FOLDER/runs/ab/abcd.../         its logs, if kept
    FOLDER/runs.parquet             a row per run
    FOLDER/estimates.parquet        a row per run, estimator and parameter

Durations are only in the records, so the tables are identical however a sweep was run.
"""

from __future__ import annotations

import io
import re
import shutil
import time
from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from dataclasses import replace
from itertools import islice
from pathlib import Path

import pyarrow as pa
from pyarrow import parquet

from butterfly.errors import InputError
from butterfly.experiment.record import (
    OK,
    SCHEMA,
    Outcome,
    RunRecord,
    SweepRecord,
    origin_of,
)
from butterfly.experiment.source import EXPERIMENT, HEAD
from butterfly.experiment.sweep_tables import MISSING, RUNS, TABLES, SweepColumns
from butterfly.files import DRAFT, digest_of, read_file, write_file
from butterfly.outputs import note_input
from butterfly.progress import Track, untracked
from butterfly.result import SWEEP

_KEY = re.compile(r"[0-9a-f]{24}")  # of a run
_RUNS = 2_000  # whose rows are gathered before they are written
_ENDS = 20  # times that a sweep is ended, while others end theirs in the same folder
_LOOKS, _MOMENT = 4, 0.05  # at a table, and s between them
_STALE = 600.0  # s after which nobody finishes a file any more


class ResultStore:
    """A folder of results."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def record_path(self, key: str) -> Path:
        """Path of a run's record."""
        return self.folder / "runs" / key[:2] / f"{key}.json"

    def files_path(self, key: str) -> Path:
        """Folder of a run's logs."""
        return self.folder / "runs" / key[:2] / key

    def require_own(self) -> None:
        """Raise InputError unless the folder is new, empty, or one of results."""
        names = sorted(path.name for path in self.folder.glob("*"))
        files = {name: (self.folder / name).read_bytes() for name in {SWEEP, EXPERIMENT} & {*names}}
        ours = files.get(EXPERIMENT, b"").startswith(HEAD.encode())
        if names and not ours and origin_of(files.get(SWEEP, b"").decode("latin-1")) == "no record":
            expected = "a new folder, or one of butterfly's results"
            raise InputError(self.folder, "--out", f"a folder with {names[0]}", expected)

    def read(self, key: str) -> RunRecord | None:
        """Return a run's record; None if missing or unreadable by this version."""
        note_input(self.record_path(key))
        try:
            text = self.record_path(key).read_text(encoding="utf-8")
        except (OSError, ValueError):
            return None
        record = RunRecord.from_json(text)
        return record if record is not None and record.key == key else None

    def complete(self, key: str) -> RunRecord | None:
        """Return a run's record if its files are intact and a repetition would give the same."""
        record = self.read(key)
        if record is None or not record.stays or not _hold(self.files_path(key), record.files):
            return None
        return record

    def latest(self, key: str) -> RunRecord | None:
        """Return a run's complete record if it was the last one here, all that it wrote intact."""
        try:
            sweep = self.sweep()
        except InputError:
            return None
        if sweep.output_digests is None or [run.key for run in sweep.runs] != [key]:
            return None
        return self.complete(key) if _hold(self.folder, sweep.output_digests) else None

    def write(self, outcome: Outcome) -> None:
        """Write the files of a run, then its record, each as a whole."""
        key = outcome.record.key
        for name, content in outcome.files.items():
            write_file(self.files_path(key) / name, content, internal=True)
        files = {name: digest_of(content) for name, content in outcome.files.items()}
        record = replace(outcome.record, files=files).to_json()
        write_file(self.record_path(key), record, internal=True)

    def begin_sweep(self, sweep: SweepRecord) -> None:
        """Write the plan before its runs: what was written of an earlier one no longer counts."""
        begun = replace(sweep, tables={}, output_digests=None)
        write_file(self.folder / SWEEP, begun.to_json(), internal=True)

    def end_sweep(self, sweep: SweepRecord, *, track: Track = untracked) -> None:
        """Write the tables from the records, and the plan; again if another process wrote them."""
        for _ in range(_ENDS):
            tables = self._tables(sweep, track)
            for name, content in tables.items():
                write_file(self.folder / name, content, internal=True)
            files = {name: digest_of(content) for name, content in tables.items()}
            write_file(self.folder / SWEEP, replace(sweep, tables=files).to_json(), internal=True)
            if _hold(self.folder, files):
                return

    def sweep(self) -> SweepRecord:
        """Read the plan."""
        path = self.folder / SWEEP
        text = read_file(path, "a folder of results").decode(errors="replace")
        sweep = SweepRecord.from_json(text)
        if sweep is None:
            expected = f"schema {SCHEMA}; repeat the sweep with butterfly run"
            raise InputError(path, "content", origin_of(text), expected)
        return sweep

    def _tables(self, sweep: SweepRecord, track: Track) -> dict[str, bytes]:
        """Return the contents of the files of the tables, by name."""
        columns = SweepColumns(sweep.fields, sweep.runs)
        files = {name: io.BytesIO() for name in TABLES}
        with ExitStack() as open_files:
            writers = {
                name: open_files.enter_context(
                    parquet.ParquetWriter(file, columns.schema(name), compression="zstd")
                )
                for name, file in files.items()
            }
            runs = iter(track(sweep.runs, "Writing the tables"))
            while part := [(run, self.read(run.key)) for run in islice(runs, _RUNS)]:
                for name, writer in writers.items():
                    rows = [row for run, record in part for row in columns.rows(name, run, record)]
                    writer.write_table(pa.Table.from_pylist(rows, schema=columns.schema(name)))
        return {table_file(name): file.getvalue() for name, file in files.items()}

    def table(self, name: str) -> pa.Table:
        """Read a table; InputError if missing or changed."""
        path = self.folder / table_file(name)
        for _ in range(_LOOKS):
            content = read_file(path, "a folder of results")
            if digest_of(content) == self.sweep().tables.get(path.name):
                return parquet.read_table(pa.BufferReader(content))
            time.sleep(_MOMENT)  # another process may be about to write the other of the two
        expected = f"the table that matches {SWEEP}; rebuild it with butterfly run"
        raise InputError(path, "content", "another table", expected)

    def tables(self) -> dict[str, pa.Table]:
        """Read the tables by name; those that lack runs are made anew of the records so far."""
        sweep = self.sweep()
        if sweep.tables:
            tables = {name: self.table(name) for name in TABLES}
            keys, states = (tables[RUNS][name].to_pylist() for name in ("key", "status"))
            if keys == [run.key for run in sweep.runs] and MISSING not in states:
                return tables
        files = self._tables(sweep, untracked)
        return {n: parquet.read_table(pa.BufferReader(files[table_file(n)])) for n in TABLES}

    def _is_linked(self, path: Path) -> bool:
        """Whether a path contains a link."""
        way = (path, *path.parents)
        return any(part.is_symlink() for part in way[: way.index(self.folder)])

    def clean(self, *, failed: bool = False) -> list[Path]:
        """Remove and return records of no run, stray logs, drafts, and if asked ``failed`` runs."""
        wanted = {run.key for run in self.sweep().runs}
        removed = [path for path in self.folder.rglob(f"{DRAFT}*") if _is_stale(path)]
        paths = [path for path in (self.folder / "runs").glob("*/*") if _KEY.fullmatch(path.stem)]
        for path in sorted(path for path in paths if path.suffix == ".json"):
            record = self.read(path.stem)
            unwanted = record is None or (failed and record.status != OK)
            if unwanted or path.stem not in wanted:
                removed += [path, self.files_path(path.stem)]
        removed += [path for path in paths if path.is_dir() and path.name not in wanted]
        existing = [
            path for path in dict.fromkeys(removed) if path.exists() and not self._is_linked(path)
        ]
        for path in existing:
            shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
        return existing


def table_file(table: str) -> str:
    """Return the name of the file of a table."""
    return f"{table}.parquet"


def digests(folder: Path, names: Iterable[str]) -> dict[str, str]:
    """Return the digests of files in a folder, by name."""
    return {name: digest_of((folder / name).read_bytes()) for name in names}


def _hold(folder: Path, files: Mapping[str, str]) -> bool:
    try:
        return digests(folder, files) == files
    except (OSError, ValueError):
        return False


def _is_stale(path: Path) -> bool:
    """Whether an unfinished file is so old that nobody is writing it."""
    try:
        return path.is_file() and time.time() - path.stat().st_mtime > _STALE
    except OSError:  # finished meanwhile
        return False
