"""What a file says of the units of its columns: keys of any depth, rows of units, lines of text.

Each format hands over the texts that it finds, and `UnitHints` tells which columns they concern.
`read_unit` judges the words.
"""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, lru_cache
from itertools import dropwhile, takewhile
from pathlib import PurePath
from typing import Any

from butterfly.errors import InputError
from butterfly.logs.headers import (
    DIVIDED,
    OWN_NAMES,
    UNIT_KEYS,
    USUAL,
    cells_of,
    decoded,
    halves,
    nested_keys,
    opened,
    parts_of,
    record_in,
    segments,
)
from butterfly.logs.unit_words import (
    Mention,
    counts_without_turn,
    is_value,
    mentions,
    plain_text,
)
from butterfly.logs.units import (
    UNITS,
    Heading,
    Said,
    Words,
    is_unit,
    without_ending,
    without_unit,
)

Way = tuple[str | int, ...]
"""What something is said of: keys down to a column, a column's number, or () for the file."""

_ASIDE = UNIT_KEYS | {
    *("of", "measure", "measurement", "measured", "astropy", "engineering", "physical", "base"),
    *("string", "str", "text", "symbol", "label", "the", "all", "is", "are", "in", "as", "column"),
    *("columns", "col", "channel", "signal", "joint", "motor", "commanded", "recorded", "value"),
    *("values", "data", "y"),
}  # words of a key or line that name no column
_HOLDERS = {
    *("meta", "metadata", "attrs", "attributes", "info", "datainfo", "properties", "header"),
    *("headers", "column", "columns", "field", "fields", "channel", "channels", "signals"),
    *("variables", "schema", "pandas"),
}  # keys that hold others and name no column
_SCALES = {"scale_factor": 0, "add_offset": 1}  # of the conventions for netCDF
_LETTERS = frozenset("VANsmhg")  # that are units

_OF_OTHERS = {
    *("supply", "bus", "battery", "limit", "limits", "max", "maximum", "min", "minimum", "rated"),
    *("rating", "nominal", "constant", "noise", "resolution", "offset", "threshold", "friction"),
}  # words of what a unit may be of besides a column
_BRACKETED = re.compile(r"([^\[\](){},;|\t]*?)[\[({]([^\[\](){}]*)(?:[\])}]|$)")
_IN_BRACKETS = re.compile(r"[\[({]([^\[\](){}]*)[\])}]")
_MARKS, _ENDS = " #%/\t,;", " #/\t,;"  # of comments
_WIDE = re.compile(r"\s{2,}")
_BETWEEN = _ASIDE - {"y"} | {"for", "given", "was", "were", "be", "stored", "logged", "expressed"}
_WORDS = 6  # of a column's name in a text, and cells in a row about a column
_SHOWN = 40  # characters of a text
_OF_NAME = "name"
_MANY = 30  # units within a line
_DEEPEST, _MOST, _LONGEST = 16, 1000, 500  # keys within keys, lines of text, characters of a line


