"""What the head of a file says: names of columns, and keys with values."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from butterfly.logs.clock import NANOSECONDS
from butterfly.logs.log import InputKind
from butterfly.logs.unit_words import counts_without_turn, plain_text, quantity_of
from butterfly.logs.units import UNITS, units_spelt

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


_PARTS = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+|[^\W\d_a-zA-Z]+")
_LONGEST = 500  # characters of a name

_COMMANDED = {"input", "u", "command", "commanded", "cmd", "control", "ctrl", "action"}
_GOAL = {"goal", "setpoint", "target", "desired", "des", "reference", "ref", "demand"}
_MEASURED = {"present", "measured", "meas", "actual", "feedback", "estimated", "state"}
_OTHERS = {
    *("enable", "enabled", "supply", "battery", "bus", "temperature", "temp", "limit", "min"),
    *("max", "error", "status", "id", "index"),
}
_FIELDS = {
    "time": {"time", "t", "timestamp", "timestamps", "stamp"},
    "angle": {"angle", "position", "pos", "q", "theta", "phi"},
    "velocity": {"velocity", "speed", "vel", "omega", "dq", "qd", "v"},
}
_KINDS = {
    InputKind.VOLTAGE: {"voltage", "volt", "volts"},
    InputKind.TORQUE: {"torque", "tau", "effort", "force"},
    InputKind.CURRENT: {"current"},
    InputKind.DUTY: {"duty", "pwm", "dutycycle"},
}
USUAL = _FIELDS | {
    "velocity": _FIELDS["velocity"] - {"v"},  # which is a unit, too
    "input": _COMMANDED.union(*_KINDS.values()),
}
"""Usual words for fields of a log."""

_OF_QUANTITIES = {
    "voltage": InputKind.VOLTAGE,
    "torque": InputKind.TORQUE,
    "force": InputKind.TORQUE,
    "current": InputKind.CURRENT,
    "share": InputKind.DUTY,
}


def parts_of(text: str) -> list[str]:
    """Return the words of a name or a text, as they are written: inputVoltage has two."""
    return _PARTS.findall(plain_text(text[:_LONGEST]))


@dataclass(frozen=True, kw_only=True)
class Meaning:
    """What a name says."""

    field: str  # of a log; "" if none or several
    kind: InputKind | None = None  # of an input, if said
    commanded: bool = False  # whether it is called a command or a goal


_NOTHING = Meaning(field="")

_SECONDS = {"sec", "secs", "second", "seconds"}
_NANOSECONDS = {"nsec", "nsecs", "nanosec", "nanosecs", "nanosecond", "nanoseconds"}


def meaning_of(name: str) -> Meaning:
    """Return what the name of a column says by a usual word, or else by a unit."""
    parts = parts_of(name)
    words = {"volt" if part == "V" else part.lower() for part in parts}
    units = {part for part in parts if len(part) > 1 or part.isupper()}
    if words & _OTHERS:
        return _NOTHING
    fields = {field for field, usual in _FIELDS.items() if words & usual}
    kinds = {kind for kind, usual in _KINDS.items() if words & usual}
    kinds |= set() if kinds or fields else _kinds_by_unit(units)
    if words & (_COMMANDED | _GOAL):
        if fields & {"angle", "velocity"} or (words & _GOAL and not kinds):
            kinds |= {InputKind.SETPOINT}
        if len(kinds) > 1 or "time" in fields:
            return _NOTHING
        return Meaning(field="input", kind=next(iter(kinds), None), commanded=True)
    fields |= {"input"} if kinds else set()
    fields = fields or _fields_by_unit(units)
    if len(fields) != 1 or len(kinds) > 1 or (kinds and words & _MEASURED):
        return _NOTHING
    return Meaning(field=min(fields), kind=next(iter(kinds), None))


def _kinds_by_unit(words: set[str]) -> set[InputKind]:
    units = {unit for word in words for unit in units_spelt("input", word)} & UNITS["input"].keys()
    return {_OF_QUANTITIES[quantity_of(unit)] for unit in units}


def _fields_by_unit(words: set[str]) -> set[str]:
    pairs = [(field, word) for field in ("time", "angle") for word in words]
    fields = {field for field, word in pairs if UNITS[field].keys() & {*units_spelt(field, word)}}
    return fields | ({"angle"} if any(map(counts_without_turn, words)) else set())


def columns_meant(
    names: Iterable[str],
    kind: InputKind | None = None,
    texts: Mapping[str, str] = MappingProxyType({}),
) -> dict[str, str]:
    """Return the columns of time, input and angle, by field, where exactly one name fits.

    An input of the given ``kind``, if there is one; and rather one that is called a command. Time
    may be two columns, whole seconds and nanoseconds.
    ``texts``: what is to be read of a name in place of it.
    """
    meant = {name: meaning_of(texts.get(name, name)) for name in names}
    candidates = {f: [n for n in meant if meant[n].field == f] for f in ("time", "input", "angle")}
    inputs = [n for n in candidates["input"] if kind is None or meant[n].kind in {kind, None}]
    inputs = [n for n in inputs if kind and meant[n].kind is kind] or inputs
    candidates["input"] = [n for n in inputs if meant[n].commanded] or inputs
    columns = {field: names[0] for field, names in candidates.items() if len(names) == 1}
    return _stamp_of(candidates["time"]) | columns


def _stamp_of(names: Sequence[str]) -> dict[str, str]:
    """Return the columns of a time in two, whole seconds and nanoseconds, if that is what they are.

    Their names differ in the last word: ``stamp.sec``, ``stamp.nanosec``.
    """
    parts = {name: [part.lower() for part in parts_of(name)] for name in names}
    whole = [name for name in names if {*parts[name][-1:]} & _SECONDS]
    rest = [name for name in names if {*parts[name][-1:]} & _NANOSECONDS]
    if len(names) != len(whole + rest) or (len(whole), len(rest)) != (1, 1):
        return {}
    same = parts[whole[0]][:-1] == parts[rest[0]][:-1]
    return {"time": whole[0], NANOSECONDS: rest[0]} if same else {}


_OF_DRIVE = {
    "supply": {"supply", "vin"},
    "enabled": {"enabled", "enable"},
}


def columns_of_drive(names: Iterable[str]) -> dict[str, str]:
    """Return the columns of a servo's supply in V and of whether it is on, where one name fits."""
    words = {name: {part.lower() for part in parts_of(name)} for name in names}
    fitting = {field: [n for n in words if words[n] & some] for field, some in _OF_DRIVE.items()}
    return {field: columns[0] for field, columns in fitting.items() if len(columns) == 1}


