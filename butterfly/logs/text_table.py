"""Text tables of any delimiter, encoding and column names."""

from __future__ import annotations

import codecs
import io
import re
from collections.abc import Callable, Mapping, Sequence
from csv import reader as csv_reader
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import pyarrow
from numpy.typing import NDArray
from pyarrow import csv

from butterfly.errors import InputError, require_room, size_text
from butterfly.files import read_file, refuse_binary, require_file, whole
from butterfly.logs.log import AS_WRITTEN, FileReading
from butterfly.logs.units import is_unit, without_unit, words_in

_PER_BYTE = 16  # bytes of memory per byte of text
_COMMENTS = ("#", "%", "//")
_WIDEST = 10_000  # columns
_SAMPLE = 60  # lines from which the delimiter is found
_DELIMITERS = {";": "semicolons", "\t": "tabs", ",": "commas", " ": "blanks"}
_BLANKS = re.compile(r"\s+(?![\[(])(?![^\[(]*[\])])")  # except before and within brackets
_NUMBER = re.compile(r"[+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?")
GROUPED = re.compile(r"[+-]?[1-9]\d{0,2}([.,'’ \xa0\u202f])\d{3}(?:\1\d{3})*(?:(?!\1)[.,]\d+)?")
_UNGROUPED = re.compile(r"[+-]?\d{1,3}")
_FORM = r"[+-]?(?:\d*|[1-9]\d{{0,2}}(?:\{}\d{{3}})+)(?:\{}\d*)?(?:[eE][+-]?\d+)?"
_CUT = re.compile(r"(?<![\d.])[+-]?\d{1,3},0\d+(?:\.\d+)?(?![\d.])")  # no number begins with 0
_GROUPS = re.compile(r"\d(?:[.,]\d{3}[.,]\d|['’ \xa0\u202f]\d{3})")
_DATE = re.compile(r"\d{4}-\d\d-\d\d[T ].*|\d\d:\d\d:\d\d.*")
_MISSING = {"", "nan", "na", "n/a", "#n/a", "null", "inf", "+inf", "-inf", "-nan"}
_MARKS = {
    codecs.BOM_UTF8: "utf-8",
    codecs.BOM_UTF16_LE: "utf-16-le",
    codecs.BOM_UTF16_BE: "utf-16-be",
}
Column: TypeAlias = NDArray[Any] | pyarrow.ChunkedArray


@dataclass(frozen=True, kw_only=True)
class TextColumns:
    """A table as read."""

    names: Sequence[str]  # "" if the file has no header
    columns: Mapping[int, Column]
    units: Sequence[str] | None = None  # the row below the header; None if there is none
    headless: str | None = None  # the line in place of a header; None with a header
    remarks: Sequence[str] = ()  # comments, and lines above the header
    split: Callable[[str], list[str]] | None = None  # a line into its cells
    lines: Sequence[int] = ()  # (n,) number of each row's line, from 1 on
    reading: FileReading = AS_WRITTEN
    grouped: Mapping[int, str] = field(default_factory=dict)  # numbers that may be 1,000 as large
    notes: Sequence[tuple[int | None, str, str]] = ()  # column or None, text and its place


class _Line(NamedTuple):
    number: int
    text: str


def read_text_table(path: Path) -> TextColumns:
    """Read a table of any delimiter, decimal mark and encoding, with or without a header."""
    size = require_file(path, "an existing file")
    refuse_binary(path, any_kind=False)
    require_room(path, "content", f"{size_text(size)} of text", _PER_BYTE * size)
    return table_of_text(path, *_decoded(path))


