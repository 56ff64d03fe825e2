"""Tables in text files, however they are delimited, encoded and commented."""

from __future__ import annotations

import codecs
import io
import re
from collections.abc import Sequence
from csv import reader as csv_reader
from dataclasses import dataclass
from pathlib import Path

import pyarrow
from pyarrow import csv

from butterfly.errors import InputError, require_room, size_text
from butterfly.logs.formats import DEFAULT_COLUMNS
from butterfly.logs.log import MIN_SAMPLES, FileReading
from butterfly.logs.units import UNITS, known_factor

_PER_BYTE = 16  # bytes of memory that one of a text of an unusual form takes
_COMMENTS = ("#", "%", "//")
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


@dataclass(frozen=True, kw_only=True)
class TextFile:
    """A table as its file gives it."""

    names: list[str] | None  # None if the file has no header
    above: str | None  # the line above the numbers; None if they come first
    units: list[str] | None  # the row below the header; None if there is none
    columns: list[pyarrow.ChunkedArray]
    lines: Sequence[int]  # (n,) number of each row's line, from 1 on
    reading: FileReading


@dataclass(frozen=True)
class _Line:
    number: int
    text: str


def read_text_table(path: Path) -> TextFile:
    """Read a table of any delimiter, decimal sign and encoding, with or without a header."""
    size = path.stat().st_size if path.is_file() else 0
    require_room(path, "content", f"{size_text(size)} of an unusual form", _PER_BYTE * size)
    text, encoding = _decoded(path)
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    filled = [_Line(k, line) for k, line in enumerate(lines, 1) if line.strip()]
    comments = [line for line in filled if line.text.lstrip().startswith(_COMMENTS)]
    body = [line for line in filled if not line.text.lstrip().startswith(_COMMENTS)]
    delimiter, first = _dialect(path, body)
    width = len(_cells(body[first].text, delimiter))
    rows = body[first:]
    cut = _is_cut(rows[-2:], delimiter, width, ended=not lines[-1].strip())
    rows = rows[:-1] if cut else rows
    heads = _heads(body[:first], comments, rows[0], delimiter, width)
    names, units = _names_and_units(heads, delimiter, width)
    others = first - (names is not None) - (units is not None) if first else 0
    decimal = "," if _has_decimal_commas(rows, delimiter) else "."
    texts = {
        f"{_DELIMITERS[delimiter]} between columns": delimiter != ",",
        "decimal commas": decimal == ",",
        encoding: encoding != "UTF-8",
        f"comment lines: {len(comments)}": bool(comments),
        f"lines above the table: {others}": others > 0,
        "no header": names is None,
    }
    layout = tuple(text for text, holds in texts.items() if holds)
    return TextFile(
        names=names,
        above=body[first - 1].text.strip() if first else None,
        units=units,
        columns=_parsed(path, rows, delimiter, decimal, width),
        lines=[line.number for line in rows],
        reading=FileReading(layout=layout, cut_lines=int(cut)),
    )


def holds_table(path: Path) -> bool:
    """Whether a file holds as many numbers as a log does at least."""
    try:
        table = read_text_table(path)
    except InputError:
        return False
    return len(table.lines) >= MIN_SAMPLES and len(table.columns) >= len(DEFAULT_COLUMNS)


def is_number(text: str) -> bool:
    """Whether a cell holds a number, with a decimal point or comma."""
    return _NUMBER.fullmatch(text) is not None


def _decoded(path: Path) -> tuple[str, str]:
    """Return a file's text and the name of its encoding."""
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        raise InputError(path, "path", "no such file", "an existing file") from None
    except OSError as error:
        raise InputError(path, "path", error.strerror, "a readable file") from None
    encoding = next((name for mark, name in _MARKS.items() if content.startswith(mark)), None)
    if encoding is None and content[1:200:2].count(0) > content[0:200:2].count(0):
        encoding = "utf-16-le"
    elif encoding is None and content[:200].count(0):
        encoding = "utf-16-be"
    try:
        return content.decode(encoding or "utf-8").removeprefix("\ufeff"), _named(encoding)
    except UnicodeDecodeError:
        if encoding is not None or b"\0" in content:
            raise InputError(path, "content", "bytes that are not text", "a text file") from None
    return content.decode("latin-1"), "Latin-1"


def _named(encoding: str | None) -> str:
    return "UTF-16" if encoding and encoding.startswith("utf-16") else "UTF-8"


def _cells(text: str, delimiter: str) -> list[str]:
    if delimiter == " ":
        cells = _BLANKS.split(text.strip()) if "[" in text or "(" in text else text.split()
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


def _is_cut(rows: list[_Line], delimiter: str, width: int, *, ended: bool) -> bool:
    """Whether the last line lacks values, or breaks off in a number that the row before has."""
    before, last = (_cells(line.text, delimiter) for line in (rows[0], rows[-1]))
    return len(last) < width or (not ended and _is_value(before[-1]) and not _is_value(last[-1]))


def _heads(
    above: list[_Line], comments: list[_Line], first: _Line, delimiter: str, width: int
) -> list[str]:
    """Return the lines, two at most, right above the rows that have as many cells.

    If there are none, the comment lines right above the rows may be: so NumPy writes a header.
    """
    texts = [line.text for line in above]
    if not texts:
        before = (line.text.lstrip() for line in comments if line.number < first.number)
        texts = [text.lstrip("#%/") for text in before]
    return _as_wide(texts, delimiter, width)[-2:]


def _as_wide(texts: list[str], delimiter: str, width: int) -> list[str]:
    """Return the last texts of at least that many cells; a row may end in one that has no name."""
    wide: list[str] = []
    for text in reversed(texts):
        if len(_cells(text, delimiter)) not in {width, width - 1}:
            break
        wide.insert(0, text)
    return wide


def _names_and_units(
    heads: list[str], delimiter: str, width: int
) -> tuple[list[str] | None, list[str] | None]:
    """Read header and row of units off the one or two lines above the rows."""
    if not heads:
        return None, None
    rows = [_cells(text, delimiter) for text in heads]
    rows = [[*row, ""][:width] for row in rows]
    units = [cell.strip("[]() ") for cell in rows[-1]]
    given = [unit for unit in units if unit not in {"", "-"}]
    known = [unit for unit in given if any(known_factor(name, unit) for name in UNITS)]
    if len(rows) > 1 and 2 * len(known) > len(given):
        return rows[-2], units
    return rows[-1], None


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
) -> list[pyarrow.ChunkedArray]:
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
    return list(table.columns)
