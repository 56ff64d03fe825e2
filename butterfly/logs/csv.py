"""Logs in text files (.csv, .tsv, .txt, .dat), however they are delimited, encoded and named."""

from __future__ import annotations

import codecs
import io
import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from csv import reader as csv_reader
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import pyarrow
from pyarrow import csv

from butterfly.arrays import Samples
from butterfly.errors import InputError, require_room, size_text
from butterfly.files import read_file, require_file, write_file
from butterfly.logs.formats import (
    DEFAULT_COLUMNS,
    ColumnMap,
    checked_map,
    chosen_columns,
    place,
)
from butterfly.logs.log import AS_WRITTEN, MIN_SAMPLES, FileReading, Log
from butterfly.logs.units import AS_IS, UNITS, Heading, Units, units_spelt, without_unit, words_in

_TABS = {".tsv"}  # endings of files that are written with tabs
_PER_BYTE = 16  # bytes of memory that one of a text of an unusual form takes
_COMMENTS = ("#", "%", "//")
_WIDEST = 10_000  # columns
_LONGEST_LINE = 1 << 20  # bytes of a first line that are looked at
_SAMPLE = 60  # lines that show how a file is delimited
_DELIMITERS = {";": "semicolons", "\t": "tabs", ",": "commas", " ": "blanks"}
_BLANKS = re.compile(r"\s+(?![\[(])(?![^\[(]*[\])])")  # but for those before and within brackets
_NUMBER = re.compile(r"[+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?")
_MISSING = {"", "nan", "na", "n/a", "#n/a", "null", "inf", "+inf", "-inf", "-nan"}
_MARKS = {
    codecs.BOM_UTF8: "utf-8",
    codecs.BOM_UTF16_LE: "utf-16-le",
    codecs.BOM_UTF16_BE: "utf-16-be",
}
_BY_NUMBER = (
    "a line with the names of the columns, delimited as the numbers are, or columns by number "
    "(--columns time=0,input=1,angle=2)"
)

Column: TypeAlias = Samples | pyarrow.ChunkedArray


@dataclass(frozen=True, kw_only=True)
class TextColumns:
    """A table as its file gives it."""

    names: Sequence[str]  # "" each if the file has no header
    columns: Mapping[int, Column]
    units: Sequence[str] | None = None  # the row below the header; None if there is none
    headless: str | None = None  # what stands where a header should; None if that is one
    lines: Sequence[int] = ()  # (n,) number of each row's line, from 1 on
    reading: FileReading = AS_WRITTEN


class _Line(NamedTuple):
    number: int
    text: str


def read_csv(
    path: Path,
    columns: ColumnMap | None = None,
    units: Units = AS_IS,
    **properties: Any,  # noqa: ANN401 - the fields of Log that a file cannot know
) -> Log:
    """Read a table of numbers, delimited by commas, semicolons, tabs or blanks (see `read_log`).

    Lines of comment (``#``, ``%``, ``//``) are skipped, a last line that was cut off, or has no
    end, is dropped and counted. A row below the names may hold units. Without a map a column
    ``velocity`` is read too, if it holds numbers.
    """
    wanted = checked_map(path, columns or DEFAULT_COLUMNS, properties.get("input_kind"))
    table = _table(
        path,
        lambda names: chosen_columns(path, names, columns, properties)[0].values(),
        by_number=all(str(each).isdecimal() for each in wanted.values()),
    )
    places, unasked = chosen_columns(path, table.names, columns, properties)
    reading = table.reading
    for field in unasked:
        if not isinstance(table.columns[places[field]], np.ndarray):
            del places[field]
            layout = (*reading.layout, f"no numbers in the column {field}, which is left out")
            reading = replace(reading, layout=layout)
    arrays: dict[str, Any] = {
        field: _numeric(path, table, k, str(wanted.get(field, field)))
        for field, k in places.items()
    }
    headings = {
        field: Heading(name=table.names[k], number=k, said=_said(table, field, k))
        for field, k in places.items()
    }
    properties |= {"source": str(path), "reading": reading}
    return Log.of_columns(arrays, headings, units, unasked=unasked, **properties)


def _said(table: TextColumns, field: str, number: int) -> dict[str, str]:
    """Return the unit of a column besides its name; of a line that is no header it is unclear."""
    if table.units is not None:
        return {"row of units": table.units[number]}
    words = [word for word in words_in(table.headless or "") if units_spelt(field, word)]
    return {"line above": f"{', '.join(words)} of some column"} if words else {}