def table_of_text(path: Path, text: str, encoding: str, delimiters: str = ";\t, ") -> TextColumns:
    """Return the table in a text, whose cells one of the delimiters divides."""
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    filled = [_Line(k, line) for k, line in enumerate(lines, 1) if line.strip()]
    comments = [line for line in filled if line.text.lstrip().startswith(_COMMENTS)]
    body = [line for line in filled if not line.text.lstrip().startswith(_COMMENTS)]
    for line in body:
        if len(line.text) > _WIDEST:
            require_narrow(path, line.number, line.text)
    delimiter, first = _dialect(path, body, delimiters)
    width = len(_cells(body[first].text, delimiter))
    while first and _is_without_names(_cells(body[first - 1].text, delimiter)):
        first -= 1
    rows = body[first:]
    unended = rows[-1].number == len(lines)
    cut = len(rows) > 1 and (unended or len(_cells(rows[-1].text, delimiter)) < width)
    rows = rows[:-1] if cut else rows
    heads, named = _heads(body[:first], comments, rows, delimiter, width)
    names, units = _names_and_units(heads)
    others = first - (names is not None) - (units is not None) if first else 0
    remarks = [line.text.lstrip().lstrip("#%/") for line in (*comments, *body[:others])]
    before = [line for line in (*comments, *body[:first]) if line.number < rows[0].number]
    headless = repr(max(before).text.strip()) if before else "no line"
    is_cut = _CUT.search if named else _CUT.fullmatch
    if delimiter == "," and (halves := [row for row in rows if is_cut(row.text)]):
        expected = "numbers without commas (decimal commas and thousands need another delimiter)"
        raise InputError(path, f"line {halves[0].number}", halves[0].text, expected)
    group, decimal = _marks(rows, delimiter)
    texts = {
        f"{_DELIMITERS[delimiter]} between columns": delimiter not in {",", delimiters}
        and width > 1,
        "decimal commas": decimal == ",",
        f"thousands separators {group!r}": bool(group),
        encoding: encoding != "UTF-8",
        f"comment lines: {len(comments)}": bool(comments),
        f"lines above the table: {others}": others > 0,
        "no header": names is None,
        "row names in the first column": named,
    }
    layout = tuple(text for text, holds in texts.items() if holds)
    return TextColumns(
        names=names or [""] * width,
        units=units,
        headless=headless if names is None else None,
        columns=dict(enumerate(_parsed(path, rows, delimiter, (group, decimal), width))),
        lines=[line.number for line in rows],
        remarks=remarks,
        split=partial(_cells, delimiter=delimiter),
        grouped={} if group or decimal == "," else _grouped(rows, delimiter),
        reading=FileReading(layout=layout, cut_lines=int(cut)),
    )


def is_number(text: str) -> bool:
    """Whether a cell holds a number, with a decimal point or comma."""
    return _NUMBER.fullmatch(text) is not None or GROUPED.fullmatch(text) is not None


def _marks(rows: list[_Line], delimiter: str) -> tuple[str, str]:
    """Return thousands separator, "" unless only it fits all numbers, and decimal mark."""
    texts = [line.text for line in rows]
    odd = any(map(_GROUPS.search, texts)) or all(any(m in text for text in texts) for m in ".,")
    if odd and (delimiter != "," or any({*"\"'’"} & {*text} for text in texts)):
        cells = {cell for text in texts for cell in _cells(text, delimiter) if is_number(cell)}
        there = [mark for mark in ".,'’ \xa0\u202f" if any(mark in cell for cell in cells)]
        pairs = [(group, decimal) for group in there for decimal in ".,".replace(group, "")]
        fits = [p for p in pairs if all(map(re.compile(_FORM.format(*p)).fullmatch, cells))]
        sure = {*".,"} <= {*there} or not all(map(_NUMBER.fullmatch, cells))
        if sure and len({group for group, _ in fits}) == 1:
            return fits[0]
    marked = (text for text in texts if "," in text or "." in text)
    numbers = (cell for text in marked for cell in _cells(text, delimiter) if is_number(cell))
    return "", next((mark for cell in numbers for mark in cell if mark in ",."), ".")


def _grouped(rows: list[_Line], delimiter: str) -> dict[int, str]:
    """Return the first number like 1.000, by column, where all numbers may group thousands."""
    firsts: dict[int, str] = {}
    if delimiter == ";":
        for few in (rows[:_SAMPLE], rows):
            columns = zip(*(_cells(line.text, delimiter) for line in few), strict=False)
            every = [[cell for cell in column if is_number(cell)] for column in columns]
            points = [[cell for cell in cells if not _UNGROUPED.fullmatch(cell)] for cells in every]
            firsts = {
                k: column[0]
                for k, column in enumerate(points)
                if column and all(map(GROUPED.fullmatch, column))
            }
            if not firsts:
                break
    return firsts


def _decoded(path: Path) -> tuple[str, str]:
    """Return the text of a file and its encoding."""
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


