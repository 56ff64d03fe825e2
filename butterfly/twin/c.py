"""Twins as a C99 header, or in JavaScript: our compiled kernel's own functions, translated.

A command is held during each step, so the kernel's drives, parabolas elsewhere, are one number; the
delayed command may change once within a step, which is then taken in two parts.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import fields
from functools import partial
from textwrap import wrap
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from butterfly.arrays import Samples
from butterfly.identification.trust import unit_of
from butterfly.model.greybox import (
    DERIVED,
    OF_BASE,
    constants_of,
    derived,
    of_base,
    require_plain_base,
    simulate,
)
from butterfly.model.kernel.equation import Constants
from butterfly.model.kernel.integrate import interval
from butterfly.model.parameters import AddedMass, LumpedParameters, UnderLoad, under
from butterfly.model.terms import DRIVE, OF_INPUT, TERMS, DriveTerms
from butterfly.twin.forms import Options
from butterfly.twin.languages import C, JavaScript, wrapped
from butterfly.twin.translate import NUMBER, Fields, Function, Translator, all_of, is_known, join
from butterfly.twin.twin import Case, Twin, Written, Yardstick, unheard

_AIM = 1e-7  # rad, less than which no finer step is worth its time
_GAIN = 0.01  # or than which share less of the error
_SUBSTEPS = (1, 2, 4, 8, 16)
_ROUNDING = 1e-9  # of a step
_WIDTH = 95  # of a comment
_SPARE = 2  # times the delay, for which there is room
_ASCII = str.maketrans(
    {"²": "^2", "³": "^3", "–": "1"} | {"₀₁₂₃₄₅₆₇₈₉"[k]: str(k) for k in range(10)}
)
_OTHERS = {"viscous": "p2", "lag": "time_constant", "give": "base_compliance"}
"""Constants of the kernel that are parameters by other names,"""
_MORE = {
    "swing": ("s^2", "of the base: 1/w^2 of its natural frequency w in rad/s"),
    "slow": ("s", "of the base: 2 z/w of its damping ratio z"),
    "moment": ("kg m", "first moment of the moving body, towards its centre of mass at angle 0"),
    "moment_offset": ("kg m", "first moment to the side"),
    "limit": ("unit", "largest command in both directions"),
    "resolution": ("unit", "step of the command, which is rounded to its multiples"),
    "zero": ("way", "reading of the encoder where the joint hangs (the model's angle 0)"),
    "dry": ("1", "share of dry friction that is compensated"),
    "excess": ("1", "share of its Stribeck excess that is compensated"),
    "damping": ("1", "share of viscous friction, back EMF and drag that is compensated"),
    "smoothing": ("way/s", "speed from which on friction has the velocity's sign"),
}
"""and those that are none."""

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


def as_c(twin: Twin, options: Options) -> Written:
    """Return a twin as a C header."""
    yardstick = Yardstick.of(twin, options.timestep)
    substeps = _substeps(yardstick)
    accuracy = yardstick.accuracy(partial(_moved, step=yardstick.step, substeps=substeps))
    left_out = tuple(unheard(twin))
    notes = (*twin.log_lines, *left_out, *accuracy.lines)
    return Written(
        text=header(twin, options.timestep, substeps, notes),
        about=f"a C99 header with {twin.identifier}_step, of {1e3 * options.timestep:g} ms",
        left_out=left_out,
        accuracy=accuracy,
    )


def _substeps(yardstick: Yardstick) -> int:
    """Return the least number of substeps beyond which the motion hardly changes."""
    before = math.inf
    for substeps in _SUBSTEPS:
        move = partial(_moved, step=yardstick.step, substeps=substeps)
        error = yardstick.worst_of_some(move)
        if error <= _AIM:
            return substeps
        if before - error < max(_AIM, _GAIN * before):
            return substeps // 2
        before = error
    return _SUBSTEPS[-1]


def _moved(case: Case, step: float, substeps: int) -> Samples:
    """Return the angles of a case as its header moves it, in the compiled kernel."""
    start = (case.angle, case.velocity)
    return held_motion(case.twin.loaded, case.past, case.commands, start, step, substeps)[0]


def held_motion(  # noqa: PLR0917 - a joint, what drives it, where from, and in which steps
    loaded: LumpedParameters,
    past: Samples,
    commands: Samples,
    start: tuple[float, float],
    step: float,
    substeps: int = 1,
) -> tuple[Samples, Samples]:
    """Return (n + 1,) angles and velocities under (n,) commands held a step, after ``past``."""
    late = max(loaded.delay, 0.0) / step
    whole = int(late + _ROUNDING)
    first = late - whole if late - whole > _ROUNDING else 0.0
    sent = np.concatenate([past[past.size - whole - 1 :], commands])
    ends, inputs, begin = [], [], 0.0
    for place, share in ((0, first), (1, 1 - first)):
        parts = math.ceil(substeps * share - _ROUNDING)
        ends += [begin + share * (k + 1) / parts for k in range(parts)]
        inputs += parts * [sent[place : place + commands.size]]
        begin = first
    time = step * np.append(0.0, (np.arange(commands.size)[:, None] + ends).ravel())
    held = np.repeat(np.array(inputs).T.ravel()[:, None], 3, axis=1)
    angles, velocities = simulate(loaded, time, held, *start)
    return angles[:: len(ends)], velocities[:: len(ends)]


def part_of(drives: float, _part: float, _parts: float) -> float:
    """Return the drive of a part of the interval, throughout which it is held."""
    return drives


def piece_of(drives: float, _begin: float, _share: float) -> tuple[float, float, float]:
    """Return the drives of a piece of the interval."""
    return drives, drives, drives


def drive_at(drives: float, _fraction: float) -> float:
    """Return the drive at a fraction of the interval."""
    return drives


def exceeds_at(_drives: float, _begin: float, _lower: float, _upper: float) -> tuple[float, float]:
    """Return that a drive which is held does not leave a range."""
    return 1.0, 0.0


def shaped(command: Any, c: Any) -> Any:  # noqa: ANN401 - numbers, and constants of a drive
    """Return a command as the drive delivers it: rounded, limited, and what is left of it."""
    if c.resolution > 0.0:
        command = c.resolution * round(command / c.resolution)
    if c.limit < math.inf:
        command = np.clip(command, -c.limit, c.limit)
    return DriveTerms.delivered(c, command)


_HELD = {function.__name__: function for function in (part_of, piece_of, drive_at, exceeds_at)}
_SHAPES = dict.fromkeys((*OF_INPUT, *DRIVE), 0.0)
_SHAPES |= {"limit": math.inf, "resolution": 0.0}
"""Parameters of the drive, and what each is where there is no such thing."""


def constants(twin: Twin) -> dict[str, float]:
    """Return the constants of a twin that are there, by name: of the kernel, then of its drive."""
    p = twin.loaded
    others = {"limit": twin.limit, "resolution": twin.resolution, "delay": max(p.delay, 0.0)}
    drive = {name: others.get(name, getattr(p, name, 0.0)) for name in _SHAPES}
    values = constants_of(p)._asdict() | drive
    return {name: value for name, value in values.items() if value != _SHAPES.get(name, 0.0)}


def kernel_of(twin: Twin) -> tuple[Function, Function]:
    """Return what is left of the kernel's `interval`, and of the drive, for a twin."""
    present, p = constants(twin), twin.loaded
    kinds = dict.fromkeys(Constants._fields, 0.0) | _SHAPES | dict.fromkeys(present, NUMBER)
    c = Fields(kinds | {"geared": float(p.geared)})
    translator, moving = Translator(_HELD), None
    if p.base_gives:
        moving = require_plain_base(p)
    state, before = (NUMBER, NUMBER, 0.0, 0.0), None
    while state != before:  # until all states are known that the joint has
        before = state
        made = translator.function(interval, state, NUMBER, NUMBER, c, moving)
        state = join(state, made.returned)
    return made, translator.function(shaped, NUMBER, c)


