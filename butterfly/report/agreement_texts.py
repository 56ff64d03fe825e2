"""Texts on parameters that differ between conditions, with possible causes."""

from __future__ import annotations

import math
from collections.abc import Sequence

from butterfly.identification.agreement import Condition, Contrast
from butterfly.identification.estimate import Estimate
from butterfly.identification.parameter import unit_of
from butterfly.model.parameters import JointKind
from butterfly.report.page import PageTable

_WITH_MASS = ("the added mass's own inertia", "its arm", "the clock", "a moving base")
_FRICTION = ("a friction term missing in the model",)
_PLAY = ("backlash", "an eccentric encoder")
_WARM = ("friction that changes within a log (warm-up)",)
_RESONANCE = ("an elastic joint", "a moving base")  # which make a gain grow; a lag lowers it
_SCATTER = ("a varying resistance", "drive saturation", "a moving base")
_FOLLOWS = {
    Condition.MASS: "the added mass",
    Condition.COMMAND: "the command",
    Condition.SWING: "the swing",
    Condition.FREQUENCY: "the frequency",
    Condition.SPEED: "the speed",
    Condition.TIME: "time in the log",
    Condition.DIRECTION: "the sign of the input",
    Condition.LOG: "the log",
    Condition.REGIME: "the clock's mean sampling interval",
}

_CAUSES: dict[tuple[Condition, str], tuple[str, ...]] = {
    (Condition.MASS, "p1"): _WITH_MASS,
    (Condition.MASS, "p2"): ("friction that depends on the load", *_WITH_MASS),
    (Condition.MASS, "p3"): ("wrong masses", *_WITH_MASS),
    (Condition.MASS, "p4"): ("the motor's resistance", "wrong masses", *_WITH_MASS),
    (Condition.MASS, "coulomb"): ("friction that depends on the load", *_WITH_MASS),
    (Condition.SWING, "p1"): _PLAY,
    (Condition.SWING, "p2"): _FRICTION,
    (Condition.SWING, "p3"): ("a spring, such as a cable", *_PLAY),
    (Condition.SWING, "p4"): (*_PLAY, "a spring, such as a cable"),
    (Condition.SWING, "coulomb"): (*_FRICTION, "backlash"),
    (Condition.FREQUENCY, "p1"): ("a moving base", "an elastic joint", "a spring", "drive lag"),
    (Condition.FREQUENCY, "p2"): _FRICTION,
    (Condition.FREQUENCY, "p3"): ("a spring, such as a cable", "a moving base"),
    (Condition.FREQUENCY, "p4"): ("drive lag", "an elastic joint", "a moving base"),
    (Condition.FREQUENCY, "coulomb"): _FRICTION,
    (Condition.REGIME, "delay"): (
        "the two regimes of the clock have different delays (term slow_delay of output-error)",
    ),
    (Condition.TIME, "p4"): ("the motor's resistance, which grows with temperature", "the supply"),
}
"""What may make a parameter follow a condition, the likeliest first."""

_OF_ANY = {
    Condition.WEIGHED: ("a wrong mass", *_WITH_MASS),
    Condition.DIRECTION: (
        "friction that differs between directions",
        "a drive that differs between directions",
    ),
}
"""The same where it does not depend on the parameter."""


def causes(contrast: Contrast) -> tuple[str, ...]:
    """Return what may be the cause of a contrast, the likeliest first; several look alike."""
    condition, name = contrast.condition, contrast.parameter
    if condition is Condition.COMMAND:
        # the condition is 1 over the command: what grows with it falls with the command
        drive = "drive saturation" if contrast.grows else "a dead zone of the drive"
        return (drive,) if name == "p4" else (*_FRICTION, drive)
    if condition is Condition.SPEED:
        # the condition is 1 over the speed; a lag that a faster joint has more of is no gap
        return ("backlash",) if contrast.grows else _FRICTION
    if condition is Condition.LOG:
        return _SCATTER if name == "p4" else ("temperature", "lubrication", "wear")
    if (condition, name) == (Condition.FREQUENCY, "p4") and contrast.grows:
        return _RESONANCE
    return _OF_ANY.get(condition) or _CAUSES.get((condition, name), _WARM)


def contrast_text(contrast: Contrast, estimate: Estimate) -> str:
    """Say in a sentence what follows what, from where to where, and what may be the cause."""
    first, *others = causes(contrast)
    why = f"Possible cause{'s' if others else ''}"
    if contrast.condition is Condition.WEIGHED:
        given, wanted = 1e3 * contrast.first, 1e3 * contrast.last
        return (
            f"The logs with the added mass of {given:.4g} g agree with the others if it is really "
            f"{wanted:.4g} g. {why}: {', '.join([first, *others])}."
        )
    if contrast.play > 0:
        size = f"{contrast.play:.2g} {estimate.joint.way}"
        if estimate.joint is JointKind.HINGE:
            size += f" ({math.degrees(contrast.play):.2g}°)"
        first = f"{first} of about {size}"
    unit = unit_of(contrast.parameter, estimate.input_kind, estimate.joint)
    low, high = contrast.first, contrast.last
    if contrast.condition in {Condition.COMMAND, Condition.SPEED}:  # the condition is 1 over it
        low, high = high, low
    way = f"{'grows' if high > low else 'falls'} with {_FOLLOWS[contrast.condition]}"
    if contrast.condition is Condition.LOG:
        way = "varies between logs"
    digits = _digits(low, high)
    moves = f"{contrast.parameter} {way}, from {low:.{digits}g} to {high:.{digits}g} {unit}"
    return f"{moves}. {why}: {', '.join([first, *others])}."


def _digits(one: float, other: float) -> int:
    """Return how many digits show by how much two values differ: three, or two of that."""
    difference, size = abs(one - other), max(abs(one), abs(other))
    return 3 if not difference else min(max(3, 2 + math.floor(math.log10(size / difference))), 9)


def agreement_table(contrasts: Sequence[Contrast]) -> PageTable:
    """Return a row for each parameter that follows a condition."""
    rows = [
        (
            contrast.parameter,
            _FOLLOWS.get(contrast.condition, "one added mass, as given"),
            f"{contrast.first:.{_digits(contrast.first, contrast.last)}g}",
            f"{contrast.last:.{_digits(contrast.first, contrast.last)}g}",
            f"{100 * contrast.share:.0f} %",
            ", ".join(causes(contrast)),
        )
        for contrast in contrasts
    ]
    columns = ("parameter", "follows", "from", "to", "explains", "possible causes")
    return PageTable("Parameters that differ between conditions", columns, rows, detail=True)
