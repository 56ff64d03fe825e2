"""Logs in Excel's files: the table of a sheet, read as that of a text."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable, Iterator
from contextlib import closing
from dataclasses import replace
from datetime import timedelta
from pathlib import Path
from typing import Any, NamedTuple

from butterfly.errors import InputError, require_room
from butterfly.files import unpacked
from butterfly.logs.csv import log_of_text
from butterfly.logs.formats import ColumnMap, chosen_columns, part_at
from butterfly.logs.log import Log
from butterfly.logs.text_table import table_of_text
from butterfly.logs.units import Units

_QUOTED = re.compile(r'"([^"]*)"')
_MOST = 1000  # lines of another sheet
_EXTRA = "the extra excel (pip install 'butterfly-testbed[excel]'), or its table saved as CSV"


def read_excel(path: Path, columns: ColumnMap | None, units: Units, about: dict[str, Any]) -> Log:
    """Read a log (see `read_log`) from a sheet: ``at``, or the only one with these columns."""
    sheets, at = _sheets(path), about.pop("at", None)
    tables, fitting, fault = {}, [], InputError(path, "content", "no sheet", "a table")
    for name, sheet in {at: part_at(path, sheets, at, at)}.items() if at else sheets.items():
        try:
            tables[name] = table_of_text(path, sheet.text, f"sheet {name}", "\t")
            chosen_columns(path, tables[name].names, columns, about)
            fitting.append(name)
        except InputError as error:
            fault = error
    if not tables:
        raise fault
    (chosen, *others) = fitting or tables
    if others:
        value = f"sheets {', '.join([chosen, *others])}"
        expected = f"one sheet with these columns, or at: {chosen} in a manifest"
        raise InputError(path, "content", value, expected)
    notes = [(None, chosen, "sheet"), *sheets[chosen].notes]
    for name in [title for title in sheets if title not in fitting]:
        lines = [line for line in sheets[name].text.splitlines() if not line.isspace()]
        notes += [(None, line, f"sheet {name}") for line in lines[:_MOST]]
    table = replace(tables[chosen], notes=notes)
    return log_of_text(path, table, columns, units, about)


class _Sheet(NamedTuple):
    """The rows of a sheet as lines of cells divided by tabs, and what is noted on its columns."""

    text: str
    notes: list[tuple[int | None, str, str]]


def _sheets(path: Path) -> dict[str, _Sheet]:
    """Return the sheets by name."""
    with unpacked(path, "a whole .xlsx file") as parts, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of what is no table
        try:
            from openpyxl import load_workbook  # noqa: PLC0415 - an extra
        except ImportError:
            raise InputError(path, "content", "an Excel file", _EXTRA) from None
        commented = any("comment" in name.lower() for name in parts.namelist())
        sheets = {}
        with closing(load_workbook(path, read_only=not commented, data_only=True)) as book:
            for sheet in book.worksheets:
                if not commented:
                    sheet.reset_dimensions()  # as its writer states them
                notes: dict[tuple[int | None, str, str], None] = {}
                rows = []
                for cells in sheet.iter_rows():
                    rows.append([_cell(cell.value) for cell in cells])
                    notes |= dict.fromkeys(_notes(cells))
                width, count = max(map(len, rows), default=0), sum(map(any, rows))
                require_room(path, "content", f"{count} rows of {width} cells", width * count)
                full = (row + [""] * (width - len(row)) if any(row) else [] for row in rows)
                text = "".join("\t".join(row) + "\n" for row in full)
                sheets[sheet.title] = _Sheet(text, [*notes])
    return sheets


def _notes(cells: Iterable[Any]) -> Iterator[tuple[int, str, str]]:
    """Yield number, text and place of comments on cells, and of texts in their number formats."""
    for number, cell in enumerate(cells):
        if (comment := getattr(cell, "comment", None)) is not None:
            yield number, str(comment.text), "comment"
        if isinstance(cell.value, float | int) and '"' in (form := str(cell.number_format)):
            yield number, "".join(_QUOTED.findall(form.partition(";")[0])), "number format"


def _cell(value: Any) -> str:  # noqa: ANN401 - whatever a cell holds
    if isinstance(value, timedelta):
        value = value.total_seconds()
    if isinstance(value, float | int):
        return repr(+value)
    text = value.isoformat() if hasattr(value, "isoformat") else str("" if value is None else value)
    return " ".join(text.replace('"', "").split())
