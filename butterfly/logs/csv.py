"""Logs in text files (.csv, .tsv, .txt, .dat), of any delimiter, encoding and column names."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow
from pyarrow import csv

from butterfly.arrays import Samples
from butterfly.errors import InputError
from butterfly.files import require_file, write_file
from butterfly.logs.clock import EXACT, dates
from butterfly.logs.formats import DEFAULT_COLUMNS, ColumnMap, checked_map, chosen_columns, place
from butterfly.logs.log import MIN_SAMPLES, FileReading, Log
from butterfly.logs.text_table import (
    GROUPED,
    TextColumns,
    is_number,
    is_number_type,
    read_text_table,
    require_narrow,
)
from butterfly.logs.unit_hints import UnitHints
from butterfly.logs.unit_words import units_meant
from butterfly.logs.units import UNITS, Heading, Units, words_in

_TABS = {".tsv"}  # endings of files that are written with tabs
_LONGEST_LINE = 1 << 20  # bytes of a first line that are looked at
_BY_NUMBER = (
    "a header line with the column names, delimited like the numbers, or columns by number "
    "(--columns time=0,input=1,angle=2; without time=0, --interval S)"
)


def read_csv(path: Path, columns: ColumnMap | None, units: Units, about: dict[str, Any]) -> Log:
    """Read a log (see `read_log`) from a table of any delimiter, with comments and units."""
    wanted = checked_map(path, columns or DEFAULT_COLUMNS, about)
    table = _table(
        path,
        lambda names: chosen_columns(path, names, columns, about)[0].values(),
        by_number=all(str(column).isdecimal() for column in wanted.values()),
    )
    return log_of_text(path, table, columns, units, about)


def log_of_text(
    path: Path, table: TextColumns, columns: ColumnMap | None, units: Units, about: dict[str, Any]
) -> Log:
    """Return the log in the table of a file; ``about``: what else is known of it."""
    places, unasked = chosen_columns(path, table.names, columns, about)
    reading = table.reading
    for field in unasked:
        if not isinstance(table.columns[places[field]], np.ndarray):
            del places[field]
            layout = (*reading.layout, f"column {field} has no numbers and is ignored")
            reading = replace(reading, layout=layout)
    if unclear := [table.grouped[k] for k in places.values() if k in table.grouped]:
        meant = unclear[0].replace(".", "")
        reading = replace(
            reading, unclear=f"{unclear[0]} read with a decimal point, not as {meant}"
        )
    named = columns or {}
    arrays = {f: _numeric(path, table, k, str(named.get(f, f)), f) for f, k in places.items()}
    headings = _headings(path, table, places)
    about |= {"source": str(path), "reading": reading}
    return Log.of_columns(arrays, headings, units, unasked=unasked, **about)


def _headings(path: Path, table: TextColumns, places: Mapping[str, int]) -> dict[str, Heading]:
    """Return the headings of columns; a line in place of a header may say units unclearly."""
    sayings = UnitHints(path, table.names)
    if table.units is not None:
        sayings.row(table.units, "row of units")
    sayings.text(table.remarks, "comment", table.split)
    for name, text in _texts_of(table).items():
        sayings.cell(name, text)
    for number, text, where in table.notes:
        if number is None:
            sayings.text([text], where, table.split)
        else:
            sayings.note(number, text, where)
    headings = sayings.headings(places)
    if table.headless is None or any(heading.unit_words for heading in headings.values()):
        return headings
    for field, k in places.items():
        units = [
            word for word in words_in(table.headless) if {*units_meant(word)} & {*UNITS[field]}
        ]
        sayings.column(k, f"{', '.join(units)}, column unclear" * bool(units), "line above")
    return sayings.headings(places)


def _texts_of(table: TextColumns) -> dict[str, str]:
    """Return the first text of each column of texts, such as one of units, by its name."""
    texts = {k: column for k, column in table.columns.items() if not isinstance(column, np.ndarray)}
    return {table.names[k]: str(column[0]) for k, column in texts.items() if table.names[k]}


def write_csv(log: Log, path: Path) -> None:
    """Write the columns of a log, named as in `DEFAULT_COLUMNS`, every number in full."""
    write_file(path, csv_text(log, "\t" if path.suffix.lower() in _TABS else ","))


def csv_text(log: Log, delimiter: str = ",") -> str:
    """Return what `write_csv` writes."""
    columns = log.columns()
    texts = (map(repr, column.astype(np.float64).tolist()) for column in columns.values())
    rows = zip(*texts, strict=True)
    return "\n".join([delimiter.join(columns), *map(delimiter.join, rows), ""])


def read_columns(path: Path, wanted: Sequence[str]) -> list[Samples]:
    """Read (n,) numeric columns of a table by their names."""
    table = _table(path, lambda names: [place(path, names, name) for name in wanted])
    return [_numeric(path, table, place(path, table.names, name), name) for name in wanted]


def holds_table(path: Path, width: int = 3) -> bool:
    """Whether a file holds enough numbers for a log of so many columns."""
    try:
        table = read_text_table(path)
    except InputError:
        return False
    return len(table.lines) >= MIN_SAMPLES and len(table.columns) >= width


def _table(
    path: Path, wanted: Callable[[Sequence[str]], Iterable[int]], *, by_number: bool = False
) -> TextColumns:
    """Read a file with pyarrow, which is fast, if it finds the columns ``wanted`` of the names."""
    require_file(path, "an existing file")
    with path.open("rb") as file:
        require_narrow(path, 1, file.readline(_LONGEST_LINE).decode("latin-1"))
    try:
        with csv.open_csv(path) as beginning:
            schema = beginning.schema
            names: Sequence[str] = schema.names
            numbers = [*wanted(names)]
            whole = [k for k in numbers if pyarrow.types.is_integer(schema.types[k])]
            kinds = {k: kind for k, kind in enumerate(schema.types) if k not in numbers}
            texts = [k for k, kind in kinds.items() if pyarrow.types.is_string(kind)]
            first = beginning.read_next_batch() if whole or texts else ()
        plain = all(is_number_type(schema.types[number]) for number in numbers)
        plain &= all(abs(first[k][0].as_py() or 0) < EXACT for k in whole)
        if plain and len(set(names)) == len(names) and not any(map(is_number, names)):
            columns = _streamed(path, {number: names[number] for number in numbers})
            with path.open("rb") as file:
                file.seek(-1, os.SEEK_END)
                cut = int(file.read() not in {b"\n", b"\r"})  # the last line may be incomplete
            complete = {number: column[: column.size - cut] for number, column in columns.items()}
            complete |= {k: pyarrow.chunked_array([first[k][:1]]) for k in texts}
            return TextColumns(names=names, columns=complete, reading=FileReading(cut_lines=cut))
    except (InputError, pyarrow.ArrowInvalid, OSError, UnicodeDecodeError):
        pass
    table = read_text_table(path)
    if table.headless is not None and not by_number:
        value = f"{table.headless} above rows of {len(table.columns)} numbers"
        raise InputError(path, "header", value, _BY_NUMBER)
    return table


def _streamed(path: Path, wanted: Mapping[int, str]) -> dict[int, Samples]:
    """Read columns, by number, of a file of any length, without keeping the rest in memory."""
    options = csv.ConvertOptions(
        include_columns=list(wanted.values()),
        column_types=dict.fromkeys(wanted.values(), pyarrow.float64()),
    )
    parts: dict[int, list[Samples]] = {number: [] for number in wanted}
    with csv.open_csv(path, convert_options=options) as batches:
        for batch in batches:
            for number, name in wanted.items():
                values = batch.column(name).to_numpy(zero_copy_only=False)
                parts[number].append(np.array(values, dtype=np.float64))
    return {number: np.concatenate(parts.pop(number)) for number in wanted}


def _numeric(path: Path, table: TextColumns, number: int, name: str, field: str = "") -> Any:  # noqa: ANN401 - numbers, or the dates of a clock
    column, clock = table.columns[number], field == "time"
    if isinstance(column, np.ndarray):
        return column if clock else column.astype(np.float64, copy=False)
    if clock and (stamps := dates(column)) is not None:
        return stamps
    if pyarrow.types.is_null(column.type):  # nothing is written in it
        return np.full(len(column), np.nan)
    texts = ["" if cell is None else str(cell).strip().strip('"') for cell in column.to_pylist()]
    grouped = next((k for k, text in enumerate(texts) if GROUPED.fullmatch(text)), None)
    row = next((k for k, text in enumerate(texts) if not is_number(text)), grouped)
    if row is None:
        raise InputError(path, name, f"a column of type {column.type}", "numbers")
    expected = "a number, or a date as in ISO 8601 (2026-03-01T10:30:12.5)" if clock else "a number"
    expected += " (without thousands separators)" if row == grouped else ""
    raise InputError(path, name, f"{texts[row]!r} in line {table.lines[row]}", expected)
