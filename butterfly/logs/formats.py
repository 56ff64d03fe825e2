"""The formats of logs: files, by the endings of their names, and tables; which column is what."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any, Protocol, TypeAlias, TypeGuard

import numpy as np
from numpy.typing import NDArray

from butterfly.errors import InputError, nearest
from butterfly.files import refuse_binary
from butterfly.logs.components import components
from butterfly.logs.log import OF_SERVO, SAMPLED, InputKind, Log
from butterfly.logs.unit_hints import UnitHints
from butterfly.logs.units import AS_IS, Units, without_ending, without_unit

FORMATS = {".mat": "mat", ".csv": "csv", ".parquet": "parquet"}
FORMATS |= dict.fromkeys((".tsv", ".txt", ".dat"), "csv")
FORMATS |= dict.fromkeys((".json", ".jsonl", ".ndjson"), "json") | {".mcap": "mcap"}
FORMATS |= {".npz": "npz", ".npy": "npz", ".xlsx": "excel", ".xlsm": "excel"}
"""The module that reads files of an ending; imported when it is used, as each is slow."""

OFTEN_OTHERS = {".txt", ".dat", ".json", ".npz", ".npy", ".xlsx", ".xlsm"}
"""Endings of files that often are no log."""

ENDINGS = " or ".join([", ".join(list(FORMATS)[:-1]), list(FORMATS)[-1]])
"""The endings, in words."""


def read_log(
    path: Path,
    columns: ColumnMap | None = None,
    units: Units = AS_IS,
    **properties: Any,  # noqa: ANN401 - the fields of Log that a file cannot know, interval and at
) -> Log:
    """Read one file by its ending; InputError if it is unreadable or not one of `FORMATS`."""
    read: Callable[..., Log] = getattr(_module(path), f"read_{FORMATS[path.suffix.lower()]}")
    before = _state(path)
    if "at" in properties and FORMATS[path.suffix.lower()] not in {"json", "mat", "npz", "excel"}:
        raise InputError(path, "at", properties["at"], "JSON, .mat, .npz or .xlsx of several logs")
    log = read(path, columns, units, {"name": path.name} | properties)
    if _state(path) != before:
        raise InputError(path, "content", "a file that changed while being read", "a complete one")
    return log


def _state(path: Path) -> tuple[int, ...]:
    """Return what changes when a file is replaced or appended to; nothing if there is no file."""
    try:
        status = path.stat()
    except (OSError, ValueError):
        return ()
    return status.st_ino, status.st_size, status.st_mtime_ns


def holds_table(path: Path, width: int = 3) -> bool:
    """Whether a file, which may be of another kind, holds a log's numbers (2: at an interval)."""
    module = _module(path)
    if hasattr(module, "holds_table"):
        return bool(module.holds_table(path, width))
    try:
        names = dict(zip([*DEFAULT_COLUMNS][-width:], range(width), strict=True))
        units = Units(factors=dict.fromkeys(names, 1.0))
        return bool(read_log(path, names, units, interval=None if "time" in names else 1.0))
    except InputError as error:
        return "the extra" in error.expected


def _module(path: Path) -> ModuleType:
    ending = path.suffix.lower()
    if ending not in FORMATS:
        refuse_binary(path)
        raise InputError(path, "file name", path.suffix or "no ending", ENDINGS)
    return import_module(f"butterfly.logs.{FORMATS[ending]}")


ColumnMap = Mapping[str, str | int]
"""Column of each field of `Log`, by name or by number from 0."""

DEFAULT_COLUMNS = {"time": "time", "input": "input", "angle": "angle"}
"""Column map used when none is given: columns named like the fields of `Log`."""

VELOCITY = "velocity"
"""Column read by default if present, besides the angle or instead of it."""

_NOBODYS = "\0"  # name of no column
_HINT = "choose columns by --columns time=T,input=U,angle=Q or the manifest's key columns"
_HINTS = {
    "time": ["--interval S, or interval: S in the manifest, if the file has no clock"],
    "input": ["--input none, or input: none in the manifest, if nothing drives the joint"],
    "angle": ["velocity=W instead of angle=Q if no gravity acts"],
}


class NoColumnError(InputError):
    """A column is not among those of a log."""

    names: Sequence[str] = ()  # of the columns that it has

    @classmethod
    def among(cls, names: Sequence[str], *about: Any) -> NoColumnError:  # noqa: ANN401 - its fields
        """Return the error about other columns; the frame that raises it must not hold it."""
        made = cls(*about)
        made.names = names
        return made


def column_names(path: Path, **properties: Any) -> list[str]:  # noqa: ANN401 - as of `read_log`
    """Return the names of the columns of a file; none if it has no names, or is unreadable."""
    try:
        read_log(path, dict.fromkeys(DEFAULT_COLUMNS, _NOBODYS), **properties)
    except NoColumnError as error:
        return [*error.names]
    except InputError:
        pass
    return []


def unsaid(columns: ColumnMap, about: Mapping[str, Any]) -> list[str]:
    """Return the fields that a log needs, by what is known ``about`` it, and that a map lacks."""
    optional = {"angle": VELOCITY in columns, "time": about.get("interval") is not None}
    optional["input"] = about.get("input_kind") == InputKind.NONE
    return [f for f in DEFAULT_COLUMNS if f not in columns and not optional.get(f)]