def write_csv(log: Log, path: Path) -> None:
    """Write the columns that a log has, as `DEFAULT_COLUMNS` calls them, every number in full."""
    delimiter = "\t" if path.suffix.lower() in _TABS else ","
    columns = log.columns()
    texts = (map(repr, column.astype(np.float64).tolist()) for column in columns.values())
    rows = zip(*texts, strict=True)
    write_file(path, "\n".join([delimiter.join(columns), *map(delimiter.join, rows), ""]))


def read_columns(path: Path, wanted: Sequence[str]) -> list[Samples]:
    """Read (n,) numeric columns of a table by their names."""
    table = _table(path, lambda names: [place(path, names, name) for name in wanted])
    return [_numeric(path, table, place(path, table.names, name), name) for name in wanted]


def holds_table(path: Path) -> bool:
    """Whether a file holds as many numbers as a log does at least."""
    try:
        table = read_text_table(path)
    except InputError:
        return False
    return len(table.lines) >= MIN_SAMPLES and len(table.columns) >= len(DEFAULT_COLUMNS)


def _table(
    path: Path, wanted: Callable[[Sequence[str]], Iterable[int]], *, by_number: bool = False
) -> TextColumns:
    """Read a file as pyarrow does, which is fast, if that finds the wanted columns in it.

    ``wanted`` gives their numbers by the names of all.
    """
    require_file(path, "an existing file")
    with path.open("rb") as file:
        _require_narrow(path, _Line(1, file.readline(_LONGEST_LINE).decode("latin-1")))
    try:
        with csv.open_csv(path) as beginning:
            schema = beginning.schema
        names: Sequence[str] = schema.names
        numbers = [*wanted(names)]
        plain = all(is_number_type(schema.types[number]) for number in numbers)
        if plain and len(set(names)) == len(names) and not any(map(is_number, names)):
            columns = _streamed(path, {number: names[number] for number in numbers})
            cut = int(not _is_ended(path))
            whole = {number: each[: each.size - cut] for number, each in columns.items()}
            return TextColumns(names=names, columns=whole, reading=FileReading(cut_lines=cut))
    except (InputError, pyarrow.ArrowInvalid, OSError, UnicodeDecodeError):
        pass
    table = read_text_table(path)
    if table.headless is not None and not by_number:
        found = f"{table.headless} above rows of {len(table.columns)} numbers"
        raise InputError(path, "header", found, _BY_NUMBER)
    return table


def _require_narrow(path: Path, line: _Line) -> None:
    """Refuse a line of more cells than anybody logs: pyarrow would make room for each."""
    cells = max(len(line.text.split(None if each == " " else each)) for each in _DELIMITERS)
    if cells > _WIDEST:
        raise InputError(path, f"line {line.number}", f"{cells} cells", f"up to {_WIDEST} columns")


def _is_ended(path: Path) -> bool:
    """Whether the last line has its end: of one without, a part may be missing."""
    with path.open("rb") as file:
        file.seek(-1, os.SEEK_END)
        return file.read() in {b"\n", b"\r"}


def _streamed(path: Path, wanted: Mapping[int, str]) -> dict[int, Samples]:
    """Read columns, by their numbers, of a file of any length: no more of it is kept at a time."""
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


def is_number_type(kind: pyarrow.DataType) -> bool:
    """Whether a column of pyarrow's holds numbers."""
    return bool(pyarrow.types.is_integer(kind) or pyarrow.types.is_floating(kind))


def _numeric(path: Path, table: TextColumns, number: int, name: str) -> Samples:
    column = table.columns[number]
    if isinstance(column, np.ndarray):
        return column
    texts = [str(each).strip().strip('"') for each in column.to_pylist()]
    row = next((k for k, text in enumerate(texts) if not is_number(text)), None)
    if row is None:
        raise InputError(path, name, f"a column of type {column.type}", "numbers")
    raise InputError(path, name, f"{texts[row]!r} in line {table.lines[row]}", "a number")


