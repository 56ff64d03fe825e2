"""Units and signs of the columns of logs, and of the numbers that describe them.

A unit is a name (``deg``), counts per turn (``counts/4096``) or the factor to the project's own
unit (``0.01745``). A leading minus negates the column (``-deg``); ``-`` or ``-1`` alone negates it
and keeps the unit of the file.

`read_unit` is the one rule for the unit of a column, whatever its source.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from numbers import Real
from typing import Any

from butterfly.errors import InputError, nearest

_TURN = 2 * math.pi

QUANTITIES: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0},
    "voltage": {"V": 1.0, "mV": 1e-3, "uV": 1e-6, "kV": 1e3, "MV": 1e6},
    "current": {"A": 1.0, "mA": 1e-3, "MA": 1e6},
    "torque": {"Nm": 1.0, "mNm": 1e-3, "Ncm": 1e-2, "kgf cm": 9.80665e-2, "MNm": 1e6},
    "force": {"N": 1.0, "mN": 1e-3, "MN": 1e6},
    "share": {"%": 1e-2},
    "angle": {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180, "mdeg": math.pi / 180e3}
    | {"arcmin": math.pi / 10_800, "arcsec": math.pi / 648e3, "gon": math.pi / 200}
    | {"turns": _TURN},
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6},
    "rate": {"rad/s": 1.0, "deg/s": math.pi / 180, "rpm": _TURN / 60, "turns/s": _TURN},
    "speed": {"m/s": 1.0, "mm/s": 1e-3},
    "frequency": {"Hz": _TURN},
    "mass": {"kg": 1.0, "g": 1e-3},
}
"""Units by quantity, each with its factor to the first."""

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
    name: {unit: factor for each in kinds for unit, factor in QUANTITIES[each].items()}
    for name, kinds in _HOLDS.items()
}
"""Units, each with its factor, of the sampled columns and of a log's ``omega``, added mass and arm
(an amplitude has the unit of the input). A slide's angle is a length."""

ASSUMED, GIVEN = "assumed", "given"
"""Source of a unit that is not in the file: the default, or an option or the manifest."""

_TURNABLE = ("input", "angle", "velocity", "setpoint")
_SPELT = {
    "s": "sec secs second seconds",
    "ms": "msec millisecond milliseconds",
    "us": "usec microsecond microseconds",
    "ns": "nsec nanosecond nanoseconds",
    "min": "mins minute minutes",
    "h": "hr hrs hour hours",
    "V": "volt volts",
    "mV": "mv millivolt millivolts",
    "uV": "microvolt microvolts",
    "kV": "kilovolt kilovolts",
    "A": "amp amps ampere amperes",
    "mA": "ma milliamp milliamps milliampere milliamperes",
    "Nm": "newtonmeter newtonmeters newtonmetre newtonmetres",
    "mNm": "mnm",
    "kgf cm": "kgcm",
    "N": "newton newtons",
    "mN": "mn",
    "%": "percent pct",
    "rad": "radian radians",
    "deg": "° º degree degrees",
    "mdeg": "millidegree millidegrees",
    "arcmin": "arcminute arcminutes",
    "arcsec": "arcsecond arcseconds",
    "turns": "turn rev revs revolution revolutions",
    "m": "meter meters metre metres",
    "cm": "centimeter centimeters centimetre centimetres",
    "mm": "millimeter millimeters millimetre millimetres",
    "rad/s": "rad/sec radian/s radians/s",
    "deg/s": "°/s º/s deg/sec degree/s degrees/s dps",
    "turns/s": "turn/s rev/s rps",
    "rpm": "rev/min r/min 1/min",
    "Hz": "hertz",
    "kg": "kilogram kilograms",
    "g": "gram grams",
}
"""Other spellings; ambiguous without case (mv, ma), the usual unit."""

_JOINTS = re.compile(r"\s+|(?<=\w)[·⋅*.-](?=[^\W\d])")  # between the parts of N m, N*m, N-m
_NUMBER_OF_COUNTS = re.compile(
    r"(?:counts?|ticks?|increments?|inc|steps?|pulses?)/(\d+(?:\.\d+)?)"
    r"|(\d+(?:\.\d+)?)(?:counts?|ticks?|increments?|inc|steps?|pulses?)"
    r"(?:/|per)(?:turns?|rev|revolution)"
)
_BRACKETS = re.compile(r"[\[(]([^\[\]()]*)[\])]")
_SILENT = {"", "-"}


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

    def factor(self, name: str, found: float = 1.0) -> float:
        """Return the factor of a key of `UNITS`; ``found`` is that of the file."""
        factor = self.factors.get(name, found)
        return -factor if name in self.turned else factor

    def with_sign(self, sign: int) -> Units:
        """Return the units with the input negated if the sign is -1."""
        turned = self.turned if sign == 1 else self.turned ^ {"input"}
        return Units(factors=self.factors, names=self.names, turned=turned)


AS_IS = Units()
"""The project's own units."""


@dataclass(frozen=True, kw_only=True)
class Heading:
    """Name, number and units of a column in its file."""

    name: str
    number: int | None = None  # from 0; None for a variable
    said: Mapping[str, str] = field(default_factory=dict)  # its unit, by place except the name


