"""Logs that stand in memory: frames, mappings of arrays, arrays with columns."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Protocol, TypeAlias, TypeGuard

import numpy as np
from numpy.typing import NDArray

from butterfly.errors import InputError
from butterfly.logs.formats import DEFAULT_COLUMNS, checked_map, place
from butterfly.logs.log import SAMPLED, Log
from butterfly.logs.manifest import Manifest


class Frame(Protocol):
    """What pandas and others like it have."""

    @property
    def columns(self) -> Iterable[Any]:
        """Names of the columns."""

    def __getitem__(self, name: Any, /) -> Any:  # noqa: ANN401 - whatever names a column
        """Return a column."""


Table: TypeAlias = Frame | Mapping[str, Any] | NDArray[Any]
"""Columns by name, or by number."""


def is_table(source: object) -> TypeGuard[Table]:
    """Whether an object is a frame, a mapping, or an array."""
    if isinstance(source, Mapping | np.ndarray):
        return True
    return hasattr(source, "columns") and hasattr(source, "__getitem__")


def log_of_table(table: Table, manifest: Manifest) -> Log:
    """Make a log of a table, by a manifest whose only entry it is."""
    columns = _columns(table)
    names = list(columns)
    mapping = checked_map("table", manifest.columns or _default_map(names, table))
    chosen: dict[str, Any] = {
        field: columns[names[place("table", names, name)]] for field, name in mapping.items()
    }
    log = Log(**chosen, source="table", **manifest.properties(manifest.logs[0]))
    return log.converted(manifest.scale)


def _columns(table: Table) -> dict[str, Any]:
    """Return the columns by name; those of a plain array by number."""
    if isinstance(table, np.ndarray):
        if table.dtype.names is not None:
            return {name: table[name] for name in table.dtype.names}
        if table.ndim != 2:  # noqa: PLR2004 - a matrix
            raise InputError("read", "source", f"an array of shape {table.shape}", "columns (n, k)")
        return {str(k): column for k, column in enumerate(table.T)}
    if isinstance(table, Mapping):
        return {str(name): column for name, column in table.items()}
    return {str(name): table[name] for name in table.columns}


def _default_map(names: list[str], table: Table) -> dict[str, Any]:
    """Return the fields' own names, or their order in an array without names."""
    if isinstance(table, np.ndarray) and table.dtype.names is None:
        return dict(zip(SAMPLED, range(len(names)), strict=False))
    velocity = {"velocity": "velocity"} if "velocity" in names else {}
    return {**DEFAULT_COLUMNS, **velocity}
