"""Results of sweeps on disk: one JSON record for each run, and tables in Parquet.

    FOLDER/sweep.json               what was run: runs in order with their addresses, versions
    FOLDER/runs/ab/abcd....json     record of one run, written when it is done, not before
    FOLDER/runs/ab/abcd.../         its logs, where they are kept
    FOLDER/runs.parquet             a row for each run
    FOLDER/estimates.parquet        a row for each run, estimator and parameter

Times are in the records only, so that the tables are the same bit for bit however a sweep was run.
"""

from __future__ import annotations

import json
import shutil
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

import pyarrow as pa
from pyarrow import parquet

from butterfly.errors import InputError
from butterfly.files import DRAFT, replacing

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence
    from pathlib import Path

    from butterfly.experiment.execution import Outcome

SWEEP = "sweep.json"
RUNS, ESTIMATES = "runs", "estimates"
TABLES = (RUNS, ESTIMATES)
"""Names of the tables."""

_RUNS = 2_000  # whose rows are gathered before they are written


class ResultStore:
    """A folder of results.

    Parameters
    ----------
    folder
        Made when something is written.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def record_path(self, key: str) -> Path:
        """Path of a run's record."""
        return self.folder / "runs" / key[:2] / f"{key}.json"

    def files_path(self, key: str) -> Path:
        """Folder of a run's logs."""
        return self.folder / "runs" / key[:2] / key

    def read(self, key: str) -> dict[str, Any] | None:
        """Return a run's record; None if there is none, or it cannot be read."""
        try:
            record = json.loads(self.record_path(key).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return None
        return record if isinstance(record, dict) else None

    def write(self, outcome: Outcome) -> None:
        """Write the files of a run, then its record, each whole or not at all."""
        key = outcome.record["key"]
        for name, content in outcome.files.items():
            with replacing(self.files_path(key) / name) as draft:
                draft.write_bytes(content)
        with replacing(self.record_path(key)) as draft:
            draft.write_text(json.dumps(outcome.record, indent=1), encoding="utf-8")

    def write_sweep(self, about: dict[str, Any]) -> None:
        """Write what was run: ``fields`` and ``runs``, each with number, key and overrides."""
        with replacing(self.folder / SWEEP) as draft:
            draft.write_text(json.dumps(about, indent=1), encoding="utf-8")

    def sweep(self) -> dict[str, Any]:
        """Read what was run.

        Raises
        ------
        InputError
            If the folder holds no results.
        """
        path = self.folder / SWEEP
        try:
            content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        except FileNotFoundError:
            raise InputError(path, "path", "no such file", "a folder of results") from None
        except (OSError, ValueError) as error:
            raise InputError(path, "content", error, "what a sweep wrote") from None
        return content

    def write_tables(self) -> None:
        """Put the tables together from the records, in the sweep's order."""
        about = self.sweep()
        runs = about["runs"]
        fields = [field for field in about["fields"] if field != "seed"]  # it has a column anyway
        kinds = {
            RUNS: (_run_rows, _run_schema(fields, runs)),
            ESTIMATES: (_estimate_rows, _estimate_schema(fields, runs)),
        }
        with ExitStack() as open_files:
            writers = {}
            for name, (_, schema) in kinds.items():
                draft = open_files.enter_context(replacing(self.folder / f"{name}.parquet"))
                writer = parquet.ParquetWriter(draft, schema, compression="zstd")
                writers[name] = open_files.enter_context(writer)
            for start in range(0, len(runs), _RUNS):
                part = [(run, self.read(run["key"])) for run in runs[start : start + _RUNS]]
                for name, (rows_of, schema) in kinds.items():
                    rows = [row for run, record in part for row in rows_of(run, record, fields)]
                    writers[name].write_table(pa.Table.from_pylist(rows, schema=schema))

    def table(self, name: str) -> pa.Table:
        """Read a table.

        Raises
        ------
        InputError
            If there is no such table.
        """
        path = self.folder / f"{name}.parquet"
        try:
            return parquet.read_table(path)
        except FileNotFoundError:
            raise InputError(path, "path", "no such file", "a folder of results") from None
        except (pa.ArrowException, OSError) as error:
            first = str(error).splitlines()[0]
            raise InputError(path, "content", first, "a whole Parquet file") from None

    def clean(self, *, failed: bool = False) -> list[Path]:
        """Remove records that no run of the sweep has, and unfinished files.

        Parameters
        ----------
        failed
            Whether to remove those of runs that did not succeed, too, to have them done again.

        Returns
        -------
        What was removed.
        """
        wanted = {run["key"] for run in self.sweep()["runs"]}
        removed = [path for path in self.folder.rglob(f"{DRAFT}*") if path.is_file()]
        for path in sorted((self.folder / "runs").glob("*/*.json")):
            record = self.read(path.stem)
            status = None if record is None else record["status"]
            if path.stem not in wanted or status is None or (failed and status != "ok"):
                removed += [path, *([self.files_path(path.stem)])]
        existing = [path for path in dict.fromkeys(removed) if path.exists()]
        for path in existing:
            shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
        return existing


def _run_rows(
    run: dict[str, Any], record: dict[str, Any] | None, fields: Sequence[str]
) -> Iterator[dict[str, Any]]:
    row = _place(run, fields)
    if record is None:
        yield row | {"status": "missing", "error": "not run"}
        return
    orbit = record.get("orbit", {})
    yield row | {
        "status": record["status"],
        "error": record["error"] or _first_error(record),
        "logs": record.get("logs", 0),
        "orbit_target": orbit.get("target_rad"),
        "orbit_amplitude": (orbit.get("amplitudes_rad") or [None])[-1],
        "orbit_rounds": len(orbit["amplitudes_rad"]) if orbit else None,
        "orbit_error_generic": orbit.get("free_run_rms_rad", {}).get("generic"),
        "orbit_error_recalibrated": orbit.get("free_run_rms_rad", {}).get("re-calibrated"),
    }


def _first_error(record: dict[str, Any]) -> str:
    errors = [f"{each['method']}: {each['error']}" for each in record["estimates"] if each["error"]]
    return errors[0] if errors else ""


def _estimate_rows(
    run: dict[str, Any], record: dict[str, Any] | None, fields: Sequence[str]
) -> Iterator[dict[str, Any]]:
    for each in record["estimates"] if record else []:
        for row in each.get("parameters", []):
            fit, held = each["fit"], each.get("held_out", {})
            yield (
                _place(run, fields)
                | {"estimator": each["method"], "condition": each["condition"]}
                | {f"fit_{name}": value for name, value in fit.items()}
                | {f"held_out_{name}": value for name, value in held.items()}
                | row
                | {"deviation": row["value"] / row["true"] - 1 if row["true"] else None}
            )


def _place(run: dict[str, Any], fields: Sequence[str]) -> dict[str, Any]:
    values = {field: _cell(run["overrides"].get(field)) for field in fields}
    return {name: run[name] for name in ("number", "key", "repetition", "seed")} | values


def _cell(value: Any) -> Any:  # noqa: ANN401 - whatever a field may be set to
    if isinstance(value, dict) and not any(isinstance(v, dict | list) for v in value.values()):
        return ", ".join(f"{key} {part}" for key, part in value.items())
    return json.dumps(value) if isinstance(value, dict | list) else value


def _place_schema(fields: Sequence[str], runs: Sequence[dict[str, Any]]) -> list[pa.Field]:
    kinds = {field: _kind([run["overrides"].get(field) for run in runs]) for field in fields}
    place = {"number": pa.int64(), "key": pa.string(), "repetition": pa.int64(), "seed": pa.int64()}
    return [pa.field(name, kind) for name, kind in (place | kinds).items()]


def _kind(values: Iterable[Any]) -> pa.DataType:
    """Type of a column that holds all of some values: numbers, truth values, or texts."""
    kinds = {type(value) for value in values if value is not None}
    if kinds <= {bool}:
        return pa.bool_()
    return pa.float64() if kinds <= {int, float} else pa.string()


def _run_schema(fields: Sequence[str], runs: Sequence[dict[str, Any]]) -> pa.Schema:
    texts = [pa.field(name, pa.string()) for name in ("status", "error")]
    orbit = ("orbit_target", "orbit_amplitude", "orbit_error_generic", "orbit_error_recalibrated")
    counts = [pa.field(name, pa.int64()) for name in ("logs", "orbit_rounds")]
    rest = [pa.field(name, pa.float64()) for name in orbit]
    return pa.schema([*_place_schema(fields, runs), *texts, *counts, *rest])


def _estimate_schema(fields: Sequence[str], runs: Sequence[dict[str, Any]]) -> pa.Schema:
    texts = [pa.field(name, pa.string()) for name in ("estimator", "parameter")]
    names = (
        *("value", "standard_error", "lower", "upper", "true", "deviation", "condition"),
        *("fit_median", "fit_mean", "fit_worst", "held_out_median", "held_out_worst"),
    )
    return pa.schema(
        [*_place_schema(fields, runs), *texts, *(pa.field(name, pa.float64()) for name in names)]
    )
