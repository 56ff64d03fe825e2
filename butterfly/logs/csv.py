"""Logs in CSV files, whatever their columns are called."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow
from pyarrow import csv

from butterfly.errors import InputError, nearest
from butterfly.files import replacing
from butterfly.logs.log import SAMPLED, Log

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path

    from numpy.typing import NDArray

DEFAULT_COLUMNS = {"time": "time", "input": "input", "angle": "angle"}
"""Column map used when none is given: the columns carry the names of the fields of `Log`."""


def read_csv(path: Path, columns: Mapping[str, str] | None = None, **properties: Any) -> Log:  # noqa: ANN401
    """Read a CSV file with one header line.

    Parameters
    ----------
    path
        The file.
    columns
        Which column of the file holds ``time`` (s), ``input``, ``angle`` (rad) and, if wanted,
        ``velocity`` (rad/s); if not given, `DEFAULT_COLUMNS`, and ``velocity`` if there is one.
    properties
        Fields of `Log` that the file does not hold (``input_kind``, ``added_mass``, ...).

    Raises
    ------
    InputError
        If the file is missing or no CSV, or a mapped column is absent or not numeric.
    """
    mapping = dict(columns or DEFAULT_COLUMNS)
    for field in mapping:
        if field not in SAMPLED:
            raise InputError(path, f"columns.{field}", "an unknown field", nearest(field, SAMPLED))
    for field in DEFAULT_COLUMNS.keys() - mapping.keys():
        raise InputError(path, f"columns.{field}", "nothing", "the name of a column")
    table = _table(path)
    if not columns and "velocity" in table.column_names:
        mapping["velocity"] = "velocity"
    arrays: dict[str, Any] = {field: _numeric(path, table, name) for field, name in mapping.items()}
    return Log(**arrays, source=str(path), **properties)


def write_csv(log: Log, path: Path) -> None:
    """Write a log with the header that `DEFAULT_COLUMNS` expects, every number in full.

    A missing velocity column is left out.
    """
    columns = log.columns()
    texts = (map(repr, column.astype(np.float64).tolist()) for column in columns.values())
    rows = zip(*texts, strict=True)
    with replacing(path) as draft:
        draft.write_text("\n".join([",".join(columns), *map(",".join, rows), ""]))


def read_columns(path: Path, names: Iterable[str]) -> list[NDArray[np.float64]]:
    """Read numeric columns of a CSV file by their names.

    Raises
    ------
    InputError
        If the file is missing or no CSV, or a column is absent or not numeric.
    """
    table = _table(path)
    return [_numeric(path, table, name) for name in names]


def _table(path: Path) -> pyarrow.Table:
    try:
        return csv.read_csv(path)
    except FileNotFoundError:
        raise InputError(path, "path", "no such file", "an existing CSV file") from None
    except (pyarrow.ArrowInvalid, OSError) as error:
        reason = " ".join(str(error).split())
        raise InputError(path, "content", f"unreadable ({reason})", "CSV with a header") from None


def _numeric(path: Path, table: pyarrow.Table, name: str) -> np.ndarray[Any, Any]:
    if name not in table.column_names:
        raise InputError(path, name, "no such column", nearest(name, table.column_names))
    column = table.column(name)
    if not (pyarrow.types.is_integer(column.type) or pyarrow.types.is_floating(column.type)):
        raise InputError(path, name, f"a column of type {column.type}", "numbers")
    values = column.to_numpy().astype(np.float64)
    return np.asarray(values)
