"""A joint in JavaScript, for pages: our compiled kernel's own functions, translated.

The page moves parameters of the bare joint. What they become under an added mass, and which
constants of the equation follow from them, are translated too.
"""

from __future__ import annotations

from dataclasses import fields

from butterfly.model.kernel.equation import DERIVED, OF_BASE, derived, of_base
from butterfly.model.parameters import UNDER_LOAD, AddedMass, LumpedParameters, under
from butterfly.twin.c import constants, kernel_of
from butterfly.twin.languages import JavaScript, wrapped
from butterfly.twin.reduced import NUMBER, Fields
from butterfly.twin.translate import Translator
from butterfly.twin.twin import Twin

OF_ADDED_MASS = ("mass", "arm", "inertia", "swung", "gravity_moment", "weight", "gravity")
"""What the joint feels of an added mass."""

_JOINT = """{functions}
const joint = {{
  step: (state, drive, h, c) => {interval},
  delivered: (command, c) => {shaped},
  constants(bare, added) {{
    const p = {{...bare}};
    [{loaded}] = {under};
    const [{names}] = {derived};
    {base}return {{{constants}}};
  }},
}};
"""


def added_numbers(added: AddedMass) -> dict[str, float]:
    """Return `OF_ADDED_MASS` of one, by name."""
    return {name: float(getattr(added, name)) for name in OF_ADDED_MASS}


def as_javascript(twin: Twin) -> str:
    """Return ``joint`` without terms that are 0; NotImplementedError if not translatable."""
    moved, drive = kernel_of(twin)
    bare = Fields(dict.fromkeys((each.name for each in fields(LumpedParameters)), NUMBER))
    added = Fields(dict.fromkeys(OF_ADDED_MASS, NUMBER))
    translator = Translator({})
    loaded = translator.function(under, bare, added)
    own, base = translator.function(derived, bare), translator.function(of_base, bare)
    language = JavaScript("joint", [*(moved.called | drive.called), loaded, own, *base.called])
    following = (*DERIVED, *OF_BASE)
    present = {"p4", *constants(twin)}
    moving = f"const [{', '.join(OF_BASE)}] = {language.call(base, {'p': 'p'})};\n    "
    return _JOINT.format(
        functions=wrapped(language.text()),
        interval=language.call(moved, {"state": "state", "drives": "drive", "h": "h", "c": "c"}),
        shaped=language.call(drive, {"command": "command", "c": "c"}),
        loaded=", ".join(f"p.{name}" for name in UNDER_LOAD),
        under=language.call(loaded, {"p": "bare", "added": "added"}),
        names=", ".join(DERIVED),
        derived=language.call(own, {"p": "p"}),
        base=moving * twin.loaded.base_gives,
        constants=", ".join(
            name if name in following else f"{name}: p.{name}" for name in sorted(present)
        ),
    )
