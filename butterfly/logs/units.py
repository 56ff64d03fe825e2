"""Units and signs of the columns of logs, and of the numbers that describe them.

A unit is a name (``deg``), counts per turn (``counts/4096``) or the factor to the project's own
unit (``0.01745``). A leading minus negates the column (``-deg``); ``-`` or ``-1`` alone negates it
and keeps the unit of the file.

`read_unit` is the one rule for the unit of a column, whatever its source.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from numbers import Real
from typing import Any

from butterfly.errors import InputError, nearest
from butterfly.logs.unit_words import (
    QUANTITIES,
    counts_without_turn,
    factor_of,
    mentions,
    plain_text,
    quantity_of,
    units_meant,
)

_HOLDS = {
    "time": ("time",),
    "input": ("voltage", "current", "torque", "force", "share"),
    "angle": ("angle", "length"),
    "velocity": ("rate", "speed"),
    "setpoint": ("angle", "length", "rate", "speed"),
    "supply": ("voltage",),
    "omega": ("rate", "frequency"),
    "mass": ("mass",),
    "arm": ("length",),
}

UNITS = {
    name: {unit: factor for kind in kinds for unit, factor in QUANTITIES[kind].items()}
    for name, kinds in _HOLDS.items()
}
"""Units, each with its factor, of the sampled columns and of a log's ``omega``, added mass and arm
(an amplitude has the unit of the input). A slide's angle is a length."""

DATES = "dates"
"""Source of the unit of a clock of dates, which no other source can change."""

ASSUMED, GIVEN = "assumed", "given"
"""Source of a unit that is not in the file: the default, or an option or the manifest."""

_KIND_OF = {"share": "duty", "force": "torque"}  # of an input, by its quantity
_TURNABLE = ("input", "angle", "velocity", "setpoint")
_BRACKETS = re.compile(r"[\[({]([^\[\](){}]*)(?:[\])}]|$)")
_SILENT = re.compile(
    r"[-–\s.]*|[-+\d.,eE\s]+|(?:si|mks|metric)(?: units?)?|"
    r"none|null|nan|n/?a|unknown|unitless|dimensionless|\?+",
    re.IGNORECASE,
)


class Said(Enum):
    """How surely words are meant as a unit."""

    AS_UNIT = "its place is one of units: an unknown word is an error"
    AS_VALUE = "a known unit is one, and other words are none"
    IN_PROSE = "a known unit that fits is one, a single letter only if it is the project's own"


@dataclass(frozen=True)
class Words:
    """What a file says of a unit."""

    text: str
    place: str
    how: Said = Said.AS_UNIT

    @property
    def silent(self) -> bool:
        """Whether the text says nothing of units: a number, SI, a dash."""
        return _SILENT.fullmatch(self.text.strip("[](){} ")) is not None


@dataclass(frozen=True, kw_only=True)
class Units:
    """Factors and signs to the project's own units."""

    factors: Mapping[str, float] = field(default_factory=dict)  # of keys of `UNITS`, else 1
    names: Mapping[str, str] = field(default_factory=dict)  # of units given by name
    turned: frozenset[str] = frozenset()  # columns to negate with only a sign given

    @classmethod
    def of(cls, units: Mapping[str, Any] | None, source: object = "units") -> Units:
        """Read the unit of each column, a text or a factor; refuse unknown columns and units."""
        if units is not None and not isinstance(units, Mapping):
            raise InputError(source, "units", units, "a mapping such as {'angle': 'deg'}")
        factors, names, turned = {}, {}, set()
        for name, unit in (units or {}).items():
            if name not in UNITS:
                raise InputError(source, f"units.{name}", "an unknown name", nearest(name, UNITS))
            if isinstance(unit, str | Real) and unit in ("-", "-1", -1):
                _require_turnable(source, name, unit)
                turned.add(name)
                continue
            factors[name], known = _factor_and_name(name, unit, source)
            if known:
                names[name] = known
        return cls(factors=factors, names=names, turned=frozenset(turned))

    def factor(self, name: str, default: float = 1.0) -> float:
        """Return the factor of a key of `UNITS`, given or the file's ``default``, with its sign."""
        factor = self.factors.get(name, default)
        return -factor if name in self.turned else factor

    def with_sign(self, sign: int) -> Units:
        """Return the units with the input negated if the sign is -1."""
        turned = self.turned if sign == 1 else self.turned ^ {"input"}
        return Units(factors=self.factors, names=self.names, turned=turned)


AS_IS = Units()
"""The project's own units."""


