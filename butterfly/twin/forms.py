"""The forms in which a twin is written: a further one is its module, and its line in `FORMS`."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from butterfly.errors import visible
from butterfly.files import write_file, write_xml
from butterfly.outputs import mark_of, require_endings, require_free

if TYPE_CHECKING:
    from butterfly.twin.twin import Twin, Written

FORMS = {
    "mjcf": ("butterfly.twin.stand_alone:as_mjcf", ".xml"),
    "snippet": ("butterfly.twin.stand_alone:as_snippet", ".xml"),
    "urdf": ("butterfly.twin.plain:as_urdf", ".urdf", ".xml"),
    "actuator": ("butterfly.twin.plain:as_actuator", ".json"),
    "randomisation": ("butterfly.twin.randomisation:as_randomisation", ".yaml", ".py"),
    "c": ("butterfly.twin.c:as_c", ".h"),
    "bam": ("butterfly.twin.bam:as_bam", ".json"),
    "compensation": ("butterfly.twin.compensation:as_compensation", ".h", ".py"),
    "wpilib": ("butterfly.twin.compensation:as_wpilib", ".json"),
}
"""What makes each form, by its name: a function of a twin and options; and its files' endings."""

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
    ending: str = ".h"  # of a file whose ending says its language
    units: tuple[Twin, ...] = ()  # further units of the joint, whose scatter is asked


DEFAULTS = Options()
"""What is written if nothing is asked."""


def xml_comment(sentence: str) -> str:
    """Return a sentence as a comment of XML, which holds no two hyphens in a row."""
    return f"<!-- {re.sub('-(?=-)', '- ', visible(sentence))} -->"


def write_as(form: str, twin: Twin, options: Options = DEFAULTS) -> Written:
    """Return a twin in one of `FORMS`; InputError where the form cannot hold such a joint."""
    module, name = FORMS[form][0].split(":")
    written: Written = getattr(import_module(module), name)(twin, options)
    held = [twin.holds] if twin.holds and twin.holds not in written.notes else []
    return replace(written, notes=(*held, *written.notes))


def write_twin(form: str, twin: Twin, options: Options, path: Path) -> Written:
    """Write a twin to a file in one of `FORMS`, and return it (see `write_as`)."""
    require_endings(path, FORMS[form][1:])
    require_free(path, mark_of(path, form))
    written = write_as(form, twin, replace(options, ending=path.suffix.lower()))
    if mark_of(path, form):
        write_xml(path, written.text, form)
    else:
        write_file(path, written.text)
    return written
