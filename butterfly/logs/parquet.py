"""Logs as Parquet files: columns time, input, angle and, if known, velocity."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
from pyarrow import parquet

from butterfly.errors import InputError
from butterfly.files import replacing
from butterfly.logs.log import SAMPLED, Log

if TYPE_CHECKING:
    from pathlib import Path


def read_parquet(path: Path, **properties: Any) -> Log:  # noqa: ANN401 - the fields of Log that a file cannot know
    """Read a log; columns other than time, input, angle and velocity are ignored.

    Parameters
    ----------
    path
        The file.
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
    columns = {}
    for name in SAMPLED:
        if name not in table.column_names:
            if name == "velocity":
                continue
            found = ", ".join(table.column_names)
            raise InputError(path, name, f"columns {found}", f"a column {name!r}")
        column = table.column(name)
        if not (pa.types.is_floating(column.type) or pa.types.is_integer(column.type)):
            raise InputError(path, name, f"a column of {column.type}", "numbers")
        columns[name] = column.to_numpy().astype(np.float64)
    return Log(**columns, source=str(path), **properties)


def write_parquet(log: Log, path: Path) -> None:
    """Write a log; a missing velocity column is left out."""
    with replacing(path) as draft:
        draft.write_bytes(parquet_bytes(log))


def parquet_bytes(log: Log) -> bytes:
    """Return the content of the Parquet file of a log."""
    buffer = io.BytesIO()
    parquet.write_table(pa.table(log.columns()), buffer, compression="zstd")
    return buffer.getvalue()
