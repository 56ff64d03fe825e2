"""Rows and columns of a sweep's tables, picked as options name them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pyarrow as pa
import pyarrow.compute as pc

from butterfly.cli.options import parse_pairs
from butterfly.errors import InputError, nearest
from butterfly.report.format import field_name

if TYPE_CHECKING:
    from collections.abc import Sequence


def chosen_rows(table: pa.Table, where: str | None, columns: str | None) -> pa.Table:
    """Return rows and columns of a table, as options name them.

    Parameters
    ----------
    table
        Of a sweep.
    where
        COLUMN=VALUE by commas; all rows if None.
    columns
        Names by commas; all if None.

    Raises
    ------
    InputError
        If a column is not there, or a value is none of its kind.
    """
    for name, text in (parse_pairs(where, "--filter") if where else {}).items():
        column = table[_known(name, table.column_names, "--filter")]
        if pa.types.is_integer(column.type) and text.isdigit():
            table = table.filter(pc.equal(column, int(text)))
        elif pa.types.is_floating(column.type) or pa.types.is_integer(column.type):
            try:
                value = float(text)
            except ValueError:
                raise InputError("--filter", name, text, "a number") from None
            near = pc.abs(pc.subtract(column.cast("double", safe=False), value))
            table = table.filter(pc.less_equal(near, 1e-9 * max(abs(value), 1e-300)))
        else:
            table = table.filter(pc.equal(column.cast("string"), text))
    if columns is None:
        return table
    names = [part.strip() for part in columns.split(",")]
    return table.select([_known(name, table.column_names, "--columns") for name in names])


def _known(name: str, names: Sequence[str], option: str) -> str:
    meant = matching(name, names)
    if len(meant) != 1:
        expected = ", or ".join(meant) or nearest(name, names)
        raise InputError(option, name, "an unknown column", expected)
    return meant[0]


def matching(name: str, names: Sequence[str]) -> list[str]:
    """Return the columns that a user may mean: by name, its last part, or the words of a header."""
    exact = [each for each in names if each == name]
    return exact or [
        each for each in names if each.endswith(f".{name}") or field_name(each) == name
    ]


def without_formulas(table: pa.Table) -> pa.Table:
    """Return a table none of whose texts a spreadsheet takes for a formula."""
    for k, field in enumerate(table.schema):
        if not pa.types.is_string(field.type):
            continue
        texts = table.column(k)
        taken = pc.match_substring_regex(texts, r"^[=+\-@\t\r]")
        quoted = pc.binary_join_element_wise("'", texts, "")
        table = table.set_column(k, field, pc.if_else(taken, quoted, texts))
    return table
