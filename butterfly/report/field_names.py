"""Fields of an experiment, and columns of its tables, named as a header names them."""

from __future__ import annotations

from butterfly.model.terms import TERMS

_UNITS = {term.name: term.unit for term in TERMS.values()} | {
    "amplitude": "",  # of the input, or an angle
    "arm": "m",
    "back_emf_constant": "V s/rad",
    "backlash": "rad",
    "bandwidth": "rad/s",
    "com_distance": "m",
    "com_offset": "m",
    "duration": "s",
    "gain": "N m/unit",
    "half_width": "s",
    "horizon": "s",
    "inductance": "H",
    "inertia": "kg m²",
    "jitter": "s",
    "mass": "kg",
    "noise": "rad",
    "omega": "rad/s",
    "resistance": "Ω",
    "rotor_inertia": "kg m²",
    "step": "s",
    "steps": "1/turn",
    "tilt": "rad",
    "time_constant": "s",
    "torque_constant": "N m/A",
    "velocity": "rad/s",
    "viscous": "N m s/rad",
    "window": "s",
}
_ROOT = "plant"


def said_name(path: str) -> str:
    """Return the name of a field or column in words: ``plant.encoder.noise`` is *encoder noise*."""
    return path.removeprefix(f"{_ROOT}.").replace(".", " ").replace("_", " ")


def unit_of_field(path: str) -> str:
    """Return the unit of a field's values; nothing where it has none, or it depends."""
    _, dot, name = path.rpartition(".")
    return _UNITS.get(name, "") if dot else ""


def said_field(path: str) -> str:
    """Return `said_name` of a field, with its unit if it has one."""
    unit = unit_of_field(path)
    return f"{said_name(path)}, {unit}" if unit else said_name(path)
