"""Logs in Parquet files: columns of numbers, of lists of them, and of structs of these."""

from __future__ import annotations

import io
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow import compute, parquet

from butterfly.errors import InputError, size_text
from butterfly.files import most_in, require_file, whole
from butterfly.logs.formats import ColumnMap, Component, chosen_columns, components
from butterfly.logs.log import Log
from butterfly.logs.text_table import is_number_type
from butterfly.logs.unit_hints import UnitHints
from butterfly.logs.units import Units

_BYTES = 8  # of a number
_AT_A_TIME, _FIRST = 1 << 20, 100  # samples
_FOLDERS = 3  # above a file, in one of which a data set describes it


def read_parquet(path: Path, columns: ColumnMap | None, units: Units, about: dict[str, Any]) -> Log:
    """Read a log (see `read_log`); other columns are ignored."""
    require_file(path, "an existing Parquet file")
    checking = {"page_checksum_verification": True}  # of files that have any
    with whole(path, "a whole Parquet file"), parquet.ParquetFile(path, **checking) as file:
        schema = file.schema_arrow
        leaves = _leaves(schema)
        lists = {leaf.name: leaf for leaf in leaves if _is_list(leaf.kind)}
        parts = components(_heads(file, lists.values()))
        parts |= _named_by_dataset(path, parts)
        names = [*(leaf.name for leaf in leaves), *parts]
        places, unasked = chosen_columns(path, names, columns, about)
        for field in unasked:
            if not is_number_type(leaves[places[field]].kind):
                del places[field]
        sayings = _sayings_of(path, schema, names)
        for name, text in _texts(file).items():
            sayings.cell(name, text)
        headings = sayings.headings(places)
        single = {field: parts[names[k]] for field, k in places.items() if k >= len(leaves)}
        wanted = {column: lists[column] for part in single.values() for column in part.needs}
        _refuse_many(path, file, len(places) + len(wanted))
        tables = {name: _rows(file, leaf) for name, leaf in wanted.items()}
        arrays = {
            field: single[field].of(tables)
            if field in single
            else _column(path, file, leaves[places[field]], field)
            for field in places
        }
    pa.default_memory_pool().release_unused()  # of a long log it would keep as much again
    headings |= {field: replace(headings[field], number=None) for field in single}
    about |= {"source": str(path)}
    return Log.of_columns(arrays, headings, units, unasked=unasked, **about)


def _named_by_dataset(path: Path, parts: Mapping[str, Component]) -> dict[str, Component]:
    """Return the parts of columns of lists by the names that a LeRobot data set gives them.

    They are in ``meta/info.json`` above the file: features, by column, with names of their parts.
    """
    above = (folder / "meta/info.json" for folder in list(path.resolve().parents)[:_FOLDERS])
    place = next((file for file in above if file.is_file()), None)
    if place is None:
        return {}
    try:
        features = json.loads(place.read_text("utf-8"))["features"]
        given = {column: feature.get("names") for column, feature in features.items()}
    except (OSError, ValueError, LookupError, TypeError, AttributeError):
        return {}  # another program's file of this name
    named = {}
    for column, names in given.items():
        flat = next(iter(names.values()), None) if isinstance(names, dict) else names
        for k, name in enumerate(flat if isinstance(flat, list) else []):
            if (part := parts.get(f"{column}.{k}")) is not None and isinstance(name, str):
                named[f"{column}.{name}"] = part
    return named


def _sayings_of(path: Path, schema: pa.Schema, names: Sequence[str]) -> UnitHints:
    """Return what the metadata of a schema and of its columns say, and the types of clocks."""
    sayings = UnitHints(path, names)
    for k, field in enumerate(schema):
        if _is_clock(field.type):
            sayings.column(k, field.type.unit, "type")
        sayings.metadata(field.metadata or {}, "metadata", (k,))
    sayings.metadata(schema.metadata or {}, "metadata")
    return sayings


def _texts(file: parquet.ParquetFile) -> dict[str, str]:
    """Return the first text of each column of texts, such as one of units, by its name."""
    names = [field.name for field in file.schema_arrow if pa.types.is_string(field.type)]
    first = next(file.iter_batches(1, columns=names), None) if names else None
    return {name: str(first[name][0]) for name in names if first is not None and len(first)}


