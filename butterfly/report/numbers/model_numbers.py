"""A robot as numbers for programs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from butterfly.document import Told
from butterfly.identification.parameter import unit_of
from butterfly.logs.log import InputKind
from butterfly.model.linear import resonance_frequency
from butterfly.model.parameters import AddedMass
from butterfly.model.terms import TERMS
from butterfly.plant.robot import Robot
from butterfly.report.numbers.estimate_numbers import lumped_numbers
from butterfly.verdict import Verdict

_UNITS = {
    "hand": {
        "mass": "kg",
        "com_distance": "m",
        "com_offset": "m",
        "inertia": "kg m²",
        "tilt": "rad",
    },
    "drive": {
        "resistance": "Ohm",
        "torque_constant": "N m/A",
        "back_emf_constant": "V s/rad",
        "inductance": "H",
        "gain": "N m/unit",
    },
    "clutch": {"backlash": "rad", "rotor_inertia": "kg m²"},
}


def told_model(
    name: str,
    robot: Robot,
    carried: AddedMass,
    kind: InputKind,
    *,
    verdict: Verdict | None = None,
    besides: Mapping[str, Any],
) -> Told:
    """Tell the robot of an experiment, or the identified twin of data.

    `verdict`: On the estimate that it rests on; None if it rests on none; `besides`: What else is
    to be said of that estimate.
    """
    loaded = robot.lumped.with_added_mass(carried)
    units = {each: unit_of(each, kind) for each in TERMS}
    parts = {part: getattr(robot, part) for part in ("hand", "drive", "friction", "clutch")}
    return Told(
        kind="model",
        title=f"The robot of {name!r}",
        verdict=verdict,
        summary=() if verdict is None else (verdict.sentence,),
        content={
            "data": {"name": name, "input": str(kind)},
            **besides,
            "carried": {"mass": carried.mass, "arm": carried.arm},
            **{part: each and _numbers(part, asdict(each), units) for part, each in parts.items()},
            "loaded": lumped_numbers(loaded, input_kind=kind),
            "resonance": resonance_frequency(loaded),
        },
        units={"resonance": "rad/s", "carried.mass": "kg", "carried.arm": "m"},
    )


def _numbers(
    part: str, values: Mapping[str, float], of_terms: Mapping[str, str]
) -> dict[str, dict[str, Any]]:
    units = _UNITS.get(part) or {**of_terms, "viscous": of_terms["p2"]}
    return {name: {"value": value, "unit": units[name]} for name, value in values.items()}