class UnitHints:
    """The words of a file about its columns, which have these names in it."""

    def __init__(self, source: object, names: Sequence[str]) -> None:
        self._source, self._names = source, [str(name) for name in names]
        self._said: dict[tuple[Way, Words], None] = {}
        self._scales: dict[Way, list[float]] = {}
        self._texts: dict[tuple[Way, str, str], None] = {}  # all there are, with their places
        self._left = _MOST  # lines of text
        self._hear(PurePath(str(source)).stem, "file name")

    def metadata(self, entries: Any, place: str = "", way: Way = ()) -> None:  # noqa: ANN401 - whatever a file holds
        """Collect keys and their values, or rows of them, which concern what ``way`` names."""
        if isinstance(entries, list):
            self._listed(entries, place, way, ())
            return
        first = str(next(iter(entries), ""))
        if place.count(".") > _DEEPEST or first.isdecimal():  # an index of pandas
            return
        for name, given in entries.items():
            key, value = decoded(name), opened(given)
            mark = "." if place and not place.endswith(("metadata", "attribute")) else " "
            where = f"{place}{mark}{key}".strip(" .")
            below = way if key.lower() in _HOLDERS else (*way, key)
            self._hear(key, where, way, below)
            rest = _besides_unit(key)
            if rest is not None:
                self._units(value, (*way, *rest), where)
            elif isinstance(value, Mapping):
                self.metadata(value, where, below)
            elif isinstance(value, list):
                self._listed(value, where, way, below[len(way) :])
            elif way and key.lower() in _SCALES:
                scales = self._scales.setdefault(way, [1.0, 0.0])
                scales[_SCALES[key.lower()]] = self._number(key, value)
            elif not isinstance(value, str) or key.lower().endswith("type"):  # datetime64[ns]
                continue
            elif way:
                self._hear(value, where, way)
                self._add((key,), value, where, Said.AS_VALUE)
            else:
                self.text([f"{key}: {value}", *value.splitlines()], where)

    def _listed(self, entries: list[Any], place: str, way: Way, tail: Way) -> None:
        """Collect from a list of columns, or of rows that repeat the unit of theirs."""
        rows: dict[str, dict[str, Any]] = {}
        if all(isinstance(text, str) for text in entries[:_MOST]):
            self._hear(", ".join(entries[:_MOST]), place, (*way, *tail))
        for entry in entries:
            if not isinstance(entry, Mapping):
                continue
            names = [entry[key] for key in OWN_NAMES if isinstance(entry.get(key), str)]
            if names:
                self.metadata(entry, place, (*way, names[0]))
            else:
                rows.setdefault("", {k: v for k, v in entry.items() if isinstance(v, str | dict)})
                units = _units_within(entry)
                rows[repr(units)] = units
        for entry in rows.values():
            self.metadata(entry, place, (*way, *tail))

    def row(self, cells: Sequence[str], place: str) -> None:
        """Collect a row with the unit of each column."""
        for k, cell in enumerate(cells):
            self.column(k, cell.strip("[](){} "), place)

    def column(self, number: int, text: object, place: str) -> None:
        """Collect the unit of a column."""
        self._add((number,), str(text), place, Said.AS_UNIT)

    def cell(self, name: str, text: str) -> None:
        """Collect the first text in a column of such, perhaps of units."""
        line = f"{name}: {text}" if _besides_unit(name) is not None else text
        self.text([line], f"column {name}")

    def note(self, number: int, text: str, place: str) -> None:
        """Collect a text about a column."""
        self._hear(text, place, (number,))

    def text(
        self,
        lines: Iterable[str],
        place: str,
        split: Callable[[str], list[str]] | None = None,
    ) -> None:
        """Collect lines: keys and values of any depth, rows of units, tables of columns, prose."""
        texts = [plain_text(line[:_LONGEST]) for line in [*dict.fromkeys(lines)][: self._left]]
        self._left -= len(texts)
        self.metadata(nested_keys(texts), place)
        for line in texts:
            if pairs := record_in(line):
                self.metadata([pairs], place)
                continue
            plain = re.sub(r"[,;]\s+(in\s)", r" \1", line.lstrip(_MARKS).rstrip(_ENDS))
            self._hear(plain, place)
            if self._row_in(plain, place, split or cells_of):
                continue
            head, mark, rest = halves(plain)
            first, _, after = plain.partition(" ")
            if mark and head.lower() in UNIT_KEYS:
                self._units(rest, (), place)
            elif first.lower() in UNIT_KEYS and is_unit(after):
                self._units(after, (), place)
            for segment in segments(plain):
                self._segment(segment, place)

    def _row_in(self, line: str, place: str, split: Callable[[str], list[str]]) -> bool:
        """Collect a row of units, or the unit in a row about one column; tell whether it is one."""
        first, *rest = split(line)
        ways = [[first, *rest], cells_of(line), _WIDE.split(line), _IN_BRACKETS.findall(line)]
        after = [line.partition(mark)[2] for mark in ":= "]
        ways += [*map(cells_of, after), *(text.split("/") for text in (line, *after))]
        if _besides_unit(first) == ():
            ways += [rest, ["", *rest]]
        row = next((cells for cells in ways if self._is_row(cells)), None)
        if row is not None:
            self.row(row, place)
            return True
        for cells in (DIVIDED.split(line), _WIDE.split(line)):
            if len(cells) > _WORDS:
                continue
            columns = [cell for cell in cells if len(self._columns((cell,))) == 1]
            units = [cell.strip(" [](){}") for cell in cells if is_unit(cell)]
            if len(columns) == len(units) == 1:
                self._add((columns[0],), units[0], place, Said.AS_VALUE)
                return True
        return False

    def headings(self, places: Mapping[str, int]) -> dict[str, Heading]:
        """Return the headings of the columns with these numbers, by field of the log."""
        headings = {field: Heading(name=self._names[k], number=k) for field, k in places.items()}
        in_texts = self._from_texts()
        for way, words in self._said:
            fields, alone = self._of(way, places)
            for name in fields:
                kind = "unit_words" if alone else "shared"
                more: Any = {kind: (*getattr(headings[name], kind), words)}
                headings[name] = replace(headings[name], **more)
        for way, (factor, offset) in self._scales.items():
            for name in self._of(way, places)[0]:
                headings[name] = replace(headings[name], scale=(factor, offset))
        if "input" in headings:
            mentioned = tuple(self._mentioned(places["input"], in_texts))
            headings["input"] = replace(headings["input"], mentioned=mentioned)
        return headings

    def _hear(self, text: str, place: str, way: Way = (), name: Way = ()) -> None:
        """Keep a text about what ``way`` leads to, unless it is the ``name`` of a column."""
        if len(self._texts) < _MOST and not (name and self._columns(name)):
            self._texts[way, text[:_LONGEST], place] = None

    def _from_texts(self) -> list[tuple[Way, Words, set[str]]]:
        """Collect the units in all texts; return each, what it may be of, and where it is."""
        units = []
        for way, text, place in self._texts:
            whole = self._columns(way)
            for mention in mentions(text)[:_MANY]:
                if {*mention.words, *_words(place)} & _OF_OTHERS:
                    continue
                subject = () if mention.of_one else self._subject(mention)
                of = subject or (way if whole and mention.meant and not mention.of_one else ())
                if of and self._columns(of) == (whole or self._columns(of)):
                    sure = mention.marked and (subject or mention.bracket != "(")
                    how = Said.AS_VALUE if sure or mention.named_alone else Said.IN_PROSE
                    self._add(of, mention.text, place, how)
                listed = len(mention.rest) < _MANY and mention.of_list and not way
                alone = listed and all(map(_is_of_list, mention.rest))
                how = Said.AS_VALUE if of or alone else Said.IN_PROSE
                if of or alone or mention.sure or mention.bracket:
                    words = Words(mention.text, f"{place}: {text[:_SHOWN]!r}", how)
                    units.append((of or way, words, {*mention.words} - {*_words(place)}))
        return units

    def _subject(self, mention: Mention) -> Way:
        """Return the way to the column next to a unit, past words and marks between; else ()."""
        for tokens, turn in ((mention.before[::-1], -1), (mention.after, 1)):
            run = [*takewhile(_is_word, dropwhile(_is_between, tokens))][:_WORDS]
            for count in range(len(run), 0, -1):
                way = (" ".join(run[:count][::turn]),)
                if self._columns(way) or self._fields(way):
                    return way
            if run:
                break
        return ()

    def _mentioned(
        self, number: int, units: Iterable[tuple[Way, Words, set[str]]]
    ) -> Iterable[Words]:
        """Yield the units that may be of the input: as values, if hardly of anything else."""
        name = self._names[number]
        others = {_key(without_unit(other)) for other in self._names if other != name}
        others -= {_key(without_ending(name))}
        for mention in (*mentions(name.replace(".", " ")), *mentions(name[1:])):  # umV
            yield Words(mention.text, _OF_NAME, Said.AS_VALUE)
        for of, words, around in units:
            columns, fields = self._columns(of), self._fields(of)
            is_input = (columns and number in columns) or "input" in fields
            if is_input or not (columns or fields or around & others):
                yield words

    @cached_property
    def _index(self) -> tuple[dict[Any, list[int]], ...]:
        """Columns by the keys down to them, by the last of these, and by name without a unit."""
        whole, ends, bare = (defaultdict[Any, list[int]](list) for _ in range(3))
        for k, name in enumerate(self._names):
            keys = tuple(map(_key, name.split(".")))
            for depth in range(1, len(keys) + 1):
                whole[keys[:depth]].append(k)
            ends[keys[-1]].append(k)
            for key in {_key(without_unit(name)), _key(without_ending(name))}:
                bare[key].append(k)
        return whole, ends, bare

    def _add(self, way: Way, text: object, place: str, how: Said) -> None:
        if isinstance(text, str) and text.strip() and len(text) <= _LONGEST:
            words = Words(" ".join(text.split()), place, how)
            if how is not Said.AS_UNIT:
                if len(text) == 1 and text.isalpha() and text not in _LETTERS:
                    return  # M. Smith
                if counts_without_turn(words.text):
                    words = replace(words, how=Said.AS_UNIT)
            if not words.silent and (words.how is Said.AS_UNIT or is_unit(words.text)):
                self._said[way, words] = None

    def _number(self, key: str, value: Any) -> float:  # noqa: ANN401 - whatever a file holds
        try:
            number = float(value[0] if getattr(value, "size", 0) == 1 and value.ndim else value)
        except (TypeError, ValueError):
            number = math.nan
        if not math.isfinite(number) or (key.lower() == "scale_factor" and not number):
            raise InputError(self._source, key, value, "a finite number, not 0")
        return number

    def _units(self, value: Any, way: Way, place: str) -> None:  # noqa: ANN401 - whatever a file holds
        """Collect the units found under a key of units."""
        if isinstance(value, Mapping):
            for key, below in value.items():
                keys = () if key in OWN_NAMES else decoded(key).split(".")
                self._units(opened(below), (*way, *keys), place)
        elif isinstance(value, list | tuple) and len(value) == len(self._names):
            self.row([decoded(cell) for cell in value], place)
        elif isinstance(value, list | tuple):
            for unit in value:
                self._add(way, decoded(unit), place, Said.AS_UNIT)
        elif isinstance(value, str) and (way or is_unit(value)):
            self._add(way, value, place, Said.AS_UNIT)
        elif isinstance(value, str):
            self._units_of_all(value, place)

    def _units_of_all(self, text: str, place: str) -> None:
        """Collect ``s, mV, rad``, ``time: s, input: mV``, ``time s input mV``, or else a word."""
        cells = cells_of(text)
        if self._is_row(cells):
            self.row(cells, place)
        elif any(mark in text for mark in ":=[({"):
            for segment in segments(text):
                self._segment(segment, place, Said.AS_UNIT)
        elif is_unit(text) or not mentions(text):
            self._add((), text, place, Said.AS_UNIT)

    def _is_row(self, cells: Sequence[str]) -> bool:
        """Whether there is a unit, or a dash, for each column."""
        given = [cell for cell in cells if cell.strip(" -")]
        return (
            len(cells) == len(self._names)
            and bool(given)
            and all(is_unit(cell) or counts_without_turn(cell) for cell in given)
        )

    def _segment(self, text: str, place: str, how: Said | None = None) -> None:
        """Collect ``input unit: mV``, or any ``input: word`` and ``input [word]`` if told how."""
        head, mark, rest = halves(text)
        if mark and rest:
            besides = _besides_unit(head)
            if besides or how:
                self._add(besides or (head,), rest, place, Said.AS_UNIT)
            self._segment(rest, place, how)
        elif how:
            for before, words in _BRACKETED.findall(text):
                self._add((before.strip(),), words, place, how)

    def _of(self, way: Way, places: Mapping[str, int]) -> tuple[list[str], bool]:
        """Return the fields that something is said of, and whether of a single column."""
        if not way:
            return [*places], len(self._names) == 1
        if columns := self._columns(way):
            return [field for field, k in places.items() if k in columns], len(columns) == 1
        return [f for f in places if f in self._fields(way)], True

    def _fields(self, way: Way) -> list[str]:
        """Return the fields that ``way`` means by usual words."""
        last = str(way[-1]) if way and isinstance(way[-1], str) else ""
        words = {word for word in _words(last) if word not in _ASIDE}
        plural = {word.removesuffix("s") for word in words}
        usual = [(f, USUAL.get(f, {f})) for f in UNITS]
        return [f for f, names in usual if words and (words <= names or plural <= names)]

    def _columns(self, way: Way) -> list[int]:
        """Return the columns that ``way`` leads to."""
        if not way or isinstance(way[0], int):
            return [number for number in way[:1] if isinstance(number, int)]
        whole, ends, bare = self._index
        keys = tuple(_key(part) for key in way for part in str(key).split("."))
        columns, last = whole.get(keys) or ends.get(keys[-1]) or [], str(way[-1])
        words = " ".join(word for word in _words(last) if word not in _ASIDE)
        for text in map(_key, (last, without_unit(last), words)):
            columns = columns or bare.get(text or None, [])
        return columns