def _dialect(path: Path, body: list[_Line], delimiters: str) -> tuple[str, int]:
    """Return the delimiter that makes most cells numbers, and the first row's line."""
    sample = body[:_SAMPLE]
    best, share = ",", 0.0
    for delimiter in delimiters:
        rows = [_cells(line.text, delimiter) for line in sample]
        filled = [[cell for cell in row if cell] for row in rows if len(row) > 1]
        data = [sum(map(_is_datum, row)) for row in filled]
        numbers = sum(count for count in data if count > 1)
        fraction = numbers / max(sum(map(len, filled)), 1)
        if fraction > share:
            best, share = delimiter, fraction
    for k, line in enumerate(body if share else []):
        cells = _cells(line.text, best)
        if sum(map(_is_datum, cells)) > 1 and 2 * sum(map(_is_value, cells)) >= len(cells):
            return best, k
    single = [is_number(line.text.strip("; \t")) for line in body]
    if 2 * sum(single) > len(body):
        return delimiters[0], single.index(True)
    expected = "a table of numbers, delimited by commas, semicolons, tabs or blanks"
    raise InputError(path, "content", "no row of numbers", expected)


def _is_value(cell: str) -> bool:
    return _is_datum(cell) or cell.lower() in _MISSING


def _is_datum(cell: str) -> bool:
    return is_number(cell) or _DATE.fullmatch(cell) is not None


def _is_without_names(cells: list[str]) -> bool:
    """Whether a line above the first full row is a row with missing numbers, not a header."""
    return any(cells) and len(cells) > 1 and all(_is_value(cell.rstrip(";")) for cell in cells)


def _heads(
    above: list[_Line], comments: list[_Line], rows: list[_Line], delimiter: str, width: int
) -> tuple[list[list[str]], bool]:
    """Return the cells of the header, if only in comments, and whether rows begin with names."""
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
    """Whether a column names rows: distinct whole numbers, as from R, or no numbers."""
    whole = all(cell.isdecimal() for cell in cells) and len(set(cells)) == len(cells)
    return whole or not any(map(is_number, cells))


def _names_and_units(heads: list[list[str]]) -> tuple[list[str] | None, list[str] | None]:
    """Return the names, and the row of units below or above them."""
    if not heads:
        return None, None
    first, last = heads[0], heads[-1]
    distinct = all(first) and len(set(first)) == len(first)
    if len(heads) > 1 and _are_units(last, most=not distinct):
        return first, last
    return last, first if len(heads) > 1 and _are_units(first) else None


def _are_units(cells: list[str], *, most: bool = True) -> bool:
    """Whether a row holds units: in most cells (in one if not ``most``), or all in brackets."""
    given = [cell for cell in cells if cell not in {"", "-"}]
    known = [cell for cell in given if is_unit(cell)]
    bracketed = all(words_in(cell) and not without_unit(cell) for cell in given)
    return 2 * len(known) > len(given) or bracketed or (bool(known) and not most)


def _parsed(
    path: Path, rows: list[_Line], delimiter: str, marks: tuple[str, str], width: int
) -> list[Column]:
    blanks, (group, decimal) = delimiter == " ", marks
    for line in rows:
        count = len(line.text.split()) if blanks else line.text.count(delimiter) + 1
        if count != width and len(_cells(line.text, delimiter)) != width:
            length = f"{len(_cells(line.text, delimiter))} values"
            expected = f"{width}, as in the first row"
            if delimiter == ",":
                expected += " (decimal commas need another delimiter, as thousands do)"
            raise InputError(path, f"line {line.number}", length, expected)
    texts = ("\t".join(line.text.split()) if blanks else line.text.strip(" ") for line in rows)
    if group:
        mark, split = "\t" if blanks else delimiter, [_cells(row.text, delimiter) for row in rows]
        bare = ([x.replace(group, "") if is_number(x) else f'"{x}"' for x in row] for row in split)
        texts = (mark.join(row) for row in bare)
    with whole(path, "a table"):
        table = csv.read_csv(
            io.BytesIO("\n".join(texts).encode()),
            read_options=csv.ReadOptions(column_names=[str(k) for k in range(width)]),
            parse_options=csv.ParseOptions(delimiter="\t" if blanks else delimiter),
            convert_options=csv.ConvertOptions(decimal_point=decimal),
        )
    return [
        np.asarray(column.to_numpy()) if is_number_type(column.type) else column
        for column in table.columns
    ]


def require_narrow(path: Path, number: int, line: str) -> None:
    """Refuse a line of too many cells, since pyarrow allocates each."""
    cells = max(
        len(line.split(None if delimiter == " " else delimiter)) for delimiter in _DELIMITERS
    )
    if cells > _WIDEST:
        raise InputError(path, f"line {number}", f"{cells} cells", f"at most {_WIDEST} columns")


def is_number_type(kind: pyarrow.DataType) -> bool:
    """Whether a pyarrow column holds numbers."""
    return bool(pyarrow.types.is_integer(kind) or pyarrow.types.is_floating(kind))
