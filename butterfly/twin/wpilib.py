"""Feedforward gains of WPILib as JSON: kS, kV, kA, kG of an arm, an elevator or a motor alone.

An arm's voltage is kS sgn(w) + kG cos(a) + kV w + kA w', its angle a from the horizontal: ours,
from hanging, less a quarter of a turn (and what its centre of mass is off).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

from butterfly.errors import InputError
from butterfly.files import json_text
from butterfly.logs.log import InputKind
from butterfly.model.parameters import JointKind
from butterfly.twin.forms import Options
from butterfly.twin.law import Law
from butterfly.twin.plain import left_out
from butterfly.twin.twin import Twin, Written


def as_wpilib(twin: Twin, options: Options) -> Written:  # noqa: ARG001 - every form takes them
    """Return the gains of a joint that a voltage drives, with their 95 % intervals."""
    if twin.kind is not InputKind.VOLTAGE:
        raise InputError("export", "input", str(twin.kind), "voltage (WPILib's gains are in V)")
    law, way = Law.of(twin), twin.joint.way
    slides, arm = twin.joint is JointKind.SLIDE, bool(math.hypot(*_moments(law.constants)))
    name = (
        "ArmFeedforward" if arm else "ElevatorFeedforward" if slides else "SimpleMotorFeedforward"
    )
    made: dict[str, tuple[str, Callable[[Any], float]]] = {
        "kS": ("V", lambda c: c.coulomb / c.p4),
        "kV": (f"V s/{way}", lambda c: c.p2 / c.p4),
        "kA": (f"V s²/{way}", lambda c: c.p1 / c.p4),
    }
    if name != "SimpleMotorFeedforward":
        made["kG"] = ("V", _arm_gravity if arm else _weight)
    gains: dict[str, Any] = {}
    for each, (unit, formula) in made.items():
        value, half = float(formula(law.constants)), law.half_width(formula)
        gains[each] = {"value": value, "lower": value - half, "upper": value + half, "unit": unit}
    notes = (*_about_angle(law, name), *left_out(twin, "A feedforward of WPILib"))
    content = {"name": twin.name, "class": name, "gains": gains, "notes": notes}
    said = "; ".join(
        f"{each} {row['value']:.5g} ± {row['value'] - row['lower']:.2g} {row['unit']}"
        for each, row in gains.items()
    )
    about = f"{name} of WPILib, with 95 % intervals"
    lines = (f"{said}.", *_about_angle(law, name))
    return Written(
        text=json_text(content),
        about=about,
        left_out=notes[len(lines) - 1 :],
        title="Gains",
        said=lines,
    )


def _moments(c: Any) -> tuple[float, float]:  # noqa: ANN401 - constants of a law
    return c.p3, c.p3_offset


def _arm_gravity(c: Any) -> float:  # noqa: ANN401
    return float(math.hypot(*_moments(c)) / c.p4)


def _weight(c: Any) -> float:  # noqa: ANN401
    return float(-c.bias / c.p4)


def _about_angle(law: Law, name: str) -> Iterator[str]:
    """Say where an arm's angle is 0."""
    if name == "ArmFeedforward":
        p3, offset = _moments(law.constants)
        quarter = math.pi / 2 - math.atan2(offset, p3)
        less = f"that of the logs less {quarter:.6g} rad"
        yield f"The arm's angle, 0 where it is horizontal, is {less}."