def checked_map(
    source: object, columns: ColumnMap, about: Mapping[str, Any]
) -> dict[str, str | int]:
    """Return a column map that has what a log needs, by what is known ``about`` it."""
    if not isinstance(columns, Mapping):
        raise InputError(source, "columns", columns, "a mapping such as {'time': 't', ...}")
    for field in columns:
        if field not in {*SAMPLED, *OF_SERVO}:
            expected = nearest(field, (*SAMPLED, *OF_SERVO))
            raise InputError(source, f"columns.{field}", "an unknown field", expected)
    for field in unsaid(columns, about):
        expected = "; or ".join(["the name of a column", *_HINTS.get(field, ())])
        raise InputError(source, f"columns.{field}", "nothing", expected)
    return dict(columns)


def part_at(source: object, parts: Mapping[str, Any], name: str, at: str) -> Any:  # noqa: ANN401 - of a file
    """Return one of the parts of a file by its name, on the way to a place."""
    if name not in parts:
        raise InputError(source, "at", at, nearest(name, parts) if parts else "a place in the file")
    return parts[name]


def place(source: object, names: Sequence[str], wanted: str | int) -> int:
    """Return the number of the one column of a name, with or without its unit, or of a number."""
    for bare in (str, without_unit, without_ending):
        known = [bare(name) for name in names]
        places = [k for k, name in enumerate(known) if name == wanted]
        if len(places) > 1:
            numbers = " or ".join(map(str, places))
            expected = f"one column, or its number: {numbers}"
            raise InputError(source, str(wanted), f"{len(places)} columns with this name", expected)
        if places:
            return places[0]
    number = int(wanted) if str(wanted).isdecimal() else None
    if number is not None and number < len(names):
        return number
    if number is not None:
        expected = f"a number from 0 to {len(names) - 1}, or a name"
        raise InputError(source, "columns", f"number {number}", expected)
    hint = "; ".join([_HINT, *_HINTS.get(str(wanted), ())])
    expected = f"{nearest(str(wanted), names)} ({hint})"
    raise NoColumnError.among(names, source, str(wanted), "no such column", expected)


def chosen_columns(
    source: object, names: Sequence[str], columns: ColumnMap | None, about: Mapping[str, Any]
) -> tuple[dict[str, int], list[str]]:
    """Return the number of each column to read, by field, and the fields read by default."""
    kind = about.get("input_kind")
    wanted = checked_map(source, DEFAULT_COLUMNS if columns is None else columns, about)
    there, unasked = {*names, *map(without_unit, names)}, []
    if columns is None and VELOCITY in there:
        wanted |= {VELOCITY: VELOCITY}
        unasked = [VELOCITY] if "angle" in there else []
        if not {*map(without_unit, names)} - {"time", "input", VELOCITY}:  # nothing else is one
            del wanted["angle"]
    if columns is None and about.get("servo") is not None:
        wanted |= {field: field for field in OF_SERVO if field in there}
    if columns is None and kind == InputKind.NONE and "input" not in there:
        del wanted["input"]
    if columns is None and about.get("interval") is not None and "time" not in there:
        del wanted["time"]
    return {field: place(source, names, name) for field, name in wanted.items()}, unasked


class Frame(Protocol):
    """What a data frame of pandas and similar libraries provides."""

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


def log_of_table(
    table: Table,
    columns: ColumnMap | None = None,
    units: Units = AS_IS,
    *,
    metadata: Mapping[str, Any] | None = None,
    **properties: Any,  # noqa: ANN401 - the fields of Log that a table cannot know
) -> Log:
    """Make a log of a table and its ``metadata``; numbered columns are `SAMPLED`."""
    series = _columns(table)
    names, parts = list(series), components(series)
    if columns is None and names == [*map(str, range(len(names)))]:
        timed = len(names) > 2 or properties.get("interval") is None  # noqa: PLR2004 - u, q
        columns = dict(zip(SAMPLED[not timed :], range(len(names)), strict=False))
    properties = {"source": "table"} | properties
    names += parts
    places, unasked = chosen_columns(properties["source"], names, columns, properties)
    single = {field: parts[names[k]] for field, k in places.items() if k >= len(series)}
    arrays = {
        f: single[f].of(series) if f in single else series[names[k]] for f, k in places.items()
    }
    sayings = _sayings_of(properties["source"], table, series, names)
    sayings.metadata(metadata or {})
    headings = sayings.headings(places)
    headings |= {field: replace(headings[field], number=None) for field in single}
    return Log.of_columns(arrays, headings, units, unasked=unasked, **properties)


def _sayings_of(
    source: object, table: Table, columns: Mapping[str, Any], names: Sequence[str]
) -> UnitHints:
    """Return what a table says in its attributes, those of its columns, and their types."""
    sayings = UnitHints(source, names)
    for owner, way in ((table, ()), *((column, (name,)) for name, column in columns.items())):
        for key in ("attrs", "meta", "info"):
            attributes = getattr(owner, key, None)
            if isinstance(attributes, Mapping) and not (
                way and attributes == getattr(table, key, None)
            ):
                sayings.metadata(attributes, key, way)
    for k, column in enumerate(columns.values()):
        kind = re.match(r"pint\[(.+)\]", str(getattr(column, "dtype", "")))
        unit = kind[1] if kind else getattr(column, "unit", getattr(column, "units", ""))
        if kind or not isinstance(unit, float | int | bool | np.ndarray):
            sayings.column(k, unit, "unit of the column")
    return sayings


def _columns(table: Table) -> dict[str, Any]:
    """Return the columns by name; those of a plain array by number."""
    if not isinstance(table, np.ndarray):
        names = table if isinstance(table, Mapping) else table.columns
        return {str(name): table[name] for name in names}
    if table.dtype.names is not None:
        return {name: table[name] for name in table.dtype.names}
    if table.ndim != 2:  # noqa: PLR2004 - a matrix
        raise InputError("read", "source", f"an array of shape {table.shape}", "shape (n, k)")
    return {str(k): column for k, column in enumerate(table.T)}
