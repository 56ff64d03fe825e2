"""Logs as Parquet files: columns time, input, angle and, if known, velocity."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
from pyarrow import parquet

from butterfly.errors import InputError
from butterfly.files import replacing
from butterfly.logs.column_map import DEFAULT_COLUMNS, checked_map, place
from butterfly.logs.log import Log
from butterfly.logs.units import AS_IS, Units

if TYPE_CHECKING:
    from pathlib import Path

    from butterfly.logs.column_map import ColumnMap


def read_parquet(
    path: Path,
    columns: ColumnMap | None = None,
    units: Units = AS_IS,
    **properties: Any,  # noqa: ANN401 - the fields of Log that a file cannot know
) -> Log:
    """Read a log; columns that are not asked for are ignored.

    Parameters
    ----------
    path
        The file.
    columns
        Which column of the file holds ``time``, ``input``, ``angle`` and, if wanted, ``velocity``,
        by name or number; if not given, those of these names.
    units
        Of the columns.
    properties
        Fields of `Log` that the file does not hold (``input_kind``, ``added_mass``, ...).

    Raises
    ------
    InputError
        If the file is missing, is not Parquet, or lacks a column of numbers.
    """
    try:
        table = parquet.read_table(path)
    except FileNotFoundError:
        raise InputError(path, "path", "no such file", "an existing Parquet file") from None
    except (pa.ArrowException, OSError) as error:
        first = str(error).splitlines()[0]
        raise InputError(path, "content", first, "a whole Parquet file") from None
    mapping = checked_map(path, columns or DEFAULT_COLUMNS)
    if not columns and "velocity" in table.column_names:
        mapping["velocity"] = "velocity"
    arrays = {}
    for field, name in mapping.items():
        column = table.column(place(path, table.column_names, name))
        if not (pa.types.is_floating(column.type) or pa.types.is_integer(column.type)):
            raise InputError(path, str(name), f"a column of {column.type}", "numbers")
        arrays[field] = column.to_numpy().astype(np.float64)
    converted: dict[str, Any] = units.applied(arrays)
    return Log(**converted, source=str(path), **properties)


def write_parquet(log: Log, path: Path) -> None:
    """Write a log; a missing velocity column is left out."""
    with replacing(path) as draft:
        draft.write_bytes(parquet_bytes(log))


def parquet_bytes(log: Log) -> bytes:
    """Return the content of the Parquet file of a log."""
    buffer = io.BytesIO()
    parquet.write_table(pa.table(log.columns()), buffer, compression="zstd")
    return buffer.getvalue()
