"""A joint as most formats have it: inertia, gravity, one damping, one level of dry friction.

Whoever drives it multiplies the command by p4, and sends it so many steps later.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, replace

from butterfly.arrays import Samples
from butterfly.model.parameters import JointKind, LumpedParameters
from butterfly.model.terms import LOOP_TERMS
from butterfly.twin.accuracy import Yardstick
from butterfly.twin.forms import Options
from butterfly.twin.stand_alone import Form, mover
from butterfly.twin.twin import Accuracy, Twin, beyond, listed

_OF_BODY = {"p1", "p3", "p3_offset", "tilt", "mass_inertia", "gravity", "carried_moment"}
_HELD = {*_OF_BODY, "p2", "p4", "coulomb", "load", "delay"}


def plain(twin: Twin) -> Twin:
    """Return the twin without whatever such formats have no place for."""
    p = twin.parameters
    kept = {each.name: getattr(p, each.name) for each in fields(p) if each.name in _HELD}
    return replace(twin, parameters=LumpedParameters(**kept), robot=None)


def late_steps(twin: Twin, options: Options) -> int:
    """Return by how many whole steps a command is late."""
    return max(round(twin.parameters.delay / options.timestep), 0)


def steps_text(twin: Twin, options: Options) -> str:
    """Say by how many steps a command is late."""
    steps = late_steps(twin, options)
    return f"{steps} step{'' if steps == 1 else 's'} of {1e3 * options.timestep:g} ms"


def accuracy(twin: Twin, options: Options) -> Accuracy:
    """Return how far such a joint strays in MuJoCo, with MuJoCo's own settings of friction."""
    steps = late_steps(twin, options)
    form = Form(grip=None, delay="whole" if steps else "none")
    move, late = mover(options, form), steps * options.timestep

    def moved(
        each: Twin, past: Samples, commands: Samples, angle: float, velocity: float
    ) -> Samples:
        joint = plain(each)
        joint = replace(joint, parameters=replace(joint.parameters, delay=late))
        return move(joint, past, commands, angle, velocity)

    return Yardstick.of(twin, options.timestep).accuracy(moved)


def effort_unit(twin: Twin) -> str:
    """Return the unit of what moves the joint."""
    return "N" if twin.joint is JointKind.SLIDE else "N m"


def effort_text(twin: Twin) -> str:
    """Say what a command is worth."""
    if not twin.parameters.p4:
        return f"p4 is unknown: nothing drives the joint. Effort is in {effort_unit(twin)}."
    worth = f"{twin.parameters.p4:.6g} {effort_unit(twin)}"
    return f"Compute the effort yourself: command times {worth} per {twin.kind.unit} (p4)."


def left_out(twin: Twin, form: str) -> Iterator[str]:
    """Say what the joint has beyond this."""
    p = twin.loaded
    if rest := beyond(p, {*_HELD, *LOOP_TERMS, "back_emf"}):
        yield f"{form} cannot represent {listed(p, rest, twin.kind.unit)}."
    if twin.resolution:
        yield f"{form} does not round commands: round to multiples of {twin.resolution:g} yourself."
    if twin.built[0].clutch:
        yield f"{form} cannot represent the play of the clutch."
