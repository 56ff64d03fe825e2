"""Logs in JSON: records (a list, or one per line) or columns, nested in any way."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from butterfly.errors import InputError, require_room
from butterfly.files import read_file, whole
from butterfly.logs.clock import dates
from butterfly.logs.formats import NAMING, ColumnMap, chosen_columns, components, part_at
from butterfly.logs.log import MIN_SAMPLES, SAMPLED, FileReading, Log
from butterfly.logs.unit_hints import UnitHints
from butterfly.logs.units import Units

_LARGE = range(16, 20)  # digits of integers that floats may not hold, but 64 bits do
_FIRST = 100  # records that show which columns there are
_RECORDS = re.compile(r"\{[^\n]*\}\s*\n\s*\{")  # one a line


def read_json(path: Path, columns: ColumnMap | None, units: Units, about: dict[str, Any]) -> Log:
    """Read a log (see `read_log`), or that ``at`` a place; of WPILib's SysId as it is."""
    (content, cut), at = _content(path), about.pop("at", None)
    above = content if isinstance(content, dict) else {}
    if at is not None:
        content = _below(path, content, at)
    elif columns is None and (places_in := _logs(content)):
        expected = f"one of {', '.join(places_in)} (`butterfly manifest {path.name}` lists all)"
        raise InputError(path, "at", "nothing", expected)
    ways = _ways(content)
    names = [*map(".".join, ways)]
    of_sysid = at is not None and above.get("sysid") is True
    if of_sysid and len(names) != len(SAMPLED):
        raise InputError(path, at, f"rows of {len(names)} numbers", "t, volts, turns, turns/s")
    if of_sysid and columns is None:
        columns = {field: k for k, field in enumerate(SAMPLED)}
    lists = _lists(content, ways)
    named = {k: part for k, part in components(lists).items() if k not in names}
    names += named
    places, unasked = chosen_columns(path, names, columns, about)
    values = {field: _at(content, ways[k]) for field, k in places.items() if k < len(ways)}
    values = _joined(values)
    arrays = {
        field: _column(path, names[k], values[field], field)
        if field in values
        else named[names[k]].of(lists)
        for field, k in places.items()
    }
    sayings = UnitHints(path, names)
    if of_sysid:  # its numbers are rotations, of so many units each
        unit, factor = above.get("units", "Rotations"), above.get("unitsPerRotation", 1.0)
        for k, per in ((2, ""), (3, "/s")):
            sayings.metadata({"units": f"{unit}{per}", "scale_factor": factor}, way=(k,))
    else:
        sayings.metadata({k: node for k, node in above.items() if at and _ways(node) != ways})
        sayings.metadata(content)
    headings = sayings.headings(places)
    headings |= {f: replace(headings[f], number=None) for f in places.keys() - values.keys()}
    about |= {"source": str(path), "reading": FileReading(cut_lines=cut)}
    return Log.of_columns(arrays, headings, units, unasked=unasked, **about)


def _content(path: Path) -> tuple[Any, int]:
    """Return the content of a file, and how many incomplete last lines were dropped."""
    content = read_file(path, "an existing JSON file")
    require_room(path, "content", f"{len(content)} bytes of JSON", 32 * len(content))
    with whole(path, "complete JSON"):
        text = content.decode("utf-8-sig").strip(" ")
        if path.suffix.lower() == ".json" and not _RECORDS.match(text):
            return _parsed(text), 0
        lines = [line for line in text.split("\n") if line.strip()]
        cut = not text.endswith("\n") and len(lines) > 1
        return [_parsed(line) for line in lines[: len(lines) - cut]], int(cut)


def _parsed(text: str) -> Any:  # noqa: ANN401 - any JSON
    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        members = dict(pairs)
        if len(members) < len(pairs):
            raise ValueError("an object with the same key twice")
        return members

    def whole_number(text: str) -> float:
        return int(text) if len(text) in _LARGE else float(text)

    return json.loads(text, parse_int=whole_number, object_pairs_hook=unique)


def logs_in(path: Path) -> list[str]:
    """Return the places of several logs in a file; none if it is one log."""
    with suppress(InputError):
        return _logs(_content(path)[0])
    return []


def numbers_in(path: Path) -> dict[str, float]:
    """Return the numbers beside the log or logs of a file, by their keys."""
    with suppress(InputError):
        content = _content(path)[0]
        pairs = content.items() if isinstance(content, dict) else ()
        return {key: float(value) for key, value in pairs if type(value) in {float, int}}
    return {}


