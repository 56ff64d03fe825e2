"""The words for units: symbols and names in any of the usual spellings."""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache

_TURN = 2 * math.pi

QUANTITIES: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0}
    | {"days": 86_400.0},
    "voltage": {"V": 1.0, "mV": 1e-3, "uV": 1e-6, "kV": 1e3, "MV": 1e6},
    "current": {"A": 1.0, "mA": 1e-3, "uA": 1e-6, "kA": 1e3, "MA": 1e6},
    "torque": {"Nm": 1.0, "mNm": 1e-3, "uNm": 1e-6, "Ncm": 1e-2, "kgf cm": 9.80665e-2}
    | {"kNm": 1e3, "MNm": 1e6},
    "force": {"N": 1.0, "mN": 1e-3, "kN": 1e3, "MN": 1e6},
    "share": {"duty": 1.0, "%": 1e-2},
    "angle": {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180, "mdeg": math.pi / 180e3}
    | {"arcmin": math.pi / 10_800, "arcsec": math.pi / 648e3, "gon": math.pi / 200}
    | {"turns": _TURN},
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6},
    "rate": {"rad/s": 1.0, "mrad/s": 1e-3, "deg/s": math.pi / 180, "rpm": _TURN / 60}
    | {"turns/s": _TURN},
    "speed": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3},
    "frequency": {"Hz": _TURN},
    "mass": {"kg": 1.0, "g": 1e-3},
}
"""Units by quantity, each with its factor to the first."""

_KINDS = {unit: quantity for quantity, units in QUANTITIES.items() for unit in units}

_PREFIXES = {"m": "milli", "u": "micro", "n": "nano", "c": "centi", "k": "kilo", "M": "mega"}
_NAMES = {
    "s": "sec second",
    "min": "minute",
    "h": "hr hour",
    "days": "day",
    "V": "volt",
    "A": "amp ampere",
    "N": "newton",
    "Nm": "newtonmeter newtonmetre",
    "rad": "radian",
    "deg": "degree arcdegree angulardegree",
    "arcmin": "arcminute",
    "arcsec": "arcsecond",
    "gon": "gradian",
    "turns": "turn rev revolution rotation",
    "m": "meter metre",
    "g": "gram gramme",
    "Hz": "hertz",
}  # without s
_ALSO = {
    "ms": "msec msecs millis",
    "us": "usec usecs micros",
    "ns": "nsec nsecs nanos",
    "mV": "mv",
    "mA": "ma",
    "mN": "mn",
    "mNm": "mnm Nmm",
    "kgf cm": "kgcm kgfcm",
    "days": "datenum daynumber serialdate exceldate excelserialdate matlabdatenum",
    "%": "percent pct",
    "deg": "°",
    "deg/s": "dps",
    "turns/s": "rps",
    "rpm": "r/min U/min tr/min 1/min /min",
}  # ambiguous without case (mv, ma), the usual unit
_PRODUCTS = {(f"{p}N", "m"): f"{p}Nm" for p in ("", "m", "u", "k", "M")}
_PRODUCTS |= {("N", "cm"): "Ncm", ("N", "mm"): "mNm", ("turns", "min"): "rpm"}
_PRODUCTS |= {(of, "cm"): "kgf cm" for of in ("kgf", "kg")}
_PRODUCTS |= {(of, "%"): "%" for of in ("duty", "pwm")}
_PRODUCTS |= {(of, "s"): f"{of}/s" for of in ("rad", "mrad", "deg", "turns", "m", "cm", "mm")}

_PARTS = ("kgf", "uN", "pwm")  # of units, themselves none

_SAME = str.maketrans("º˚−–⋅·×∙【】〔〕", "°°--****[][]")
_WORDS_OF_PREFIX = "|".join(_PREFIXES.values())
_COUNTED = r"(?:counts?|ticks?|increments?|inc|steps?|pulses?)"
_NUMBER_OF_COUNTS = re.compile(
    rf"{_COUNTED}/(\d+(?:\.\d+)?)|(\d+(?:\.\d+)?){_COUNTED}(?:/|per)(?:turns?|rev|revolution)"
)
_UNKNOWN_COUNTS = re.compile(r"(?:encoder |adc )?(?:counts?|ticks?|cts?|lsbs?)")
_LONGEST = 60  # characters of a unit

_BREAKS, _BRACKETS = ",;|\t", "()[]{}"
_MARKS = f'{_BREAKS}{_BRACKETS}:="<>«»‹›“”'
_TOKEN = re.compile(rf"[{re.escape(_MARKS)}]|[^\s_{re.escape(_MARKS)}]+")
_NUMBER = re.compile(r"[~\u00b1<>\u2264\u2265+-]*\d[\d.,]*(?:e[+-]?\d+)?", re.IGNORECASE)
_PER_DIGIT = re.compile(
    r"(?i)[\d.,]*\s*\b([a-z]+)\s*(?:/|per)\s*(?:digit|count|bit|lsb|tick|increment|unit)\b"
)
_WORDS = 3  # of a unit, at most
_IDIOMS = {"turn", "second"}  # in turn
_OF_KEYS = {("unit",), ("units",), ("Unit",), ("Units",)}