def header(twin: Twin, step: float, substeps: int, notes: Iterable[str] = ()) -> str:
    """Return the header of a twin, which says some sentences."""
    moved, drive = kernel_of(twin)
    functions = [*(moved.called | drive.called)]
    language, delay = C(twin.identifier, functions), max(twin.loaded.delay, 0.0)
    given = {"p4": twin.loaded.p4} | {
        name: value
        for name, value in constants(twin).items()
        if name in {*fields_of(functions), "delay"}
    }
    states = [
        (*about, number)
        for number, (about, kind) in enumerate(zip(_states(twin), moved.returned, strict=True))
        if not is_known(kind)
    ]
    at = {number: f"s->{name}" for name, _, number in states}
    known = {"state": "state", "drives": "drive", "h": "duration / count", "c": "p"}
    return rendered(
        "joint.h",
        twin=twin,
        n=twin.identifier,
        N=twin.identifier.upper(),
        step=repr(float(step)),
        substeps=substeps,
        room=math.ceil(_SPARE * delay / step) + 2 if delay else 0,
        parameters=[
            (name, repr(float(value)), explained(name, twin)) for name, value in given.items()
        ],
        states=states,
        whole=", ".join(at.get(number, "0.0") for number in range(len(moved.returned))),
        functions=language.text(),
        interval=language.call(moved, known),
        shaped=language.call(drive, known | {"command": "command"}),
        notes=notes,
    )


