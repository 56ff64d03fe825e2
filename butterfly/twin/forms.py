"""The forms in which a twin is written: a further one is its module, and its line in `FORMS`."""

from __future__ import annotations

import re
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from butterfly.twin.twin import Twin, Written

FORMS = {
    "mjcf": "butterfly.twin.stand_alone:as_mjcf",
    "snippet": "butterfly.twin.snippet:as_snippet",
    "urdf": "butterfly.twin.urdf:as_urdf",
    "actuator": "butterfly.twin.actuator:as_actuator",
    "c": "butterfly.twin.c:as_c",
    "bam": "butterfly.twin.bam:as_bam",
}
"""What makes each form, by its name: a function of a twin and options."""

WITH_A_BODY = ("mjcf", "snippet", "urdf")
"""Forms that say a mass on which the motion does not depend."""

INTEGRATORS = ("RK4", "implicitfast")
"""Integrators of MuJoCo for which a twin is written."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """What a user can ask of a form."""

    timestep: float = 0.002  # of the simulator, in s
    integrator: Literal["RK4", "implicitfast"] = "RK4"  # of MuJoCo
    actuator: str | None = None  # which of BAM's servos it is


DEFAULTS = Options()
"""What is written if nothing is asked."""


def xml_comment(sentence: str) -> str:
    """Return a sentence as a comment of XML, which holds no two hyphens in a row."""
    return f"<!-- {re.sub('-(?=-)', '- ', sentence)} -->"


def write_as(form: str, twin: Twin, options: Options = DEFAULTS) -> Written:
    """Return a twin in one of `FORMS`; InputError where the form cannot hold such a joint."""
    module, name = FORMS[form].split(":")
    written: Written = getattr(import_module(module), name)(twin, options)
    return written