def plain_text(text: str) -> str:
    """Return a text with one character for each of the many that look alike."""
    same = unicodedata.normalize("NFKC", text.translate(_SAME))
    return same.translate(_SAME).replace("µ", "u").replace("μ", "u")


@lru_cache(4096)
def units_meant(text: str) -> tuple[str, ...]:
    """Return the units that a text may mean, spelt so, else in any case: Mv may be mV or MV."""
    plain = plain_text(text[: _LONGEST + 1]).strip(" \t\"'.,;:!")
    if not plain or len(plain) > _LONGEST:
        return ()
    joined = "".join(plain.lower().split())
    if counts := _NUMBER_OF_COUNTS.fullmatch(joined):
        number = counts[1] or counts[2]
        return (f"counts/{number}",) if 0 < float(number) < math.inf else ()
    plain = re.split(r"\ssince\s", plain.replace("_", " "), maxsplit=1)[0]  # time in netCDF
    plain = re.sub(rf"(?i)\b({_WORDS_OF_PREFIX}|arc|angular)[\s-]+(?=[a-z])", r"\1", plain)
    plain = re.sub(r"(?i)([a-z°])\s*(?:\*\*|\^)?\s*\(?-1(?:\.0)?\)?(?!\d)", r"\1 -1", plain)
    plain = re.sub(r"(?:^|[\s*.]+)([a-zA-Z]+) -1", r"/\1", plain)  # s^-1
    plain = re.sub(r"(?i)\bper\b", "/", plain)
    plain = re.sub(r"(?i)\bduty[\s-]*cycle\b", "duty", plain)
    units = _looked_up(plain, exact=True) or _looked_up(plain, exact=False)
    return tuple(unit for unit in units if unit not in _PARTS)


def _looked_up(text: str, *, exact: bool) -> tuple[str, ...]:
    known, fold = _spellings(exact=exact), str if exact else str.lower
    parts = [re.split(r"[\s*.-]+", part.strip(" *.()")) for part in text.split("/")]
    whole = fold("/".join("".join(part) for part in parts))
    tokens = [token for part in parts for token in part if token not in {"", "1"}]
    if len(tokens) == 2:  # noqa: PLR2004 - a product or a quotient
        first, second = (known.get(fold(token), ()) for token in tokens)
        pairs = [(one, two) for one in first for two in second]
        pairs += [] if len(parts) > 1 else [(two, one) for one, two in pairs]
        if products := [_PRODUCTS[pair] for pair in pairs if pair in _PRODUCTS]:
            return tuple(dict.fromkeys(products))
        if len(parts) > 1 and whole not in known:
            return ()
    return known.get(whole, ())


@cache
def _spellings(*, exact: bool) -> dict[str, tuple[str, ...]]:
    """Return the units of each spelling, of lower-case ones unless ``exact``."""
    spellings: dict[str, dict[str, None]] = {}
    for unit, spelt in _spelt():
        spellings.setdefault(spelt if exact else spelt.lower(), {})[unit] = None
    return {spelt: tuple(units) for spelt, units in spellings.items()}


def _spelt() -> Iterable[tuple[str, str]]:
    """Yield each unit, and parts of units, with each of its spellings."""
    parts = [*_KINDS, *_PARTS]
    for unit in parts:
        yield unit, unit.replace(" ", "")
        yield from ((unit, spelling) for spelling in _ALSO.get(unit, "").split())
    for base, words in _NAMES.items():
        names = [noun + s for noun in words.split() for s in ("", "s")]
        yield from ((base, name) for name in [*names, base])
        for prefix, word in _PREFIXES.items():
            if prefix + base in parts:
                yield from ((prefix + base, word + name) for name in [*names, base])


def counts_without_turn(text: str) -> bool:
    """Whether a text means counts of an encoder or converter, of unknown size."""
    return _UNKNOWN_COUNTS.fullmatch(plain_text(text).strip().lower()) is not None


def factor_of(unit: str) -> float:
    """Return the factor of a unit named as by `units_meant`."""
    if unit.startswith("counts/"):
        return _TURN / float(unit.removeprefix("counts/"))
    return QUANTITIES[_KINDS[unit]][unit]


def quantity_of(unit: str) -> str:
    """Return the quantity of a unit, a key of `QUANTITIES`."""
    return "angle" if unit.startswith("counts/") else _KINDS[unit]