def read_text_table(path: Path) -> TextColumns:
    """Read a table of any delimiter, decimal sign and encoding, with or without a header."""
    size = require_file(path, "an existing file")
    require_room(path, "content", f"{size_text(size)} of an unusual form", _PER_BYTE * size)
    text, encoding = _decoded(path)
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    filled = [_Line(k, line) for k, line in enumerate(lines, 1) if line.strip()]
    comments = [line for line in filled if line.text.lstrip().startswith(_COMMENTS)]
    body = [line for line in filled if not line.text.lstrip().startswith(_COMMENTS)]
    for line in body:
        if len(line.text) > _WIDEST:
            _require_narrow(path, line)
    delimiter, first = _dialect(path, body)
    width = len(_cells(body[first].text, delimiter))
    while first and _is_without_names(_cells(body[first - 1].text, delimiter)):
        first -= 1
    rows = body[first:]
    unended = rows[-1].number == len(lines)
    cut = len(rows) > 1 and (unended or len(_cells(rows[-1].text, delimiter)) < width)
    rows = rows[:-1] if cut else rows
    heads, named = _heads(body[:first], comments, rows, delimiter, width)
    names, units = _names_and_units(heads)
    before = [line for line in (*comments, *body[:first]) if line.number < rows[0].number]
    above = repr(max(before).text.strip()) if before else "no line"
    others = first - (names is not None) - (units is not None) if first else 0
    decimal = "," if _has_decimal_commas(rows, delimiter) else "."
    texts = {
        f"{_DELIMITERS[delimiter]} between columns": delimiter != ",",
        "decimal commas": decimal == ",",
        encoding: encoding != "UTF-8",
        f"comment lines: {len(comments)}": bool(comments),
        f"lines above the table: {others}": others > 0,
        "no header": names is None,
        "row names in front": named,
    }
    layout = tuple(text for text, holds in texts.items() if holds)
    return TextColumns(
        names=names or [""] * width,
        units=units,
        headless=above if names is None else None,
        columns=dict(enumerate(_parsed(path, rows, delimiter, decimal, width))),
        lines=[line.number for line in rows],
        reading=FileReading(layout=layout, cut_lines=int(cut)),
    )


def is_number(text: str) -> bool:
    """Whether a cell holds a number, with a decimal point or comma."""
    return _NUMBER.fullmatch(text) is not None


def _decoded(path: Path) -> tuple[str, str]:
    """Return a file's text and the name of its encoding."""
    content = read_file(path, "an existing file")
    encoding = next((name for mark, name in _MARKS.items() if content.startswith(mark)), None)
    if encoding is None and content[1:200:2].count(0) > content[0:200:2].count(0):
        encoding = "utf-16-le"
    elif encoding is None and content[:200].count(0):
        encoding = "utf-16-be"
    named = "UTF-16" if encoding and encoding.startswith("utf-16") else "UTF-8"
    try:
        return content.decode(encoding or "utf-8").removeprefix("\ufeff"), named
    except UnicodeDecodeError:
        if encoding is not None or b"\0" in content:
            raise InputError(path, "content", "bytes that are not text", "a text file") from None
    return content.decode("latin-1"), "Latin-1"


def _cells(text: str, delimiter: str) -> list[str]:
    if delimiter == " ":
        cells = text.split()
        if any(cell[0] not in "[(" for cell in cells) and ("[" in text or "(" in text):
            cells = _BLANKS.split(text.strip())
    elif '"' in text:
        cells = next(csv_reader([text.strip()], delimiter=delimiter, skipinitialspace=True))
    else:
        cells = text.split(delimiter)
    return [cell.strip().strip('"').strip() for cell in cells]


def _dialect(path: Path, body: list[_Line]) -> tuple[str, int]:
    """Return the delimiter by which most cells are numbers, and which line is the first row."""
    sample = body[:_SAMPLE]
    best, share = ",", 0.0
    for delimiter in _DELIMITERS:
        rows = [_cells(line.text, delimiter) for line in sample]
        filled = [[cell for cell in row if cell] for row in rows if len(row) > 1]
        numbers = sum(sum(map(is_number, row)) for row in filled if sum(map(is_number, row)) > 1)
        own = numbers / max(sum(map(len, filled)), 1)
        if own > share:
            best, share = delimiter, own
    for k, line in enumerate(body if share else []):
        cells = _cells(line.text, best)
        if sum(map(is_number, cells)) > 1 and 2 * sum(map(_is_value, cells)) >= len(cells):
            return best, k
    expected = "a table of numbers, delimited by commas, semicolons, tabs or blanks"
    raise InputError(path, "content", "no row of numbers", expected)


