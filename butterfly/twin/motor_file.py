"""The motor of an identified joint as a file of the library: what it takes to another joint.

What the logs cannot say (name, maker, conditions, source) is left empty, and refused by
`butterfly.logs.motors` until it is filled in.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from butterfly import __version__
from butterfly.errors import InputError
from butterfly.identification.estimate import Estimate
from butterfly.identification.identified import Identified
from butterfly.identification.trust import Parameter
from butterfly.logs.log import InputKind
from butterfly.logs.manifest import Manifest
from butterfly.logs.motors import MotorSource
from butterfly.model.parameters import JointKind
from butterfly.model.terms import TERMS
from butterfly.yaml_files import yaml_text

_FIT = "butterfly identify manifest.yaml"
_DIGITS = 4
_ASKED = ("supply", "temperature", "load", "sampling")


def motor_draft(identified: Identified) -> str:
    """Return the file of a type of motor, of which that of an identified joint was measured.

    InputError if the result is not to be used, or says nothing that a motor takes along.
    """
    estimate, origin = identified.estimate, identified.origin
    if not estimate.level.usable:
        expected = "good, or use with care: nobody should use such values"
        raise InputError("library", "verdict", estimate.level.verdict, expected)
    kind = InputKind(origin["input"])
    if kind is InputKind.NONE or estimate.joint is not JointKind.HINGE or estimate.ratios:
        what = "free decays" if kind is InputKind.NONE else "a slide"
        what = "ratios to p1" if estimate.ratios else what
        raise InputError("library", "result", what, "a driven hinge, on an absolute scale")
    known, rig = measured_values(estimate)
    if not known:
        expected = "an interval without 0 of p4, friction, ..."
        raise InputError("library", "result", "nothing that a motor takes along", expected)
    manifest = _plain(origin["manifest"]) if origin["manifest"] else {}
    law = manifest.get("loop", {}).get("law")
    return yaml_text(
        {
            "name": "",
            "maker": "",
            "drive": str(kind),
            **({} if law is None else {"law": law}),
            "motors": [
                {
                    "verdict": estimate.level.verdict,
                    "conditions": dict.fromkeys(_ASKED, ""),
                    "known": known,
                    "rig": rig,
                    "notes": [],
                    "source": dict.fromkeys(MotorSource.model_fields, ""),
                    "made": {"command": _FIT, "version": __version__, "manifest": manifest},
                }
            ],
        }
    )


def measured_values(estimate: Estimate) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return what a motor takes to another joint, and the other values of its rig."""
    known: dict[str, Any] = {}
    rig: dict[str, Any] = {}
    for row in estimate.table():
        if row.name in estimate.known.parameters:
            continue  # somebody's own knowledge is no measurement
        if row.value is None or row.lower is None or row.upper is None:
            continue
        of_motor = TERMS[row.name].of_motor and row.trust.sized
        (known if of_motor else rig)[row.name] = _numbers(row, row.value, row.lower, row.upper)
    return known, rig


def _numbers(row: Parameter, value: float, lower: float, upper: float) -> dict[str, Any]:
    """Return a value and its limits in few digits, these outwards."""
    numbers = {"value": value, "lower": lower, "upper": upper}
    return {name: float(f"{x:.{_DIGITS}g}") for name, x in numbers.items()} | {"unit": row.unit}


def _plain(manifest: Mapping[str, Any]) -> dict[str, Any]:
    """Return the content of a manifest, without its place on this machine."""
    whole = Manifest.model_validate(manifest)
    content: dict[str, Any] = whole.model_dump(
        mode="json", exclude_defaults=True, exclude={"root", "facts"}
    )
    return content