@dataclass(frozen=True, kw_only=True)
class Heading:
    """Name and number of a column in its file, and what the file says of it besides."""

    name: str
    number: int | None = None  # from 0; None for a variable
    unit_words: tuple[Words, ...] = ()  # of its unit
    shared: tuple[Words, ...] = ()  # the same, of several columns: of those that it fits
    scale: tuple[float, float] = (1.0, 0.0)  # factor and offset that make its numbers values
    mentioned: tuple[Words, ...] = ()  # units in the file that nothing says to be of a column


@dataclass(frozen=True)
class Unread:
    """Another unit in a file than the one that its input was taken in, and what may be right."""

    taken: str
    unit: str
    place: str
    kind: str = ""  # of the input, if the unit is of another quantity

    @property
    def text(self) -> str:
        """What was taken, and what the file says."""
        taken = taken_text(self.taken, silent=False)
        return f"{taken}, but the file says {self.unit} ({self.place})"

    @property
    def cure(self) -> str:
        """How to say what is right."""
        units = f"units: {{input: {self.unit}}} in the manifest"
        if self.kind:
            how = f"--input {self.kind}, and --units input={self.unit}"
            return f"Set {how}; or input: {self.kind}, {units}. If {self.taken} is right, say so."
        right = f"If {self.taken} is right, say so: --units input={self.taken}."
        return f"Set --units input={self.unit}, or {units}. {right}"


@dataclass(frozen=True, kw_only=True)
class ColumnReading:
    """The source of a column of a log, and its unit."""

    name: str
    number: int | None
    unit: str
    unit_source: str  # source of the unit: "name", another place in the file, `GIVEN` or `ASSUMED`
    factor: float  # to the project's own unit, negative if negated
    unread: Unread | None = None  # of an assumed unit of the input

    @property
    def has_other_unit(self) -> bool:
        """Whether the file gives a unit other than the project's own."""
        return self.unit_source not in {ASSUMED, GIVEN} and (
            abs(self.factor) != 1 or "epoch" in self.unit
        )

    @property
    def assumed(self) -> bool:
        """Whether the unit is not specified."""
        return self.unit_source == ASSUMED

    @property
    def taken(self) -> str:
        """What an assumed unit of the input was taken for."""
        return self.unread.text if self.unread else taken_text(self.unit)

    @property
    def other(self) -> str:
        """Another unit than the assumed one: that which the file mentions, or an example."""
        return self.unread.unit if self.unread else f"m{self.unit}" if self.unit in "VA" else "..."

    @property
    def text(self) -> str:
        """Description of the column."""
        which = f'"{self.name}"' if self.name else "without a name"
        which = which if self.number is None else f"column {self.number} {which}"
        how = [] if self.unit_source == "name" else [self.unit_source]
        how += ["negated"] if self.factor < 0 else []
        return f"{which}, {self.unit}" + (f" ({', '.join(how)})" if how else "")


def read_unit(
    source: object, field: str, heading: Heading, units: Units, fitting: Sequence[str]
) -> ColumnReading:
    """Read the unit of a column; ``fitting`` are its possible quantities, keys of `QUANTITIES`.

    A word that is not a unit is refused unless the unit is given, and so are two different units,
    and a unit of another quantity. A given factor overrides all.
    """
    given = units.names.get(field)
    if field in units.factors and given is None:
        unit, origin, factor = f"times {abs(units.factors[field]):g}", GIVEN, 1.0
    else:
        unit, origin = _unit_and_place(source, field, heading, given, fitting)
        factor = factor_of(unit)
    factor = units.factor(field, factor)
    unread = _unread(heading, unit, fitting) if (field, origin) == ("input", ASSUMED) else None
    if heading.scale != (1.0, 0.0):
        origin += ", scale_factor {:g} and add_offset {:g}".format(*heading.scale)
    name, number = heading.name, heading.number
    return ColumnReading(
        name=name, number=number, unit=unit, unit_source=origin, factor=factor, unread=unread
    )


def _kind_of(unit: str) -> str:
    """Return the kind of input that has a unit; "" if none has."""
    quantity = quantity_of(unit)
    return _KIND_OF.get(quantity, quantity) if quantity in _HOLDS["input"] else ""


def taken_text(unit: str, *, silent: bool = True) -> str:
    """Say what the input was taken in, where its file is ``silent`` or says something else."""
    return f"input taken in {unit}" + ": the file does not say" * silent


def _unread(heading: Heading, taken: str, fitting: Sequence[str]) -> Unread | None:
    """Return the first unit of an input, other than the taken one, that the file mentions.

    One in prose counts if it is of a ``fitting`` quantity.
    """
    for words in heading.mentioned:
        for unit in units_spelt("input", words.text):
            quantity, assumed = quantity_of(unit), quantity_of(taken)
            kinds = fitting if words.how is Said.IN_PROSE else _HOLDS["input"]
            if quantity in kinds and (quantity, factor_of(unit)) != (assumed, factor_of(taken)):
                return Unread(
                    taken, unit, words.place, "" if quantity in fitting else _kind_of(unit)
                )
    return None