@dataclass(frozen=True)
class Mention:
    """A unit within a text: its words, and the tokens before and after it in its clause."""

    text: str
    before: tuple[str, ...]
    after: tuple[str, ...]
    bracket: str  # opening bracket that it is in, without other words; "" if none
    rest: tuple[str, ...]  # all other tokens of the text
    of_one: bool  # whether it is what 1, or a digit, is worth

    @cached_property
    def words(self) -> list[str]:
        """The words around it, in lower case."""
        tokens = (token.lower().strip(".'") for token in (*self.before, *self.after))
        return [token for token in tokens if any(map(str.isalnum, token))]

    @property
    def sure(self) -> bool:
        """Whether nothing else is spelt so: mV or volts, but not A, %, ma or duty."""
        letters = [letter for letter in self.text if letter.isalpha()]
        mixed = any(map(str.isupper, letters)) and any(map(str.islower, letters))
        long = len(letters) > len("amp") and self.text.lower() != "duty"
        return mixed or long or (bool(letters) and "%" in self.text)

    @property
    def marked(self) -> bool:
        """Whether it is marked as a value: by a bracket, a colon, or ``in`` before it."""
        plural = (self.bracket, self.text) == ("(", "s")  # the angle(s)
        return not plural and (self.within or self.before[-1:] in {(mark,) for mark in "([{:="})

    @property
    def within(self) -> bool:
        """Whether ``in`` stands before it, but not as in words: in turn, in s:/logs."""
        of_words = self.text in _IDIOMS or self.after[:1] == (":",)
        return self.before[-1:] == ("in",) and not of_words

    @property
    def named_alone(self) -> bool:
        """Whether it is a text of its own, and more than a letter."""
        return len(self.text) > 1 and not any(map(str.isalnum, "".join(self.rest)))

    @property
    def of_list(self) -> bool:
        """Whether its spelling, or another unit or number in the text, makes a list likely."""
        return self.sure or any(is_value(token) or units_meant(token) for token in self.rest)

    @property
    def meant(self) -> bool:
        """Whether a text about a column means it: in brackets, after ``in``, or alone."""
        of_key = self.before[-1:] in {(":",), ("=",)} and self.before[-2:-1] in _OF_KEYS
        return bool(self.bracket) or self.within or of_key or not self.words


@lru_cache(4096)
def mentions(text: str) -> tuple[Mention, ...]:
    """Return the units within a text, but not those of a value (24 V) or part of others (mV/A)."""
    plain = _PER_DIGIT.sub(r"1 \1", plain_text(text))
    return tuple(_mentions(_TOKEN.findall(plain)))


def is_value(token: str) -> bool:
    """Whether a token of a text is a number."""
    return _NUMBER.fullmatch(token) is not None


def _mentions(tokens: Sequence[str]) -> Iterator[Mention]:
    first, begin = 0, 0
    while first < len(tokens):
        begin = first if tokens[first] in _BREAKS else begin
        ends = range(min(first + _WORDS, len(tokens)), first, -1)
        end = next((stop for stop in ends if _is_unit(tokens[first:stop])), 0)
        numbered = first == 1 and end == len(tokens) and tokens[0].isdecimal()  # a column
        of_one = tokens[first - 1 : first] == ["1"] and not numbered
        value = first and is_value(tokens[first - 1]) and not numbered and not of_one
        if end and not value and not _joined(tokens, first, end):
            marks = [token for token in tokens[:first] if token in _BRACKETS]
            neighbours = {*tokens[max(first - 1, 0) : first], *tokens[end : end + 1]}
            within = marks and marks[-1] in "([{" and neighbours <= {*_MARKS}
            until = next((k for k in range(end, len(tokens)) if tokens[k] in _BREAKS), len(tokens))
            yield Mention(
                text=" ".join(tokens[first:end]),
                before=tuple(tokens[begin:first]),
                after=tuple(tokens[end:until]),
                bracket=marks[-1] if within else "",
                rest=(*tokens[:first], *tokens[end:]),
                of_one=of_one,
            )
        first = max(end, first + 1)


def _is_unit(tokens: Sequence[str]) -> bool:
    ends = (tokens[0], tokens[-1])
    words = all(any(c.isalnum() or c in "%°" for c in token) for token in ends)
    return words and not {*tokens} & {*_MARKS} and bool(units_meant(" ".join(tokens)))


def _joined(tokens: Sequence[str], first: int, end: int) -> bool:
    """Whether a unit is part of a product or quotient, as no unit per a name is."""
    pairs = [tokens[max(first - 2, 0) : first][::-1], tokens[end : end + 2]]
    joined = [pair for pair in pairs if pair and pair[0] in {*"/*-", "per"}]
    return any(mark == "per" or (bool(other) and _is_unit(other)) for mark, *other in joined)
