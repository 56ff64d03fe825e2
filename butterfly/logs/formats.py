"""The formats of logs: files by their endings, tables; which column is what, and its parts."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from itertools import islice, repeat
from numbers import Real
from pathlib import Path
from types import ModuleType
from typing import Any, Protocol, TypeAlias, TypeGuard

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import Samples
from butterfly.errors import InputError, nearest
from butterfly.files import refuse_binary
from butterfly.logs.clock import NANOSECONDS
from butterfly.logs.log import MIN_SAMPLES, OF_SERVO, SAMPLED, InputKind, Intersample, Log
from butterfly.logs.unit_hints import UnitHints
from butterfly.logs.units import AS_IS, Units, without_ending, without_unit

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


def joined(log: Log) -> tuple[Log, str]:
    """Return a log in the rows of its measured column, and what was done where these lack another.

    The last value of a column is held (of an input with a first-order hold: interpolated) if most
    of these rows lack it; rows before the first input are left out. InputError if the rows are in
    no order of time.
    """
    clock, columns = np.isfinite(log.time), log.columns()
    measured = clock & np.isfinite(log.measured)
    there = {name: clock & np.isfinite(column) for name, column in columns.items()}
    lacking = {name: int((measured & ~mask).sum()) for name, mask in there.items() if mask.any()}
    lacking.pop("time", None)
    if log.input_kind is InputKind.NONE:
        lacking.pop("input", None)
    sparse = {name: count for name, count in lacking.items() if 2 * count > measured.sum()}
    if not sparse:
        return log, ""
    for name, count in sparse.items():
        if any(np.any(np.diff(log.time[mask]) < 0) for mask in (measured, there[name])):
            problem = f"nothing in {count} of {measured.sum()} rows with the {log.measures}"
            expected = "rows in ascending order of time, so that its last value can be held"
            raise InputError(log.source, name, problem, expected)
    rows = measured
    if "input" in sparse:
        time, inputs = log.command
        rows = measured & (log.time >= time[np.isfinite(time) & np.isfinite(inputs)].min())
    if rows.sum() < MIN_SAMPLES:
        problem = f"{rows.sum()} rows with the {log.measures} after the first input"
        raise InputError(log.source, "input", problem, f"at least {MIN_SAMPLES}")
    straight = log.between_samples is Intersample.FIRST_ORDER_HOLD
    joint: dict[str, Any] = {name: column[rows] for name, column in columns.items()}
    for name in sparse:
        every = log.command if name == "input" else (log.time, columns[name])
        line = straight and name == "input"
        joint[name] = _filled(joint["time"], joint[name], *every, straight=line)
    how = "interpolated" if straight and "input" in sparse else "held"
    listing = ", ".join(f"{name} in {count} samples" for name, count in sparse.items())
    return replace(log, **joint), f"a row per topic: {how} between its rows: {listing}"


def _filled(
    time: Samples, values: Samples, clock: Samples, every: Samples, *, straight: bool
) -> Samples:
    """Return (n,) values; where missing, the last one of every row, or the interpolated one."""
    there = np.isfinite(clock) & np.isfinite(every)
    known, numbers = clock[there], every[there]
    last = np.maximum(np.searchsorted(known, time, "right") - 1, 0)
    filling = np.interp(time, known, numbers) if straight else numbers[last]
    return np.where(np.isfinite(values), values, filling)


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

MAPPED = (*SAMPLED, NANOSECONDS, *OF_SERVO)
"""What may be a column: the fields of a log, and the second part of its time."""

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
        if field not in MAPPED:
            raise InputError(source, f"columns.{field}", "an unknown field", nearest(field, MAPPED))
    if NANOSECONDS in columns and "time" not in columns:
        raise InputError(source, "columns.time", "nothing", "the column of whole seconds")
    if lacking := unsaid(columns, about):
        hints = (hint for field in lacking for hint in _HINTS.get(field, ()))
        expected = "; or ".join(["the name of a column" + " for each" * (len(lacking) > 1), *hints])
        fields = ", ".join(f"columns.{field}" for field in lacking)
        raise InputError(source, fields, "nothing", expected)
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
