"""Rows of a sweep's tables as they are printed: what differs side by side, what does not once."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from butterfly.cli.console import say, show_pairs, show_table
from butterfly.report.format import field_label, field_name, field_unit

if TYPE_CHECKING:
    import pyarrow as pa

_NAMES = ("number", "estimator", "parameter")
"""Columns that name a row."""
_ASKED = (
    *("key", "seed", "repetition", "findings", "condition", "standard_error"),
    *("least_left_out", "largest_left_out", "fit_mean", "held_out_worst", "holdout_worst"),
)
"""Columns that are shown where they are asked for, so that the others can be read."""

_FITS = ("fit_", "held_out_", "holdout_")
"""How columns of FIT begin."""

_NOTHING = {"", "–"}


def show_rows(title: str, table: pa.Table, count: int, *, asked: bool) -> None:
    """Print the first rows of a sweep's table.

    Parameters
    ----------
    title
        Of the table.
    table
        Whose columns have the names of `butterfly.experiment.columns`.
    count
        How many of its rows.
    asked
        Whether its columns were asked for by name: then all of them are shown.
    """
    rows = table.slice(0, count).to_pylist()
    if not rows:
        say(f"{title}: no rows.")
        return
    shown = [name for name in table.column_names if asked or name not in _ASKED]
    cells = {name: [shown_text(row[name]) for row in rows] for name in shown}
    if len(rows) == 1:
        show_pairs((_header(name), text) for name, (text,) in cells.items() if text not in _NOTHING)
        return
    same = [] if asked else [name for name in shown if len({*cells[name]}) == 1]
    named = [name for name in _NAMES if name in cells and name not in same]
    others = [name for name in shown if name not in {*same, *named}]
    told = [
        f"{field_name(name)} {cells[name][0]} {_unit(name)}".rstrip()
        for name in same
        if cells[name][0] not in _NOTHING
    ]
    if told:
        say(f"The same in all rows: {', '.join(told)}.")
    if not asked:
        left = [
            name
            for name in table.column_names
            if name in _ASKED and table[name].null_count < table.num_rows
        ]
        say(f"Not shown: {', '.join(left)}; --columns NAME,… shows what it names.")
    columns = [*named, *others]
    show_table(
        title,
        [_header(name) for name in columns],
        list(zip(*(cells[name] for name in columns), strict=True)),
        lead=max(len(named), 1),
    )


def _header(name: str) -> str:
    if "." in name or not _unit(name):
        return field_label(name)
    return f"{field_name(name)}, {_unit(name)}"


def _unit(name: str) -> str:
    """Return the unit of a column; a deviation is told as a share of the true value."""
    if name == "deviation":
        return "share of true"
    return "%" if name.startswith(_FITS) else field_unit(name)


def shown_text(value: Any) -> str:  # noqa: ANN401 - a cell of any table
    """Write a cell of a table; what is not known is a dash."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
