"""Components of columns: ``action.2`` of a list or matrix, ``position.elbow`` of named joints.

Every format hands over columns whose rows are lists, and reads the components by these names. A
column ``name`` beside them, as in ROS's JointState, names the parts: by a list in every row, or by
one list for all rows.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice, repeat
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import NDArray

NAMING = {"name", "names", "joint_names"}
"""Names of columns that name the parts of those beside them."""

_ENOUGH = 100  # rows that show what a column holds


@dataclass(frozen=True, kw_only=True)
class Component:
    """One number of each row of a column of lists."""

    column: str
    part: int | str  # its place in every list, or the name that another column gives it
    naming: str = ""  # that column

    @property
    def needs(self) -> list[str]:
        """The columns that it is made of."""
        return [self.column, *([self.naming] if self.naming else [])]

    def of(self, columns: Mapping[str, Any]) -> NDArray[Any]:
        """Return its (n,) numbers; NaN in rows that lack it."""
        rows = columns[self.column]
        if isinstance(self.part, int) and isinstance(rows, np.ndarray) and rows.ndim > 1:
            return np.asarray(rows[:, self.part])
        names = map(_texts, columns[self.naming]) if self.naming else ()
        places = (texts.index(self.part) if self.part in texts else -1 for texts in names)
        pairs = zip(rows, places if self.naming else repeat(self.part), strict=False)
        return np.array([_at(row, int(k)) for row, k in pairs], dtype=np.float64)


def components(columns: Mapping[str, Any]) -> dict[str, Component]:
    """Return the components of the columns whose first rows are lists of numbers, by name."""
    heads = {name: [*islice(_rows(column), _ENOUGH)] for name, column in columns.items()}
    joints: dict[str, dict[str, Component]] = {}
    for name, rows in heads.items():
        parent, _, last = name.rpartition(".")
        if last in NAMING:
            joints[parent] = _named(name, columns[name], rows)
    parts: dict[str, Component] = {}
    for name, rows in heads.items():
        width = max(map(_width, rows), default=0)
        parent, _, last = name.rpartition(".")
        for joint, part in joints.get(parent, {}).items() if width else ():
            component, first = replace(part, column=name), f"{parent}.{joint}".lstrip(".")
            if isinstance(component.part, str) or component.part < width:
                parts |= {f"{name}.{joint}": component, f"{first}.{last}": component}
        parts |= {f"{name}.{k}".lstrip("."): Component(column=name, part=k) for k in range(width)}
    return {name: part for name, part in parts.items() if name not in columns}


def _named(name: str, column: Any, head: Sequence[Any]) -> dict[str, Component]:  # noqa: ANN401 - whatever holds texts
    """Return the parts that a column names, by these names, still without a column of numbers."""
    if all_rows := _texts(column):
        return {joint: Component(column="", part=k) for k, joint in enumerate(all_rows)}
    joints = dict.fromkeys(joint for row in head for joint in _texts(row))
    return {joint: Component(column="", part=joint, naming=name) for joint in joints}


def _rows(column: Any) -> Iterable[Any]:  # noqa: ANN401 - whatever holds rows
    """Return the rows of a column that may be lists; none of one of plain numbers."""
    plain = isinstance(column, np.ndarray) and column.ndim == 1 and column.dtype.kind != "O"
    return column if _is_list(column) and not plain else ()


def _is_list(value: object) -> bool:
    return np.iterable(value) and not isinstance(value, str | bytes | Mapping)


def _width(row: Any) -> int:  # noqa: ANN401 - whatever a row holds
    """Return how many numbers a row lists; 0 if it is no list of numbers."""
    if not _is_list(row):
        return 0
    numbers = [number for number in row if number is None or isinstance(number, Real)]
    return len(numbers) if len(numbers) == len(row) else 0


def _texts(row: Any) -> tuple[str, ...]:  # noqa: ANN401 - whatever a row holds
    """Return the texts that a row lists; none if it is no list of texts."""
    if not _is_list(row):
        return ()
    texts = tuple(str(text) for text in row if isinstance(text, str))
    return texts if len(texts) == len(row) else ()


def _at(row: Any, number: int) -> float:  # noqa: ANN401 - whatever a row holds
    """Return a number of a row's list; NaN if it has none there."""
    there = _width(row) > number >= 0 and row[number] is not None
    return float(row[number]) if there else math.nan
