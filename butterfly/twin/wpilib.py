"""Feedforward gains of WPILib as JSON: kS, kV, kA, kG of an arm, an elevator or a motor alone.

An arm's voltage is kS sgn(w) + kG cos(a) + kV w + kA w', its angle a from the horizontal: ours,
from hanging, less a quarter of a turn (and what its centre of mass is off).
"""

from __future__ import annotations

import math
from typing import Any

from butterfly.errors import InputError
from butterfly.files import json_text
from butterfly.logs.log import InputKind
from butterfly.model.parameters import JointKind
from butterfly.twin.compensation_law import CompensationLaw
from butterfly.twin.forms import Options
from butterfly.twin.plain import left_out
from butterfly.twin.twin import Twin, Written


def as_wpilib(twin: Twin, options: Options) -> Written:  # noqa: ARG001 - every form takes them
    """Return the gains of a joint that a voltage drives, with their 95 % intervals."""
    if twin.kind is not InputKind.VOLTAGE:
        raise InputError("export", "input", str(twin.kind), "voltage (WPILib's gains are in V)")
    law, way, name, said = CompensationLaw.of(twin), twin.joint.way, "SimpleMotorFeedforward", []
    made: dict[str, tuple[str, Any]] = {
        "kS": ("V", lambda c: c.coulomb / c.p4),
        "kV": (f"V s/{way}", lambda c: c.p2 / c.p4),
        "kA": (f"V s²/{way}", lambda c: c.p1 / c.p4),
    }
    p3, offset = law.numbers["p3"], law.numbers["p3_offset"]
    if p3 or offset:
        name = "ArmFeedforward"
        made["kG"] = ("V", lambda c: math.hypot(c.p3, c.p3_offset) / c.p4)
        quarter = math.pi / 2 - math.atan2(offset, p3)
        said = [f"An arm's angle, 0 at the horizontal, is that of the logs less {quarter:.6g} rad."]
    elif twin.joint is JointKind.SLIDE:
        name = "ElevatorFeedforward"
        made["kG"] = ("V", lambda c: -c.bias / c.p4)
    gains: dict[str, Any] = {}
    for each, (unit, formula) in made.items():
        value, half = formula(law.constants), law.half_width(formula)
        gains[each] = {"value": value, "lower": value - half, "upper": value + half, "unit": unit}
        said.insert(len(gains) - 1, f"{each} {value:.5g} ± {half:.2g} {unit}.")
    missing = tuple(left_out(twin, "A feedforward of WPILib"))
    notes = [*said[len(gains) :], *missing]
    return Written(
        text=json_text({"name": twin.name, "class": name, "gains": gains, "notes": notes}),
        about=f"{name} of WPILib, with 95 % intervals",
        left_out=missing,
        title="Gains",
        said=tuple(said),
    )