def _logs(content: Any) -> list[str]:  # noqa: ANN401 - any JSON
    """Return the places of tables if there are several, of the same columns, and nothing else."""
    layouts: dict[str, tuple[tuple[str, ...], ...]] = {}
    for key, node in content.items() if isinstance(content, dict) else ():
        first = node[0] if isinstance(node, list) and node else None
        inner = first.values() if isinstance(first, dict) else ()
        long = any(isinstance(below, list) and len(below) >= MIN_SAMPLES for below in inner)
        tables = {f"{key}.{k}": table for k, table in enumerate(node)} if long else {key: node}
        ways = {place: _ways({place: table}) for place, table in tables.items()}
        layouts |= {
            place: tuple(way[1:] for way in paths) for place, paths in ways.items() if paths
        }
    alike = len(layouts) > 1 == len({*layouts.values()}) and ((),) not in layouts.values()
    return [*layouts] if alike else []


def _below(path: Path, node: Any, at: str) -> Any:  # noqa: ANN401 - any JSON
    for part in at.split("."):
        rows = dict(enumerate(node)) if isinstance(node, list) else {}
        below = node if isinstance(node, dict) else {str(k): row for k, row in rows.items()}
        node = part_at(path, below, part, at)
    return node


def _ways(node: Any, *, row: bool = False, way: tuple[str, ...] = ()) -> list[tuple[str, ...]]:  # noqa: ANN401 - any JSON
    """Return the path to every column: keys of objects, and numbers in the lists of a ``row``."""
    if len(way) > 16:  # noqa: PLR2004 - objects within objects
        return []
    if isinstance(node, list) and not row:
        inner = bool(node) and isinstance(node[0], dict | list)
        rows = (
            [record for record in node[:_FIRST] if type(record) is type(node[0])] if inner else []
        )
        paths = dict.fromkeys(path for record in rows for path in _ways(record, row=True, way=way))
        return [*paths] if inner else [way] * bool(way)
    node = {str(k): below for k, below in enumerate(node)} if isinstance(node, list) else node
    if not isinstance(node, dict):
        return [way] * row
    if not row and way and all(key.isdecimal() for key in node):  # pandas' index
        return [way]
    return [path for key, below in node.items() for path in _ways(below, row=row, way=(*way, key))]


def _lists(content: Any, ways: Sequence[tuple[str, ...]]) -> dict[str, Any]:  # noqa: ANN401 - any JSON
    """Return the columns whose rows are lists, and lists of texts."""
    lists = dict.fromkeys(way[:-1] for way in ways if len(way) > 1 and way[-1].isdecimal())
    naming = [way for way in ways if way and way[-1] in NAMING and lists]
    return {".".join(way): _at(content, way) for way in [*lists, *naming]}


def _at(node: Any, way: Sequence[str], *, row: bool = False) -> Any:  # noqa: ANN401 - any JSON
    """Return the value at the end of a path, in every row of a list; ``...`` if missing."""
    if isinstance(node, list) and not row and node and isinstance(node[0], dict | list):
        return [_at(record, way, row=True) for record in node]
    if not way:
        return node
    try:
        below = node[int(way[0])] if isinstance(node, list) else node[way[0]]
    except (KeyError, IndexError, TypeError, ValueError):
        return ...
    return _at(below, way[1:], row=row)


def _joined(columns: dict[str, Any]) -> dict[str, Any]:
    """Return columns of records of which none has all, as of a record per topic, as with nulls."""
    lists = {field: column for field, column in columns.items() if isinstance(column, list)}
    if any(... not in row for row in zip(*lists.values(), strict=False)):
        return columns
    return columns | {f: [None if x is ... else x for x in column] for f, column in lists.items()}


def _column(path: Path, name: str, column: Any, field: str) -> NDArray[Any]:  # noqa: ANN401 - any JSON
    values = (
        [column[key] for key in sorted(column, key=int)] if isinstance(column, dict) else column
    )
    dated = field == "time" and {*map(type, values)} <= {str, type(None)}
    if dated and (stamps := dates(values)) is not None:
        return stamps
    numbers = {float, int, type(None)} | ({bool} if field == "enabled" else set())
    for k, value in enumerate(values):
        if type(value) not in numbers:
            what = "nothing" if value is ... else repr(value)
            raise InputError(path, name, f"{what} in record {k}", "a number, or null")
    return np.array(values, dtype=None if {*map(type, values)} == {int} else np.float64)
