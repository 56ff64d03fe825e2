"""Logs in JSON: records (a list, or one per line) or columns, nested in any way."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from butterfly.arrays import Samples
from butterfly.errors import InputError, require_room
from butterfly.files import read_file, whole
from butterfly.logs.formats import ColumnMap, chosen_columns
from butterfly.logs.log import MIN_SAMPLES, FileReading, Log
from butterfly.logs.said import Sayings
from butterfly.logs.units import AS_IS, Units

_RECORDS = re.compile(r"\{[^\n]*\}\s*\n\s*\{")  # one a line


def read_json(
    path: Path,
    columns: ColumnMap | None = None,
    units: Units = AS_IS,
    **properties: Any,  # noqa: ANN401 - the fields of Log that a file cannot know
) -> Log:
    """Read a log (see `read_log`); nested columns have names such as ``joint.position.0``."""
    content, cut = _content(path)
    ways = _ways(content)
    names = [*map(".".join, ways)]
    places, unasked = chosen_columns(path, names, columns, properties)
    arrays = {field: _column(path, content, names[k], ways[k]) for field, k in places.items()}
    sayings = Sayings(path, names)
    sayings.metadata(content)
    headings = sayings.headings(places)
    properties |= {"source": str(path), "reading": FileReading(cut_lines=cut)}
    return Log.of_columns(arrays, headings, units, unasked=unasked, **properties)


def holds_table(path: Path) -> bool:
    """Whether a file holds enough numbers for a log."""
    try:
        content, _ = _content(path)
        sizes = [_column(path, content, "", way).size for way in _ways(content)[:3]]
    except InputError:
        return False
    return len(sizes) == 3 and min(sizes) >= MIN_SAMPLES  # noqa: PLR2004 - t, u, q


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
        found = dict(pairs)
        if len(found) < len(pairs):
            raise ValueError("an object with the same key twice")
        return found

    return json.loads(text, parse_int=float, object_pairs_hook=unique)


def _ways(node: Any, *, row: bool = False, way: tuple[str, ...] = ()) -> list[tuple[str, ...]]:  # noqa: ANN401 - any JSON
    """Return the path to every column: keys of objects, and numbers in the lists of a ``row``."""
    if len(way) > 16:  # noqa: PLR2004 - objects within objects
        return []
    if isinstance(node, list) and not row:
        inner = bool(node) and isinstance(node[0], dict | list)
        return _ways(node[0], row=True, way=way) if inner else [way] * bool(way)
    node = {str(k): each for k, each in enumerate(node)} if isinstance(node, list) else node
    if not isinstance(node, dict):
        return [way] * row
    if not row and way and all(key.isdecimal() for key in node):  # pandas' index
        return [way]
    return [each for key, below in node.items() for each in _ways(below, row=row, way=(*way, key))]


def _at(node: Any, way: Sequence[str], *, row: bool = False) -> Any:  # noqa: ANN401 - any JSON
    """Return the value at the end of a path, in every row of a list; ``...`` if missing."""
    if isinstance(node, list) and not row and node and isinstance(node[0], dict | list):
        return [_at(each, way, row=True) for each in node]
    if not way:
        return node
    try:
        below = node[int(way[0])] if isinstance(node, list) else node[way[0]]
    except (KeyError, IndexError, TypeError, ValueError):
        return ...
    return _at(below, way[1:], row=row)


def _column(path: Path, content: Any, name: str, way: Sequence[str]) -> Samples:  # noqa: ANN401 - any JSON
    found = _at(content, way)
    values = [found[key] for key in sorted(found, key=int)] if isinstance(found, dict) else found
    for k, each in enumerate(values):
        if type(each) not in {float, type(None)}:
            what = "nothing" if each is ... else repr(each)
            raise InputError(path, name, f"{what} in record {k}", "a number, or null")
    return np.array(values, dtype=np.float64)
