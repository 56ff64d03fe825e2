"""Logs as Parquet files: columns time, input, angle and, if known, velocity."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from pyarrow import parquet

from butterfly.errors import InputError, size_text
from butterfly.files import most_in, require_file
from butterfly.logs.formats import DEFAULT_COLUMNS, VELOCITY, ColumnMap, checked_map, place
from butterfly.logs.log import Log
from butterfly.logs.units import AS_IS, Units

_BYTES = 8  # of a number
_AT_A_TIME = 1 << 20  # samples


def read_parquet(
    path: Path,
    columns: ColumnMap | None = None,
    units: Units = AS_IS,
    **properties: Any,  # noqa: ANN401 - the fields of Log that a file cannot know
) -> Log:
    """Read a log (see `read_log`); columns that are not asked for are ignored."""
    mapping = checked_map(path, columns or DEFAULT_COLUMNS)
    require_file(path, "an existing Parquet file")
    try:
        with parquet.ParquetFile(path) as file:
            arrays = _columns(path, file, mapping, None if columns else VELOCITY)
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        first = str(error).splitlines()[0]
        raise InputError(path, "content", first, "a whole Parquet file") from None
    pa.default_memory_pool().release_unused()  # of a long log it would keep as much again
    return Log(**arrays, source=str(path), **properties).converted(units)


def _columns(
    path: Path, file: parquet.ParquetFile, mapping: dict[str, str | int], welcome: str | None
) -> dict[str, Any]:
    """Read columns one after the other, by the log's field; and one that is welcome, if there."""
    names = file.schema_arrow.names
    wanted = {field: place(path, names, name) for field, name in mapping.items()}
    if welcome is not None and welcome in names:
        wanted[welcome] = names.index(welcome)
    most = most_in(path.stat().st_size)
    if not 0 <= file.metadata.num_rows * len(wanted) * _BYTES <= most:
        found = f"{file.metadata.num_rows} rows in {size_text(path.stat().st_size)}"
        expected = f"a whole Parquet file, of up to {size_text(most)}"
        raise InputError(path, "content", found, expected)
    arrays = {}
    for field, number in wanted.items():
        kind = file.schema_arrow.types[number]
        if not (pa.types.is_floating(kind) or pa.types.is_integer(kind)):
            raise InputError(path, names[number], f"a column of {kind}", "numbers")
        batches = file.iter_batches(_AT_A_TIME, columns=[names[number]])
        which = names[:number].count(names[number])  # of the columns of this name
        parts = [each.column(which).to_numpy(zero_copy_only=False) for each in batches]
        arrays[field] = np.concatenate([np.empty(0), *parts])
    return arrays


def parquet_bytes(log: Log) -> bytes:
    """Return the content of the Parquet file of a log."""
    buffer = io.BytesIO()
    parquet.write_table(pa.table(log.columns()), buffer, compression="zstd")
    return buffer.getvalue()