@dataclass(frozen=True, kw_only=True)
class ColumnReading:
    """The source of a column of a log, and its unit."""

    name: str
    number: int | None
    unit: str
    said: str  # source of the unit: "name", another place in the file, `GIVEN` or `ASSUMED`
    factor: float  # to the project's own unit, negative if negated

    @property
    def own(self) -> bool:
        """Whether the file gives a unit other than the project's own."""
        return self.said not in {ASSUMED, GIVEN} and abs(self.factor) != 1.0

    @property
    def text(self) -> str:
        """Description of the column."""
        which = f'"{self.name}"' if self.name else "without a name"
        which = which if self.number is None else f"column {self.number} {which}"
        how = [] if self.said == "name" else [self.said]
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
        unit, said, factor = f"times {abs(units.factors[field]):g}", GIVEN, 1.0
    else:
        unit, said = _unit_and_place(source, field, heading, given, fitting)
        factor = factor_of(field, unit)
    factor = units.factor(field, factor)
    name, number = heading.name, heading.number
    return ColumnReading(name=name, number=number, unit=unit, said=said, factor=factor)


def _unit_and_place(
    source: object, field: str, heading: Heading, given: str | None, fitting: Sequence[str]
) -> tuple[str, str]:
    where = heading.name or f"column {heading.number}"
    option = f"--units {field}=... or units: in the manifest"
    fits = [unit for each in fitting for unit in QUANTITIES[each]]
    fits += ["counts/4096 (counts per turn)"] if "angle" in fitting else []
    known: dict[str, str] = {}
    own = words_in(heading.name) or _ending(field, heading.name)
    for place, texts in {"name": own, **_listed(heading.said)}.items():
        named = [units_spelt(field, text) for text in texts]
        found = {each[0]: place for each in named if len(each) == 1}
        if texts and not found and given is None:
            expected = " or ".join(named[0]) or f"one of {', '.join(fits)}, or a factor"
            raise InputError(
                source, where, f"the unit {texts[0]!r} of {field}", f"{expected} ({option})"
            )
        known = {**known, **{unit: each for unit, each in found.items() if unit not in known}}
    if given is not None:
        known.setdefault(given, GIVEN)
    if len({factor_of(field, unit) for unit in known}) > 1:
        both = " and ".join(f"{unit} ({place})" for unit, place in known.items())
        factor = factor_of(field, given or next(iter(known)))
        expected = f"one unit, or a factor, which overrides both: --units {field}={factor:.9g}"
        raise InputError(source, where, f"the units {both} of {field}", expected)
    if not known:
        return fits[0], ASSUMED
    ((unit, said), *_) = known.items()
    if unit not in fits and not (unit.startswith("counts/") and "angle" in fitting):
        expected = f"a unit of {' or '.join(fitting)}: {', '.join(fits)}, or a factor ({option})"
        raise InputError(source, where, f"the unit {unit} of {field} ({said})", expected)
    return unit, said


def _listed(said: Mapping[str, str]) -> dict[str, list[str]]:
    texts = {place: text.strip("[]() ") for place, text in said.items()}
    return {place: [text] for place, text in texts.items() if text not in _SILENT}


def words_in(name: str) -> list[str]:
    """Return the texts in brackets in a column's name, except an index: q[0]."""
    texts = (text.strip() for text in _BRACKETS.findall(name))
    return [text for text in texts if text not in _SILENT and not text.isdecimal()]


def _ending(field: str, name: str) -> list[str]:
    """Return the unit of more than a letter that ends a name (angle_deg) or is the name (ms)."""
    last = re.split(r"[_\s]", name)[-1]
    return [last] if len(last) > 1 and last in UNITS[field] else []


def without_unit(name: str) -> str:
    """Return a column's name without brackets, except those of an index."""
    bare = _BRACKETS.sub(lambda each: each[0] if each[1].strip().isdecimal() else " ", name)
    return " ".join(bare.split())


def units_spelt(name: str, text: str) -> list[str]:
    """Return the units of a key of `UNITS` that a text may mean: usually one, none if unknown.

    The exact spelling takes precedence, then case is ignored: Mv may be mV or MV.
    """
    plain = _JOINTS.sub("", text.strip().replace("µ", "u").replace("μ", "u"))
    counts = _NUMBER_OF_COUNTS.fullmatch(plain.lower()) if name == "angle" else None
    if counts is not None:
        number = counts[1] or counts[2]
        return [f"counts/{number}"] if 0 < float(number) < math.inf else []
    exact = {spelt: unit for unit in UNITS[name] for spelt in _spellings(unit)}
    if plain in exact:
        return [exact[plain]]
    same = (unit for spelt, unit in exact.items() if spelt.lower() == plain.lower())
    return list(dict.fromkeys(same))


def _spellings(unit: str) -> list[str]:
    return [unit.replace(" ", ""), *_SPELT.get(unit, "").split()]


def factor_of(name: str, unit: str) -> float:
    """Return the factor of a unit named as by `units_spelt`."""
    if unit.startswith("counts/"):
        return _TURN / float(unit.removeprefix("counts/"))
    return UNITS[name][unit]


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
            spelt = units_spelt(name, text)
            if len(spelt) > 1:
                raise InputError(source, f"units.{name}", unit, " or ".join(spelt)) from None
            known = "".join(spelt)
            factor = factor_of(name, known) if known else 0.0
        factor = -factor if minus else factor
    if not factor or not math.isfinite(factor):
        raise InputError(source, f"units.{name}", unit, _expected(name))
    if factor < 0.0:
        _require_turnable(source, name, unit)
    return factor, known


def _require_turnable(source: object, name: str, unit: object) -> None:
    if name not in _TURNABLE:
        raise InputError(
            source, f"units.{name}", unit, f"no minus: only {', '.join(_TURNABLE)} can be negated"
        )


def _expected(name: str) -> str:
    more = ["counts/4096 (counts per turn)"] if name == "angle" else []
    minus = ", with a minus if it counts the other way" if name in _TURNABLE else ""
    return f"one of {', '.join([*UNITS[name], *more])}, or a factor{minus}"
