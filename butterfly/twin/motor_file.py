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
from butterfly.identification.parameter import Parameter
from butterfly.logs.log import InputKind
from butterfly.logs.manifest import Manifest
from butterfly.model.parameters import JointKind
from butterfly.model.terms import GROWING, TERMS
from butterfly.twin.forms import Options
from butterfly.twin.twin import Twin, Written
from butterfly.yaml_files import yaml_text

SCATTER_OF_GAIN, SCATTER_OF_FRICTION, SCATTER_OF_DAMPING = 0.12, 0.35, 1.1
"""Standard deviations between motors of one type, over the value, where one was measured: of p4,
of Coulomb friction and of viscous friction. Those of BAM's M1 of five Feetech STS3215
(kscalelabs/sysid f4739df, feetech/sts3215-12v/params)."""

ASSUMED = (
    "one motor was measured; the scatter is that of five Feetech STS3215, by BAM's M1 of each "
    "(kscalelabs/sysid f4739df): 12 % of kt/R, 35 % of Coulomb and 110 % of viscous friction"
)
"""Where that scatter is from, in words."""

_FIT = "butterfly identify manifest.yaml"
_DIGITS = 4
_EMPTY = ("repository", "commit", "folder", "licence", "holder")


def as_motor(twin: Twin, options: Options) -> Written:  # noqa: ARG001 - as every form is called
    """Return the motor of a joint, as measured once; InputError if that says nothing of it."""
    if twin.source is None or twin.estimate is None:
        raise InputError("export", "source", twin.name, "a saved result of logs, or logs")
    estimate, manifest = twin.estimate, twin.source.origin["manifest"]
    if not estimate.level.usable:
        expected = "a verdict of good, or use with care: no motor is published by such values"
        raise InputError("export", "verdict", estimate.level.verdict, expected)
    if twin.joint is not JointKind.HINGE or twin.kind is InputKind.NONE or twin.ratios:
        raise InputError("export", "motor", twin.name, "a hinge with a drive, on an absolute scale")
    known, rig = measured_values(estimate)
    if not known:
        expected = "values whose interval excludes 0: those of p4, friction, ..."
        raise InputError("export", "known", "nothing that a motor takes along", expected)
    content = {
        "name": "",
        "maker": "",
        "drive": str(twin.kind),
        **({} if twin.servo is None else {"law": twin.servo.law}),
        "units": 1,
        "scatter": ASSUMED,
        "conditions": {"supply": "", "temperature": "", "load": "", "sampling": ""},
        "verdict": estimate.level.verdict,
        "known": known,
        "rig": rig,
        "source": dict.fromkeys(_EMPTY, ""),
        "made": {
            "command": _FIT,
            "version": __version__,
            "manifest": _plain(manifest) if manifest else {},
        },
    }
    notes = (
        "Fill in name, maker, conditions and source, then try it: "
        "butterfly library show ./FILE.yaml",
    )
    return Written(
        text=yaml_text(content), about=f"{len(known)} values", title="Motor", notes=notes
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
        value = _numbers(row, row.value, row.lower, row.upper)
        if TERMS[row.name].of_motor and row.trust.sized:
            known[row.name] = {**value, "scatter": scatter_of(row.name)}
        else:
            rig[row.name] = value
    return known, rig


def scatter_of(name: str) -> float:
    """Return how far motors of a type differ in a parameter, if one was measured."""
    row = TERMS[name]
    if row.dry:
        return SCATTER_OF_FRICTION
    return SCATTER_OF_DAMPING if row.derivative and name in GROWING else SCATTER_OF_GAIN


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