def columns_by_joint(names: Sequence[str], joints: Iterable[str]) -> dict[str, dict[str, str]]:
    """Return for each joint its columns, and what each says besides the joint's name.

    A column of ``wrist_roll`` is none of ``wrist``; one that is called as the joint is an angle.
    """
    words = {joint: tuple(part.lower() for part in parts_of(joint)) for joint in joints}
    longest = sorted(words, key=lambda joint: -len(words[joint]))
    columns: dict[str, dict[str, str]] = {joint: {} for joint in words}
    for name in names:
        parts = parts_of(name)
        lower = tuple(part.lower() for part in parts)
        for joint in longest:
            size = len(words[joint])
            places = (
                k for k in range(len(lower) - size + 1) if lower[k : k + size] == words[joint]
            )
            if size and (place := next(places, None)) is not None:
                rest = " ".join(parts[:place] + parts[place + size :])
                columns[joint][name] = rest or "angle"
                break
    return columns


def columns_of_joint(
    names: Sequence[str], joint: str, joints: Iterable[str], kind: InputKind | None = None
) -> dict[str, str]:
    """Return the columns of time, and of a joint's input and angle (see `columns_meant`)."""
    of_joint = columns_by_joint(names, {*joints, joint})
    others = {name for columns in of_joint.values() for name in columns} - {*of_joint[joint]}
    mine = [name for name in names if name not in others]
    meant = columns_meant(mine, kind, of_joint[joint])
    general = {field: name for field, name in meant.items() if name not in of_joint[joint]}
    driven = columns_meant(of_joint[joint], kind, of_joint[joint])
    time = {field: name for field, name in general.items() if field in {"time", NANOSECONDS}}
    return time | driven
