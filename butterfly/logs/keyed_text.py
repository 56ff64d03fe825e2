"""Keys and values in what a file says: in lines as of YAML, JSON, TOML or INI, and in rows.

Nothing is judged here: `unit_hints` tells which columns the keys concern.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from typing import Any

UNIT_KEYS = {"unit", "units", "uom"}
"""Keys of units."""

OWN_NAMES = ("name", "column", "field", "field_name", "id")
"""Keys of the name of a column."""

DIVIDED = re.compile(r"[,;|\t]")
"""Marks between the cells of a row."""

_SECTION = re.compile(r"\[([^\[\]:=]+)\]")
_PAIR = re.compile(
    r"""([\w-]+)["']?\s*[:=]\s*("[^"]*"|'[^']*'|[^\s,;{}<>][^,;{}<>]*?(?=\s+\w+=|[,;{}<>/]|$))"""
)


def nested_keys(lines: Iterable[str]) -> dict[str, Any]:
    """Return the keys with keys below them in lines as of YAML, JSON, TOML or INI."""
    root: dict[str, Any] = {}
    stack: list[tuple[float, dict[str, Any]]] = [(-1.0, root)]
    for line in lines:
        bare = line.strip("#%/\t ")
        depth = float(len(line.rstrip()) - len(line.strip("#%/").lstrip()))
        item = bare.startswith("- ")
        bare = bare.removeprefix("- ").strip()
        if section := _SECTION.fullmatch(bare):
            stack = [(-1.0, root), (-0.5, root.setdefault(section[1], {}))]
            continue
        key, mark, value = halves(bare)
        key, value = key.strip(" \"'"), value.strip(" ,\"'")
        while len(stack) > 1 and depth <= stack[-1][0]:
            stack.pop()
        if not mark or not key:
            continue
        mapping = stack[-1][1]
        if item:
            record: dict[str, Any] = {}
            mapping.setdefault("", []).append(record)
            stack.append((depth, record))
            mapping = record
            depth += 1
        if value in {"", "{", "["}:
            mapping[key] = {}
            stack.append((depth, mapping[key]))
        else:
            mapping[key] = value
    return {key: below for key, below in root.items() if not isinstance(below, str) and below}


def record_in(line: str) -> dict[str, str]:
    """Return the pairs of keys and values in a line that has a name and a unit; else none."""
    pairs = {key: value.strip("\"'") for key, value in _PAIR.findall(line)}
    return pairs if {*pairs} & {*OWN_NAMES} and {*pairs} & UNIT_KEYS else {}


def halves(text: str) -> tuple[str, str, str]:
    """Return a text before and after its first colon or equals sign, and which it is."""
    place = re.search(r"[:=]", text)
    if place is None:
        return text, "", ""
    return text[: place.start()].strip(), place[0], text[place.end() :].strip(" :=")


def segments(text: str) -> list[str]:
    """Return the parts of a text between commas, bars, tabs and wide gaps."""
    return [segment.strip() for segment in re.split(r"[,;|\t]|\s{3,}", text)]


def cells_of(text: str) -> list[str]:
    """Return the cells of a row: between marks, else between blanks, else between slashes."""
    parts = DIVIDED.split(text)
    parts = parts if len(parts) > 1 else text.split()
    return [cell.strip() for cell in (parts if len(parts) > 1 else text.split("/"))]


def decoded(value: Any) -> str:  # noqa: ANN401 - whatever a file holds
    """Return a value as text, bytes decoded."""
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    return str(value)


def opened(value: Any) -> Any:  # noqa: ANN401 - whatever a file holds
    """Return bytes as text, arrays of texts as lists, and JSON in a text as what it holds."""
    if hasattr(value, "tolist") and value.dtype.kind in "OSU":
        value = value.tolist()
    if isinstance(value, list | tuple) and value and isinstance(opened(value[0]), str):
        texts = [decoded(opened(cell)) for cell in value]
        return texts[0] if len(texts) == 1 else texts
    if isinstance(value, bytes):
        value = decoded(value)
    if isinstance(value, str) and value.lstrip()[:1] in {"{", "["}:
        try:
            return json.loads(value)
        except (ValueError, RecursionError):
            return value
    return value
