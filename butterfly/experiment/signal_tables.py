"""Signals from files: each read once, however many runs of a sweep are driven with it.

In an experiment's content the digest of a table stands for it; what is long travels apart, once.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from butterfly.errors import InputError
from butterfly.logs.csv import read_columns
from butterfly.plant.excitations import Table

_STORED = "sha256:"


def read_table(path: Path, time: str, values: str) -> tuple[str, Table]:
    """Read a signal from two columns of a CSV file.

    Returns
    -------
    Its digest, and the table.

    Raises
    ------
    InputError
        If the file cannot be read, or its instants do not increase.
    """
    columns = read_columns(path, [time, values])
    try:
        table = Table(time=tuple(columns[0].tolist()), values=tuple(columns[1].tolist()))
    except InputError as error:
        raise InputError(path, error.field, error.value, error.expected) from None
    content = np.ascontiguousarray(columns, dtype="<f8").tobytes()
    return _STORED + hashlib.sha256(content).hexdigest(), table


def filled(content: Mapping[str, Any], tables: Mapping[str, Table]) -> dict[str, Any]:
    """Return an experiment's content with tables in the places of their digests."""
    signals = content.get("signals")
    if not isinstance(signals, list):
        return dict(content)
    return {**content, "signals": [_filled(signal, tables) for signal in signals]}


def digest_of(signal: Any) -> str | None:  # noqa: ANN401 - whatever stands in the file
    """Return the digest that stands for a signal's table; None if none does."""
    named = signal.get("table") if isinstance(signal, dict) else None
    return named if isinstance(named, str) and named.startswith(_STORED) else None


def _filled(signal: Any, tables: Mapping[str, Table]) -> Any:  # noqa: ANN401
    digest = digest_of(signal)
    return signal if digest is None or digest not in tables else {"table": tables[digest]}
