"""Logs in text files (.csv, .tsv, .txt, .dat), whatever their columns are called."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow
from numpy.typing import NDArray
from pyarrow import csv

from butterfly.errors import InputError
from butterfly.files import replacing
from butterfly.logs.csv_dialect import is_number, read_text_table
from butterfly.logs.formats import (
    DEFAULT_COLUMNS,
    ColumnMap,
    checked_map,
    has_column,
    place,
    unit_in,
)
from butterfly.logs.log import AS_WRITTEN, FileReading, Log
from butterfly.logs.units import AS_IS, Units, known_factor

_TABS = {".tsv"}  # endings of files that are written with tabs
_VELOCITY = "velocity"

_BY_NUMBER = (
    "a line with the names of the columns, delimited as the numbers are, or columns by number "
    "(--columns time=0,input=1,angle=2)"
)


@dataclass(frozen=True)
class _Table:
    """Names and columns of a file, and what else it gives."""

    names: Sequence[str]
    columns: Mapping[int, NDArray[np.float64] | pyarrow.ChunkedArray]
    units: Sequence[str] | None = None
    lines: Sequence[int] | None = None
    reading: FileReading = AS_WRITTEN


def read_csv(
    path: Path,
    columns: ColumnMap | None = None,
    units: Units = AS_IS,
    **properties: Any,  # noqa: ANN401 - the fields of Log that a file cannot know
) -> Log:
    """Read a table of numbers, delimited by commas, semicolons, tabs or blanks (see `read_log`).

    Lines of comment (``#``, ``%``, ``//``) are skipped, a last line that was cut off is dropped and
    counted. Units in brackets behind a column's name, or in a row below the names, are used unless
    ``units`` say others. Without a map a column ``velocity`` is read too, if it holds numbers.
    """
    mapping = checked_map(path, columns or DEFAULT_COLUMNS)
    table = _table(path, mapping.values(), () if columns else (_VELOCITY,))
    layout = table.reading.layout
    if not columns and has_column(table.names, _VELOCITY):
        if _holds_numbers(table.columns[place(path, table.names, _VELOCITY)]):
            mapping[_VELOCITY] = _VELOCITY
        else:
            layout += ("no numbers in the column velocity, which is left out",)
    places = {field: place(path, table.names, name) for field, name in mapping.items()}
    arrays = {
        field: _numeric(path, table, number, str(mapping[field]))
        for field, number in places.items()
    }
    found = _own_units(path, table, places, units)
    factors = {field: known_factor(field, unit) or 1.0 for field, unit in found.items()}
    others = {field: unit for field, unit in found.items() if factors[field] != 1.0}
    reading = replace(table.reading, layout=layout, units=others)
    converted: dict[str, Any] = units.over(factors).applied(arrays)
    return Log(**converted, source=str(path), reading=reading, **properties)


def write_csv(log: Log, path: Path) -> None:
    """Write a log with the header that `DEFAULT_COLUMNS` expects, every number in full.

    A missing velocity column is left out.
    """
    delimiter = "\t" if path.suffix.lower() in _TABS else ","
    columns = log.columns()
    texts = (map(repr, column.astype(np.float64).tolist()) for column in columns.values())
    rows = zip(*texts, strict=True)
    with replacing(path) as draft:
        lines = [delimiter.join(columns), *map(delimiter.join, rows), ""]
        draft.write_text("\n".join(lines), encoding="ascii")


def read_columns(path: Path, names: Iterable[str]) -> list[NDArray[np.float64]]:
    """Read (n,) numeric columns of a table by their names."""
    wanted = list(names)
    table = _table(path, wanted)
    return [_numeric(path, table, place(path, table.names, name), name) for name in wanted]


def _table(path: Path, wanted: Iterable[str | int], welcome: Iterable[str] = ()) -> _Table:
    """Read a file as pyarrow does, which is fast, if that finds the wanted columns in it."""
    wanted = list(wanted)
    try:
        with csv.open_csv(path) as beginning:
            schema = beginning.schema
        names = schema.names
        known = [*wanted, *(name for name in welcome if has_column(names, name))]
        numbers = [place(path, names, name) for name in known]
        plain = all(_is_number_type(schema.types[number]) for number in numbers)
        if plain and len(set(names)) == len(names) and not any(map(is_number, names)):
            return _Table(names, _streamed(path, {number: names[number] for number in numbers}))
    except (InputError, pyarrow.ArrowInvalid, OSError, UnicodeDecodeError):
        pass
    return _loose(path, wanted)


def _streamed(path: Path, wanted: Mapping[int, str]) -> dict[int, NDArray[np.float64]]:
    """Read columns, by their numbers, of a file of any length: no more of it is kept at a time."""
    options = csv.ConvertOptions(
        include_columns=list(wanted.values()),
        column_types=dict.fromkeys(wanted.values(), pyarrow.float64()),
    )
    parts: dict[int, list[NDArray[np.float64]]] = {number: [] for number in wanted}
    with csv.open_csv(path, convert_options=options) as batches:
        for batch in batches:
            for number, name in wanted.items():
                values = batch.column(name).to_numpy(zero_copy_only=False)
                parts[number].append(np.array(values, dtype=np.float64))
    return {number: np.concatenate(parts.pop(number)) for number in wanted}


def _loose(path: Path, wanted: Sequence[str | int]) -> _Table:
    table = read_text_table(path)
    names = table.names
    if names is None:
        if not all(str(each).isdecimal() for each in wanted):
            above = "no line" if table.above is None else repr(table.above)
            found = f"{above} above rows of {len(table.columns)} numbers"
            raise InputError(path, "header", found, _BY_NUMBER)
        names = [""] * len(table.columns)
    columns = dict(enumerate(table.columns))
    return _Table(names, columns, table.units, table.lines, table.reading)


def _own_units(path: Path, table: _Table, places: dict[str, int], units: Units) -> dict[str, str]:
    """Return the units that a file gives to the wanted columns, unless they were given."""
    found = {}
    for field, number in places.items():
        unit = unit_in(table.names[number])
        if unit is not None and known_factor(field, unit) is None:
            unit = None  # a bracket may hold anything
        if table.units is not None:
            unit = table.units[number]
        if not unit or unit == "-" or field in units.factors:
            continue
        if known_factor(field, unit) is None:
            expected = f"a unit that is known, or --units {field}=... (units: in the manifest)"
            raise InputError(path, f"unit of {field}", unit, expected)
        found[field] = unit
    return found


def _is_number_type(kind: pyarrow.DataType) -> bool:
    return bool(pyarrow.types.is_integer(kind) or pyarrow.types.is_floating(kind))


def _holds_numbers(column: NDArray[np.float64] | pyarrow.ChunkedArray) -> bool:
    return isinstance(column, np.ndarray) or _is_number_type(column.type)


def _numeric(path: Path, table: _Table, number: int, name: str) -> NDArray[np.float64]:
    column = table.columns[number]
    if isinstance(column, np.ndarray):
        return column
    if _is_number_type(column.type):
        return np.asarray(column.to_numpy().astype(np.float64))
    texts = [str(each).strip().strip('"') for each in column.to_pylist()]
    row = next((k for k, text in enumerate(texts) if not is_number(text)), None)
    if row is None or table.lines is None:
        raise InputError(path, name, f"a column of type {column.type}", "numbers")
    raise InputError(path, name, f"{texts[row]!r} in line {table.lines[row]}", "a number")