def apportioned(
    headings: Mapping[str, Heading], fitting: Mapping[str, Sequence[str]]
) -> dict[str, Heading]:
    """Return headings by field, each with the shared words that fit it."""
    completed = dict(headings)
    for words in dict.fromkeys(phrase for head in headings.values() for phrase in head.shared):
        names = [name for name, head in headings.items() if words in head.shared]
        kinds = {quantity_of(unit) for unit in units_spelt(names[0], words.text)}
        fits = [name for name in names if kinds & {*fitting[name]}]
        if not fits and not (kinds or words.how is Said.AS_UNIT):
            continue
        for name in fits or [names["input" in names and names.index("input")]]:  # to be refused
            completed[name] = replace(
                completed[name], unit_words=(*completed[name].unit_words, words)
            )
    return completed


def _unit_and_place(
    source: object, field: str, heading: Heading, given: str | None, fitting: Sequence[str]
) -> tuple[str, str]:
    where = heading.name or f"column {heading.number}"
    option = f"--units {field}=... or units: in the manifest"
    fits = [unit for quantity in fitting for unit in QUANTITIES[quantity]]
    fits += ["counts/4096 (counts per turn)"] if "angle" in fitting else []
    known: dict[str, str] = {}
    for words in (*_in_name(field, heading.name, fitting), *heading.unit_words):
        named = [] if words.silent else units_spelt(field, words.text.strip("[](){} "))
        fit = [unit for unit in named if quantity_of(unit) in fitting]
        sure = words.how is Said.AS_UNIT
        letter = words.how is Said.IN_PROSE and re.fullmatch(r"\W*[a-zA-Z]\W*", words.text)
        if letter and named != fits[:1]:
            continue
        if len(named) == 1 and fit:
            known.setdefault(named[0], words.place)
        elif len(named) == 1 and (sure or (given is None and words.how is Said.AS_VALUE)):
            expected = f"a unit of {' or '.join(fitting)}: {', '.join(fits)}, or a factor"
            what = f"the unit {named[0]} of {field} ({words.place})"
            kind = _kind_of(named[0]) if field == "input" else ""
            expected += f"; or --input {kind}" if kind else ""
            raise InputError(source, where, what, f"{expected} ({option})")
        elif given is None and not words.silent and (sure or len(named) > 1):
            expected = " or ".join(named) or f"one of {', '.join(fits)}, or a factor"
            what = f"the unit {words.text!r} of {field}"
            what += "" if words.place == _NAME else f" ({words.place})"
            raise InputError(source, where, what, f"{expected} ({option})")
    if given is not None:
        known.setdefault(given, GIVEN)
    if len({factor_of(unit) for unit in known}) > 1:
        both = " and ".join(f"{unit} ({place})" for unit, place in known.items())
        dated = next((unit for unit, place in known.items() if place == DATES), None)
        factor = factor_of(dated or given or next(iter(known)))
        expected = f"one unit, or a factor, which overrides both: --units {field}={factor:.9g}"
        raise InputError(source, where, f"the units {both} of {field}", expected)
    return next(iter(known.items()), (fits[0], ASSUMED))


# Names of columns: angle [deg], angle_deg, angleDeg, angle:deg.

_NAME = "name"
_ENDS = re.compile(r"(?<=[\W_])(?=[^\W_]|[°%])|(?<=[a-z])(?=[A-Z])")  # where a unit may begin
_QUANTITY = re.compile(r"(?i)time|input|angle|voltage|torque|current|position|velocity|command")
_LETTERS = frozenset("VAN")  # that mean units after the name of a quantity
_NOT_IN_NAMES = {"min", "turn", "rotation", "second", "inc", "step"}  # minimum, the second
_LONGEST_NAME = 80


def words_in(name: str) -> list[str]:
    """Return the texts in brackets in a column's name, except an index: q[0]."""
    texts = (text.strip() for text in _BRACKETS.findall(plain_text(name)))
    return [text for text in texts if not _SILENT.fullmatch(text)]


def without_unit(name: str) -> str:
    """Return a column's name without brackets, except those of an index."""
    bare = _BRACKETS.sub(lambda m: m[0] if m[1].strip().isdecimal() else " ", plain_text(name))
    return " ".join(bare.split())


def without_ending(name: str) -> str:
    """Return a column's name without the unit that ends it: angle of angle_deg."""
    for start, words in _endings(without_unit(name)):
        if start and len(words) > 1 and words.lower() not in _NOT_IN_NAMES and units_meant(words):
            return without_unit(name)[:start].rstrip(" _-:/.,|")
    return without_unit(name)


