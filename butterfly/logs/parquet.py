"""Logs in Parquet files: columns time, input, angle and, if recorded, velocity."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pyarrow as pa
from pyarrow import parquet

from butterfly.errors import InputError, size_text
from butterfly.files import most_in, require_file, whole
from butterfly.logs.formats import ColumnMap, chosen_columns
from butterfly.logs.log import Log
from butterfly.logs.said import Sayings
from butterfly.logs.text_table import is_number_type
from butterfly.logs.units import Units

_BYTES = 8  # of a number
_AT_A_TIME = 1 << 20  # samples


def read_parquet(path: Path, columns: ColumnMap | None, units: Units, about: dict[str, Any]) -> Log:
    """Read a log (see `read_log`); other columns are ignored."""
    require_file(path, "an existing Parquet file")
    with whole(path, "a whole Parquet file"), parquet.ParquetFile(path) as file:
        schema = file.schema_arrow
        places, unasked = chosen_columns(path, schema.names, columns, about)
        for field in unasked:
            if not is_number_type(schema.types[places[field]]):
                del places[field]
        sayings = _said(path, schema)
        for name, text in _texts(file).items():
            sayings.cell(name, text)
        headings = sayings.headings(places)
        arrays = _columns(path, file, places)
    pa.default_memory_pool().release_unused()  # of a long log it would keep as much again
    about |= {"source": str(path)}
    return Log.of_columns(arrays, headings, units, unasked=unasked, **about)


def _said(path: Path, schema: pa.Schema) -> Sayings:
    """Return what the metadata of a schema and of its columns say, and the types of clocks."""
    sayings = Sayings(path, schema.names)
    for k, field in enumerate(schema):
        if _is_clock(field.type):
            sayings.column(k, field.type.unit, "type")
        sayings.metadata(field.metadata or {}, "metadata", (k,))
    sayings.metadata(schema.metadata or {}, "metadata")
    return sayings


def _texts(file: parquet.ParquetFile) -> dict[str, str]:
    """Return the first text of each column of texts, such as one of units, by its name."""
    names = [each.name for each in file.schema_arrow if pa.types.is_string(each.type)]
    first = next(file.iter_batches(1, columns=names), None) if names else None
    return {name: str(first[name][0]) for name in names if first is not None and len(first)}


def _columns(path: Path, file: parquet.ParquetFile, places: Mapping[str, int]) -> dict[str, Any]:
    """Read columns one by one, by field of the log."""
    names = file.schema_arrow.names
    most = most_in(path.stat().st_size)
    if not 0 <= file.metadata.num_rows * len(places) * _BYTES <= most:
        found = f"{file.metadata.num_rows} rows in {size_text(path.stat().st_size)}"
        expected = f"a whole Parquet file of at most {size_text(most)}"
        raise InputError(path, "content", found, expected)
    arrays = {}
    for field, number in places.items():
        name, kind = names[number], file.schema_arrow.types[number]
        texts = pa.types.is_string(kind) or pa.types.is_large_string(kind)
        if not is_number_type(kind) and not (field == "time" and (texts or _is_clock(kind))):
            raise InputError(path, name, f"a column of {kind}", "numbers")
        batches = file.iter_batches(_AT_A_TIME, columns=[name])
        which = names[:number].count(name)  # of the columns of this name
        parts = [batch.column(which) for batch in batches]
        arrays[field] = pa.chunked_array(parts, kind).to_numpy()
    return arrays


def _is_clock(kind: pa.DataType) -> bool:
    return bool(pa.types.is_timestamp(kind) or pa.types.is_duration(kind))


def parquet_bytes(log: Log) -> bytes:
    """Return the content of the Parquet file of a log."""
    buffer = io.BytesIO()
    parquet.write_table(pa.table(log.columns()), buffer, compression="zstd")
    return buffer.getvalue()