def _is_value(cell: str) -> bool:
    return is_number(cell) or cell.lower() in _MISSING


def _is_without_names(cells: list[str]) -> bool:
    """Whether a line above the first full row is one too, its numbers missing, and no header."""
    return any(cells) and len(cells) > 1 and all(_is_value(cell.rstrip(";")) for cell in cells)


def _heads(
    above: list[_Line], comments: list[_Line], rows: list[_Line], delimiter: str, width: int
) -> tuple[list[list[str]], bool]:
    """Return the cells of the lines, two at most, right above the rows that name their columns.

    If there are none, the comment lines right above the rows may be: so NumPy writes a header. Also
    whether they are one short, as R writes them, since the rows have names in front.
    """
    texts = [line.text for line in above]
    if not texts:
        before = (line.text.lstrip() for line in comments if line.number < rows[0].number)
        texts = [text.lstrip("#%/") for text in before]
    heads: list[list[str]] = []
    named = False
    for text in texts[:-3:-1]:
        cells = _cells(text, delimiter)
        cells = cells[:width] if not any(cells[width:]) else cells
        if len(cells) == width - 1:
            ends = [_cells(line.text, delimiter) for line in rows]
            named = any(row[-1] for row in ends) and _are_names([row[0] for row in ends])
            cells = (
                ["", *cells]
                if named
                else [*cells, *("" for _ in range(not any(row[-1] for row in ends)))]
            )
        if len(cells) != width:
            break
        heads.insert(0, cells)
    return heads, named


def _are_names(cells: list[str]) -> bool:
    """Whether a column names rows: numbers from R, each once, or no numbers."""
    whole = all(cell.isdecimal() for cell in cells) and len(set(cells)) == len(cells)
    return whole or not any(map(is_number, cells))


def _names_and_units(heads: list[list[str]]) -> tuple[list[str] | None, list[str] | None]:
    """Tell the names from the row of units below or above them."""
    if not heads:
        return None, None
    first, last = heads[0], heads[-1]
    distinct = all(first) and len(set(first)) == len(first)
    if len(heads) > 1 and _are_units(last, most=not distinct):
        return first, last
    return last, first if len(heads) > 1 and _are_units(first) else None


def _are_units(cells: list[str], *, most: bool = True) -> bool:
    """Whether a row holds units: most of its cells are, or one if not ``most``; or all brackets."""
    given = [cell for cell in cells if cell not in {"", "-"}]
    known = [
        cell for cell in given if any(units_spelt(name, cell.strip("[]() ")) for name in UNITS)
    ]
    bracketed = all(words_in(cell) and not without_unit(cell) for cell in given)
    return 2 * len(known) > len(given) or bracketed or (bool(known) and not most)


def _has_decimal_commas(rows: list[_Line], delimiter: str) -> bool:
    """Whether the first number that is no whole one is written with a comma."""
    for line in rows:
        if "," not in line.text and "." not in line.text:
            continue
        for cell in _cells(line.text, delimiter):
            if is_number(cell) and ("," in cell or "." in cell):
                return "," in cell
    return False


def _parsed(
    path: Path, rows: list[_Line], delimiter: str, decimal: str, width: int
) -> list[Column]:
    blanks = delimiter == " "
    for line in rows:
        count = len(line.text.split()) if blanks else line.text.count(delimiter) + 1
        if count != width and len(_cells(line.text, delimiter)) != width:
            found = f"{len(_cells(line.text, delimiter))} values"
            expected = f"{width}, as in the first row"
            if delimiter == ",":
                expected += " (numbers with decimal commas need another delimiter)"
            raise InputError(path, f"line {line.number}", found, expected)
    texts = ("\t".join(line.text.split()) if blanks else line.text.strip(" ") for line in rows)
    try:
        table = csv.read_csv(
            io.BytesIO("\n".join(texts).encode()),
            read_options=csv.ReadOptions(column_names=[str(k) for k in range(width)]),
            parse_options=csv.ParseOptions(delimiter="\t" if blanks else delimiter),
            convert_options=csv.ConvertOptions(decimal_point=decimal),
        )
    except pyarrow.ArrowInvalid as error:
        reason = " ".join(str(error).split())
        raise InputError(path, "content", f"unreadable ({reason})", "a table") from None
    return [
        np.asarray(each.to_numpy().astype(np.float64)) if is_number_type(each.type) else each
        for each in table.columns
    ]