def _in_name(field: str, name: str, fitting: Sequence[str]) -> list[Words]:
    """Return the unit in a column's name: in brackets, or at its end."""
    texts = words_in(name)
    if texts:
        known = [text for text in texts if units_spelt(field, text)]
        known = known or [
            mention.text for text in texts for mention in mentions(text) if mention.sure
        ]
        return [Words(text, _NAME) for text in known or texts]
    bare = without_unit(name)
    for start, words in _endings(bare):
        before, named = bare[:start], units_spelt(field, words)
        if before[-1:].islower() and words[0].isupper():  # angleDeg, its unit of open case
            small = units_spelt(field, words[0].lower() + words[1:])
            named = [*dict.fromkeys([*small, *named])] if len(words) < len("MNms") else small
        fits = any(quantity_of(unit) in fitting for unit in named)
        separated = before.rstrip(" ")[-1:] in {"/", ":", "="} or (
            before.endswith(" ") and _QUANTITY.fullmatch(before.strip()) is not None
        )
        if len(words) == 1 and units_spelt(field, before[-1:] + words) not in ([], named):
            meant = False  # umV
        elif len(words) == 1 and words.isalpha():
            of_quantity = _QUANTITY.search(before) or re.fullmatch(r"[a-z][ _]", before)
            meant = bool(before) and (fits or separated or bool(words in _LETTERS and of_quantity))
        elif words.lower() in _NOT_IN_NAMES:
            meant = words.lower() == "min" and (fits or separated)
        else:
            meant = bool(fits or before or words[0] != "u")
        if named and meant:
            how = Said.AS_UNIT if len(named) > 1 else Said.AS_VALUE
            return [Words(words, _NAME, how) if len(named) > 1 else Words(named[0], _NAME, how)]
        if before and counts_without_turn(words):
            return [Words(words, _NAME)]
    within = mentions(re.sub(r"[./-]|(?<=[a-zA-Z])(?=[A-Z][a-z])", " ", bare))
    sure = [mention.text for mention in within if mention.sure and mention.words]
    return [Words(text, _NAME, Said.AS_VALUE) for text in sure[:1]]


def _endings(name: str) -> Iterable[tuple[int, str]]:
    """Yield the ends of a name that may be a unit, the longest first, with where they begin."""
    if len(name) > _LONGEST_NAME:
        return
    starts = {0, *(m.start() for m in _ENDS.finditer(name))}
    starts |= {m.end() for m in _QUANTITY.finditer(name)}
    for start in sorted(starts):
        if name[start : start + 1].isalnum() or name[start : start + 1] in {"°", "%"}:
            yield start, re.sub(r"(?<=[a-z])(?=[A-Z][a-z])", " ", name[start:])


def is_unit(text: str) -> bool:
    """Whether a text is a unit of any column."""
    return bool(units_meant(text.strip("[](){} ")))


def units_spelt(name: str, text: str) -> list[str]:
    """Return the units that a text may mean: those of a key of `UNITS`, if any, else of others."""
    units = units_meant(text)
    fitting = [unit for unit in units if unit in UNITS[name] or unit.startswith("counts/")]
    return fitting or list(units)


def _factor_and_name(name: str, unit: object, source: object) -> tuple[float, str]:
    """Return the given factor, and the unit's name unless it is a number."""
    factor, known = 0.0, ""
    if isinstance(unit, Real) and not isinstance(unit, bool):
        factor = float(unit)
    elif isinstance(unit, str):
        minus = unit.strip().startswith("-")
        text = unit.strip().removeprefix("-")
        try:
            factor = float(text)
        except ValueError:
            counts = {count for count in units_meant(text) if count.startswith("counts/")}
            valid = UNITS[name].keys() | (counts if name == "angle" else set())
            spelt = [spelling for spelling in units_spelt(name, text) if spelling in valid]
            if len(spelt) > 1:
                raise InputError(source, f"units.{name}", unit, " or ".join(spelt)) from None
            known = "".join(spelt)
            factor = factor_of(known) if known else 0.0
        factor = -factor if minus else factor
    if not factor or not math.isfinite(factor):
        more = ["counts/4096 (counts per turn)"] if name == "angle" else []
        turned = ", with a minus if it counts the other way" if name in _TURNABLE else ""
        expected = f"one of {', '.join([*UNITS[name], *more])}, or a factor{turned}"
        raise InputError(source, f"units.{name}", unit, expected)
    if factor < 0.0:
        _require_turnable(source, name, unit)
    return factor, known


def _require_turnable(source: object, name: str, unit: object) -> None:
    if name not in _TURNABLE:
        expected = f"no minus: only {', '.join(_TURNABLE)} can be negated"
        raise InputError(source, f"units.{name}", unit, expected)