def added_numbers(added: AddedMass) -> dict[str, float]:
    """Return `OF_ADDED_MASS` of one, by name."""
    return {name: float(getattr(added, name)) for name in OF_ADDED_MASS}


def as_javascript(twin: Twin) -> str:
    """Return ``joint`` without terms that are 0; NotImplementedError if not translatable.

    A page moves parameters of the bare joint; what follows from them is translated too.
    """
    moved, drive = kernel_of(twin)
    bare = Fields(dict.fromkeys((field.name for field in fields(LumpedParameters)), NUMBER))
    added = Fields(dict.fromkeys(OF_ADDED_MASS, NUMBER))
    translator = Translator({})
    loaded = translator.function(under, bare, added)
    derivation, base = translator.function(derived, bare), translator.function(of_base, bare)
    language = JavaScript(
        "joint", [*(moved.called | drive.called), loaded, derivation, *base.called]
    )
    following = (*DERIVED, *OF_BASE)
    present = {"p4", *constants(twin)}
    moving = f"const [{', '.join(OF_BASE)}] = {language.call(base, {'p': 'p'})};\n    "
    return _JOINT.format(
        functions=wrapped(language.text()),
        interval=language.call(moved, {"state": "state", "drives": "drive", "h": "h", "c": "c"}),
        shaped=language.call(drive, {"command": "command", "c": "c"}),
        loaded=", ".join(f"p.{name}" for name in UnderLoad._fields),
        under=language.call(loaded, {"p": "bare", "added": "added"}),
        names=", ".join(DERIVED),
        derived=language.call(derivation, {"p": "p"}),
        base=moving * twin.loaded.base_gives,
        constants=", ".join(
            name if name in following else f"{name}: p.{name}" for name in sorted(present)
        ),
    )


def fields_of(functions: Iterable[Function]) -> set[str]:
    """Return the names of the constants that functions read."""
    values = [statement.value for f in functions for statement in all_of(f.body) if statement.value]
    return {part.meant for value in values for part in value.all() if part.op == "field"}


def rendered(template: str, *, notes: Iterable[str], **values: Any) -> str:  # noqa: ANN401
    """Return the text of a template, of short lines in C; it says some sentences."""
    made = Environment(  # noqa: S701 - no HTML
        loader=PackageLoader("butterfly.twin", "templates"),
        undefined=StrictUndefined,
        trim_blocks=True,
        keep_trailing_newline=True,
    )
    lines = [line for note in notes for line in wrap(note, _WIDTH)]
    text = made.get_template(f"{template}.j2").render(said=lines, **values)
    if template.endswith(".h"):
        text = wrapped(text)
    return text.translate(_ASCII).encode("ascii", "replace").decode()


def _states(twin: Twin) -> tuple[tuple[str, str], ...]:
    """Return names and units of the states of the kernel."""
    way, unit = twin.joint.way, unit_of("coulomb", twin.kind, twin.joint)
    first = (("angle", way), ("velocity", f"{way}/s"))
    if twin.loaded.base_gives:
        return *first, ("base_force", "N, of its spring"), ("base_force_rate", "N/s")
    return *first, ("motor_torque", unit), ("bristles", f"{way}, their deflection")


def explained(name: str, twin: Twin) -> str:
    """Return unit and meaning of a parameter."""
    if name in _MORE:
        unit, meaning = _MORE[name]
        unit = unit.replace("unit", twin.kind.unit).replace("way", twin.joint.way)
        return f"{unit}: {meaning}"
    known = _OTHERS.get(name, name)
    meaning = TERMS[known].meaning
    if name == "viscous" and twin.loaded.back_emf:
        meaning = "viscous friction, without back EMF"
    return f"{unit_of(known, twin.kind, twin.joint)}: {meaning}"