class _Leaf(NamedTuple):
    """A column of a file, or a field of a column of structs."""

    name: str
    column: str  # of the file
    which: int  # of the columns of this name
    way: tuple[int, ...]  # fields of structs
    kind: pa.DataType


def _leaves(schema: pa.Schema) -> list[_Leaf]:
    """Return the columns of a file, and then the fields of those of structs."""
    names = schema.names
    leaves = [
        _Leaf(name, name, names[:k].count(name), (), schema.types[k])
        for k, name in enumerate(names)
    ]
    for leaf in leaves:  # which grows
        if pa.types.is_struct(leaf.kind):
            for k, field in enumerate(leaf.kind):
                part = leaf._replace(name=f"{leaf.name}.{field.name}", kind=field.type)
                leaves.append(part._replace(way=(*leaf.way, k)))
    return leaves


def _heads(file: parquet.ParquetFile, leaves: Iterable[_Leaf]) -> dict[str, list[Any]]:
    """Return the first rows of columns of lists."""
    batches = {leaf: file.iter_batches(_FIRST, columns=[leaf.column]) for leaf in leaves}
    return {
        leaf.name: _part(batch, leaf).to_pylist()
        for leaf, stream in batches.items()
        for batch in islice(stream, 1)
    }


def _refuse_many(path: Path, file: parquet.ParquetFile, columns: int) -> None:
    """Refuse a file that claims more rows than it can hold."""
    most = most_in(path.stat().st_size)
    if not 0 <= file.metadata.num_rows * columns * _BYTES <= most:
        claim = f"{file.metadata.num_rows} rows in {size_text(path.stat().st_size)}"
        expected = f"a whole Parquet file of at most {size_text(most)}"
        raise InputError(path, "content", claim, expected)


def _column(path: Path, file: parquet.ParquetFile, leaf: _Leaf, field: str) -> NDArray[Any]:
    """Read a column of numbers, or a clock."""
    texts = pa.types.is_string(leaf.kind) or pa.types.is_large_string(leaf.kind)
    clock = field == "time" and (texts or _is_clock(leaf.kind))
    if not is_number_type(leaf.kind) and not clock:
        expected = f"one of its parts: {leaf.name}.0, ..." if _is_list(leaf.kind) else "numbers"
        raise InputError(path, leaf.name, f"a column of {leaf.kind}", expected)
    return np.asarray(_whole_column(file, leaf).to_numpy())


def _rows(file: parquet.ParquetFile, leaf: _Leaf) -> Any:  # noqa: ANN401 - a matrix, or lists
    """Read a column of lists: a matrix if all are numbers and equally long."""
    column = _whole_column(file, leaf)
    lengths = compute.min_max(compute.list_value_length(column)).as_py()
    equal = lengths["min"] == lengths["max"] and column.null_count == 0
    if not equal or not is_number_type(leaf.kind.value_type):
        return column.to_pylist()
    return compute.list_flatten(column).to_numpy().reshape(len(column), -1)


def _whole_column(file: parquet.ParquetFile, leaf: _Leaf) -> pa.ChunkedArray:
    batches = file.iter_batches(_AT_A_TIME, columns=[leaf.column])
    return pa.chunked_array([_part(batch, leaf) for batch in batches], leaf.kind)


def _part(batch: pa.RecordBatch, leaf: _Leaf) -> pa.Array:
    """Return a column of a batch, which may hold others whose names begin as its name does."""
    numbers = [k for k, name in enumerate(batch.schema.names) if name == leaf.column]
    column = batch.column(numbers[leaf.which])
    return compute.struct_field(column, [*leaf.way]) if leaf.way else column


def _is_list(kind: pa.DataType) -> bool:
    types = pa.types
    return bool(types.is_list(kind) or types.is_large_list(kind) or types.is_fixed_size_list(kind))


def _is_clock(kind: pa.DataType) -> bool:
    return bool(pa.types.is_timestamp(kind) or pa.types.is_duration(kind))


def parquet_bytes(log: Log) -> bytes:
    """Return the content of the Parquet file of a log."""
    buffer = io.BytesIO()
    how = {"compression": "zstd", "write_page_checksum": True}
    parquet.write_table(pa.table(log.columns()), buffer, **how)
    return buffer.getvalue()
