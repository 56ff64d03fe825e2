"""Cells, FIT, counts and fields of an experiment as a person would write them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import PurePath
from typing import Any

from butterfly.model.terms import TERMS

_SIGNIFICANT, _WHOLE = 4, 1e6  # digits of a number; up to here whole ones have all of theirs
_FAR_OFF = -1000.0  # FIT in per cent, below which there is no more to know
_OF_FIELDS = {
    "": "amplitude",  # of the input, or an angle
    "1/turn": "steps",
    "H": "inductance",
    "N m s/rad": "viscous",
    "N m/A": "torque_constant",
    "N m/unit": "gain",
    "V s/rad": "back_emf_constant",
    "kg": "mass",
    "kg m²": "inertia rotor_inertia",
    "m": "arm com_distance com_offset",
    "rad": "backlash noise tilt",
    "rad/s": "bandwidth omega velocity",
    "s": "duration half_width horizon jitter step time_constant window",
    "Ω": "resistance",
}
_UNITS = {term.name: term.unit for term in TERMS.values()} | {
    name: unit for unit, names in _OF_FIELDS.items() for name in names.split()
}


def cell_text(value: object) -> str:
    """Return a cell formatted for reading."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float) and value.is_integer() and abs(value) < _WHOLE:
        return f"{value:.0f}"
    return f"{value:.{_SIGNIFICANT}g}" if isinstance(value, float) else str(value)


def fit_text(fit: float | None) -> str:
    """Return a FIT in per cent; a dash if it is unknown."""
    if fit is None or math.isnan(fit):
        return "–"
    return f"{fit:.1f}" if fit > _FAR_OFF else f"less than {_FAR_OFF:.0f}"


def label_of(row: Mapping[str, Any]) -> str:
    """Return the short name of a row's log (see `Log.label`)."""
    mass, omega = row["added mass in kg"], row["frequency in rad/s"]
    name = PurePath(row["log"]).name if omega is None else f"{omega:g} rad/s"
    return f"{1e3 * mass:g} g, {name}"


def is_relative(row: Mapping[str, Any]) -> bool:
    """Whether a row's change is given in per cent: its parameter is clearly not 0."""
    return row["change in %"] is not None and math.isfinite(row["change in %"])


def times_text(times: float) -> str:
    """Return how many times as large something is, without decimals from ten on."""
    return f"{times:.1f}" if times < 10 else f"{times:.0f}"  # noqa: PLR2004 - two digits


def percent(share: float) -> str:
    """Return a share in per cent with two digits."""
    return f"{float(f'{100 * share:.2g}'):g} %"


def upwards(share: float) -> str:
    """Return a share in per cent with two digits, rounded up, as a limit has to be."""
    return f"{limit_text(100 * share)} %"


def limit_text(limit: float) -> str:
    """Return a limit of a size with two digits, rounded up."""
    least = limit * (1 - 1e-9)
    digit = 10.0 ** (math.floor(math.log10(least)) - 1) if least > 0 else 1.0
    return f"{math.ceil(least / digit) * digit:.4g}"


def counted(number: float, thing: str) -> str:
    """Return a number of things."""
    return f"{number:.0f} {thing}{'' if number == 1 else 's'}"


def with_error(value: float, error: float) -> str:
    """Write ``value`` to the second digit of its standard error, or to five digits without one."""
    if not math.isfinite(value):
        return "–"
    if not (math.isfinite(error) and error > 0):
        return f"{value:.5g}"
    if abs(value) < error / 10:
        return f"{value:.1g}"
    digits = math.floor(math.log10(abs(value))) - math.floor(math.log10(error)) + 2
    return f"{value:#.{max(digits, 2)}g}".rstrip(".")


def interval(lower: float, upper: float) -> str:
    """Write an interval to the second digit of a quarter of its width; a dash if there is none."""
    if not (math.isfinite(lower) and math.isfinite(upper)):
        return "–"
    error = (upper - lower) / 4
    return f"[{with_error(lower, error)}, {with_error(upper, error)}]"


def field_name(path: str) -> str:
    """Return the name of a field or column in words: ``plant.encoder.noise`` is *encoder noise*."""
    return path.removeprefix("plant.").replace(".", " ").replace("_", " ")


def field_unit(path: str) -> str:
    """Return the unit of a field or column; nothing where it has none, or it depends."""
    if path == "deviation":
        return "share of true"
    if path.startswith(("fit_", "held_out_", "holdout_")):
        return "%"
    if path.startswith("orbit_") and path not in {"orbit_rounds", "orbit_differing"}:
        return "rad/s" if path.endswith("speed") else "rad"
    _, dot, name = path.rpartition(".")
    return _UNITS.get(name, "") if dot else ""


def field_label(path: str) -> str:
    """Return `field_name` of a field, with its unit if it has one."""
    unit = field_unit(path)
    return f"{field_name(path)} in {unit}" if unit else field_name(path)
