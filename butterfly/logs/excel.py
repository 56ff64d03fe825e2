"""Logs in Excel's files: the table of a sheet, read as that of a text."""

from __future__ import annotations

import warnings
from contextlib import closing
from datetime import timedelta
from pathlib import Path
from typing import Any

from butterfly.errors import InputError, require_room
from butterfly.files import unpacked
from butterfly.logs.csv import log_of_text
from butterfly.logs.formats import ColumnMap, chosen_columns, part_at
from butterfly.logs.log import Log
from butterfly.logs.text_table import table_of_text
from butterfly.logs.units import Units

_EXTRA = "the extra excel (pip install 'butterfly-testbed[excel]'), or its table saved as CSV"


def read_excel(path: Path, columns: ColumnMap | None, units: Units, about: dict[str, Any]) -> Log:
    """Read a log (see `read_log`) from a sheet: ``at``, or the only one with these columns."""
    texts, at = _texts(path), about.pop("at", None)
    tables, fitting, fault = {}, [], InputError(path, "content", "no sheet", "a table")
    for name, text in {at: part_at(path, texts, at, at)}.items() if at else texts.items():
        try:
            tables[name] = table_of_text(path, text, f"sheet {name}", "\t")
            chosen_columns(path, tables[name].names, columns, about)
            fitting.append(name)
        except InputError as error:
            fault = error
    if not tables:
        raise fault
    (chosen, *others) = fitting or tables
    if others:
        found = f"sheets {', '.join([chosen, *others])}"
        expected = f"one sheet with these columns, or at: {chosen} in a manifest"
        raise InputError(path, "content", found, expected)
    return log_of_text(path, tables[chosen], columns, units, about)


def _texts(path: Path) -> dict[str, str]:
    """Return the rows of each sheet as lines of cells divided by tabs, by the sheet's name."""
    with unpacked(path, "a whole .xlsx file"), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of what is no table
        try:
            from openpyxl import load_workbook  # noqa: PLC0415 - an extra
        except ImportError:
            raise InputError(path, "content", "an Excel file", _EXTRA) from None
        texts = {}
        with closing(load_workbook(path, read_only=True, data_only=True)) as book:
            for sheet in book.worksheets:
                sheet.reset_dimensions()  # as its writer states them
                rows = [[_cell(each) for each in row] for row in sheet.iter_rows(values_only=True)]
                width, count = max(map(len, rows), default=0), sum(map(any, rows))
                require_room(path, "content", f"{count} rows of {width} cells", width * count)
                full = (row + [""] * (width - len(row)) if any(row) else [] for row in rows)
                texts[sheet.title] = "".join("\t".join(row) + "\n" for row in full)
    return texts


def _cell(value: Any) -> str:  # noqa: ANN401 - whatever a cell holds
    if isinstance(value, timedelta):
        value = value.total_seconds()
    if isinstance(value, float | int):
        return repr(+value)
    text = value.isoformat() if hasattr(value, "isoformat") else str("" if value is None else value)
    return " ".join(text.replace('"', "").split())
