"""Units and signs: of the columns of logs, and of the numbers that describe them.

A unit stands by its name (``deg``), as counts per turn (``counts/4096``) or as the factor that
makes it one of the project's own (``0.01745``). A minus in front turns the sign (``-deg``); alone,
as ``-`` or ``-1``, it turns the sign and leaves the unit to what the file gives.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from numbers import Real
from typing import Any

from numpy.typing import NDArray

from butterfly.errors import InputError, nearest

_TURN = 2 * math.pi
_LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}
_RATES = {"rad/s": 1.0, "deg/s": math.pi / 180, "rpm": _TURN / 60}

UNITS: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0},
    "input": {"V": 1.0, "mV": 1e-3, "A": 1.0, "mA": 1e-3}
    | {"Nm": 1.0, "mNm": 1e-3, "Ncm": 1e-2, "N": 1.0, "mN": 1e-3},
    "angle": {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180, "turns": _TURN, **_LENGTHS},
    "velocity": {**_RATES, "turns/s": _TURN, "m/s": 1.0, "mm/s": 1e-3},
    "omega": {**_RATES, "Hz": _TURN},
    "mass": {"kg": 1.0, "g": 1e-3},
    "arm": _LENGTHS,
}
"""Units of what has one, each with its factor: of the sampled columns, and of a log's sine
(``omega`` only: its amplitude is in the unit of the input), added mass and arm. A slide's angle is
a length."""

_TURNABLE = ("input", "angle", "velocity")
_COUNTS = re.compile(r"counts?/(\d+(?:\.\d+)?)")
_SPELT = {
    "deg": ("°", "degree", "degrees"),
    "rad": ("radian", "radians"),
    "turns": ("turn", "rev"),
    "deg/s": ("°/s",),
    "turns/s": ("rev/s",),
    "rpm": ("rev/min",),
    "s": ("sec", "second", "seconds"),
    "ms": ("msec",),
    "us": ("usec",),
    "V": ("v", "volt", "volts"),
    "Nm": ("N*m", "N·m"),
    "mNm": ("mN*m", "mN·m"),
    "Hz": ("hz",),
}
_NAMES = {other: name for name, others in _SPELT.items() for other in others}


@dataclass(frozen=True, kw_only=True)
class Units:
    """Factors to the project's own units."""

    factors: Mapping[str, float] = field(default_factory=dict)  # of keys of `UNITS`, else 1
    turned: frozenset[str] = frozenset()  # columns of which only the sign is given

    @classmethod
    def of(cls, units: Mapping[str, Any] | None, source: object = "units") -> Units:
        """Read the unit of each column, a text or a factor; refuse what is no column or no unit."""
        if units is not None and not isinstance(units, Mapping):
            raise InputError(source, "units", units, "a mapping such as {'angle': 'deg'}")
        factors, turned = {}, set()
        for name, unit in (units or {}).items():
            if name not in UNITS:
                raise InputError(source, f"units.{name}", "an unknown name", nearest(name, UNITS))
            if isinstance(unit, str | Real) and unit in ("-", "-1", -1):
                _require_turnable(source, name, unit)
                turned.add(name)
            else:
                factors[name] = factor_of(name, unit, source)
        return cls(factors=factors, turned=frozenset(turned))

    def factor(self, name: str) -> float:
        """Return what the numbers of a key of `UNITS` are multiplied by."""
        factor = self.factors.get(name, 1.0)
        return -factor if name in self.turned else factor

    def over(self, found: Mapping[str, float]) -> Units:
        """Return the units of a file that says some itself: what was given goes before."""
        return Units(factors={**found, **self.factors}, turned=self.turned)

    def with_sign(self, sign: int) -> Units:
        """Return them with the input turned as the sign says."""
        turned = self.turned if sign == 1 else self.turned ^ {"input"}
        return Units(factors=self.factors, turned=turned)

    def applied(self, columns: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
        """Return columns in the project's own units."""
        return {
            name: values if self.factor(name) == 1.0 else values * self.factor(name)
            for name, values in columns.items()
        }


AS_IS = Units()
"""All in the project's own units."""


def factor_of(name: str, unit: object, source: object = "units") -> float:
    """Return the factor of a unit, a number or a text, for a key of `UNITS`, or refuse it."""
    factor: float | None = None
    if isinstance(unit, Real) and not isinstance(unit, bool):
        factor = float(unit)
    elif isinstance(unit, str):
        minus = unit.strip().startswith("-")
        text = unit.strip()[1:] if minus else unit
        try:
            factor = float(text)
        except ValueError:
            factor = known_factor(name, text)
        factor = -factor if minus and factor else factor
    if not factor or not math.isfinite(factor):
        raise InputError(source, f"units.{name}", unit, _expected(name))
    if factor < 0.0:
        _require_turnable(source, name, unit)
    return factor


def known_factor(name: str, unit: str) -> float | None:
    """Return the factor of a unit by its name, as files give it; None if there is none of it."""
    text = "".join(unit.split()).replace("µ", "u").replace("μ", "u")
    counts = _COUNTS.fullmatch(text) if name == "angle" else None
    if counts is not None:
        return _TURN / float(counts[1]) if float(counts[1]) else None
    return UNITS[name].get(_NAMES.get(text, text))


def _require_turnable(source: object, name: str, unit: object) -> None:
    if name not in _TURNABLE:
        raise InputError(
            source, f"units.{name}", unit, f"no minus: only {', '.join(_TURNABLE)} turn"
        )


def _expected(name: str) -> str:
    more = ["counts/4096 (counts per turn)"] if name == "angle" else []
    minus = ", with a minus if it counts the other way" if name in _TURNABLE else ""
    return f"one of {', '.join([*UNITS[name], *more])}, or a factor{minus}"