def _is_between(token: str) -> bool:
    """Whether a token may stand between a name and its unit."""
    return not _is_word(token) or token.lower().strip(".") in _BETWEEN or is_value(token)


def _is_of_list(token: str) -> bool:
    """Whether a token may stand in a list of units, one for each column."""
    listed = {*UNIT_KEYS, "column", "col", "channel"}
    return not _is_word(token) or is_value(token) or is_unit(token) or token.lower() in listed


def _is_word(token: str) -> bool:
    """Whether a token has a letter or a digit."""
    return any(map(str.isalnum, token))


def _units_within(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return only those entries of a row that have a key of units, at any depth."""
    units = {k: v for k, v in row.items() if _besides_unit(k) is not None}
    below = {k: _units_within(v) for k, v in row.items() if isinstance(v, dict) and k not in units}
    return units | {k: v for k, v in below.items() if v}


def _key(name: object) -> str:
    """Return a name as it is compared: plain, in lower case, without blanks."""
    return "".join(plain_text(str(name)).lower().split()).replace("_", "")


def _words(text: str) -> list[str]:
    """Return the words of a name in lower case."""
    return [word.lower() for word in parts_of(text)]


@lru_cache(4096)
def _besides_unit(key: str) -> tuple[str, ...] | None:
    """Return what else a key of units names, as a way; None if it is none."""
    words = _words(key)
    if not UNIT_KEYS & {*words}:
        return None
    named = [word for word in words if word not in UNIT_KEYS]
    rest = [word for word in named if word not in _ASIDE]
    usual = set().union(*USUAL.values())
    if rest and not ({*rest} & usual or (len(rest) == 1 and words[-1] in UNIT_KEYS)):
        return None  # unitsPerRotation
    return ("_".join(named),) if rest else ()
