"""A servo in the form of BAM, Rhoban's models of servos: one JSON object that `bam.model` loads.

With torques tm of the motor and te of gravity, and S = exp(-|w/w_s|^alpha), the friction of its
models beside a viscous one is

    m1  Kc                       m2  m1 + S Kcs
    m3  m1 + Kl |te - tm|        m4  m2 + (Kl + S Kls) |te - tm|
    m5  m2 + |Ke te - Km tm| + S |Kes te - Kms tm|
    m6  m5 + S (Keq te^2 where |te| < |tm|, else Kmq tm^2), while both oppose each other

(Rhoban/bam 1b5a1ce, bam/model.py), and its motor's torque kt V/R - kt^2 w/R.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

from butterfly.errors import InputError
from butterfly.files import json_text
from butterfly.logs.log import InputKind
from butterfly.model.parameters import AddedMass, LumpedParameters
from butterfly.model.prior import Prior
from butterfly.model.servo import ServoLoop
from butterfly.model.terms import OF_SCALE, PARAMETERS, SETTINGS, TERMS, held_by
from butterfly.twin.forms import Options
from butterfly.twin.twin import Twin, Written, beyond, listed, told_of

_OF_LAWS = {"dynamixel-xl330": "xl330", "feetech-sts": "sts3215"}
ACTUATORS = (*_OF_LAWS.values(), "mx64", "mx106", "xl320")
"""BAM's servos that are driven by a voltage."""

_GRAVITY = 9.80665  # m/s², of BAM
_SAME = 1e-3
_FAST = 1e6  # rad/s, of a set-point that is not slowed down
_OF_LOGS = ("law", "kp", "supply", "resistance", "back_emf_constant", "torque_constant")
_HELD = held_by("bam")


def as_bam(twin: Twin, options: Options) -> Written:
    """Return a bare joint as BAM's file: the least of its models that holds all friction.

    BAM's logs say what is carried, here that tells only what its weight adds to T_c.
    """
    servo, known, added = twin.servo, twin.known, twin.added
    twin.parameters.require_gain("export")
    units = [name for name in OF_SCALE if known.fixed.get(name) == 1.0]
    if twin.ratios or units:
        scale = "ratios to p1" if twin.ratios else f"relative to {units[0]} = 1"
        expected = "N m; add a known mass or give a measured value (known: {p3: 0.3})"
        raise InputError("export", "parameters", scale, expected)
    if twin.kind is not InputKind.VOLTAGE:
        expected = "voltage, or set-points of a servo with its supply (BAM's motors have kt and R)"
        raise InputError("export", "input", twin.kind, expected)
    name = options.actuator or _OF_LAWS.get("" if servo is None else servo.law)
    if name not in ACTUATORS:
        expected = f"BAM's name of the servo: {', '.join(ACTUATORS)}"
        raise InputError("export", "--actuator", name or "missing", expected)
    joint = twin.parameters
    p = replace(joint, coulomb=joint.coulomb + joint.load * added.weight)
    model, friction = _least(p)
    damping, source = motor_damping(p, known)
    content = {
        "model": model,
        "actuator": name,
        "kt": damping / p.p4,
        "R": damping / p.p4**2,
        "armature": p.p1,
        "q_offset": 0.0,
        "friction_base": p.coulomb,
        "friction_viscous": p.p2 - damping,
        **friction,
    }
    if name == "sts3215":
        slowed = servo is not None and math.isfinite(servo.speed_limit)
        content["max_velocity"] = servo.speed_limit if servo is not None and slowed else _FAST
        content["error_gain_ratio"] = p.loop_kp
    notes = (f"kt and R: {source}.", *_notes(p, model, added), *_of_loop(p, name, servo))
    text = json_text(content | {"notes": [*twin.log_lines, *notes]})
    return Written(text=text, about=f"BAM's {model} of {name}", left_out=notes)


def motor_damping(p: LumpedParameters, known: Prior) -> tuple[float, str]:
    """Return kt^2/R in N m s/rad, at most p2, and in words where it is from; p4 is kt/R."""
    values = {name: quantity.value for name, quantity in known.physical.items()}
    ratio = values.get("gear_ratio", 1.0)
    if p.back_emf:
        return min(p.back_emf, p.p2), "from the back EMF identified from the logs"
    for name, damping in (
        ("torque_constant", abs(p.p4) * ratio * values.get("torque_constant", 0.0)),
        ("back_emf_constant", abs(p.p4) * ratio * values.get("back_emf_constant", 0.0)),
        ("resistance", p.p4**2 * values.get("resistance", 0.0)),
    ):
        if name in values and damping < p.p2:
            return damping, f"from the known {name} and p4"
    if not p.p2 > 0:
        raise InputError("export", "p2", p.p2, "more than 0, to compute kt and R")
    if values.keys() & {"torque_constant", "back_emf_constant", "resistance"}:
        return p.p2, "all of p2 taken as back EMF; the known motor values would give even more"
    return p.p2, (
        "all of p2 taken as back EMF, not distinguishable from viscous friction in these data; to "
        "separate them, record free decays with the torque off or give known: {resistance: ...}"
    )


def _least(p: LumpedParameters) -> tuple[str, dict[str, float]]:
    """Return the name of the least model that holds all friction, and its fields beside Coulomb's.

    BAM has values of its own where none are given.
    """
    stribeck = {"friction_stribeck": p.stribeck, "dtheta_stribeck": p.stribeck_velocity}
    stribeck["alpha"] = 2.0
    quadratic = p.lifting_stribeck or p.lowering_stribeck
    alike = (p.motor_friction, p.motor_stribeck) == (p.load_friction, p.load_stribeck)
    if quadratic or not alike:
        for side, bam in (("motor", "motor"), ("load", "external")):
            stribeck[f"load_friction_{bam}"] = getattr(p, f"{side}_friction")
            stribeck[f"load_friction_{bam}_stribeck"] = getattr(p, f"{side}_stribeck")
        if not quadratic:
            return "m5", stribeck
        stribeck["load_friction_external_quad"] = p.lifting_stribeck
        return "m6", stribeck | {"load_friction_motor_quad": p.lowering_stribeck}
    gear = {"load_friction_base": p.motor_friction} if p.geared else {}
    if not (p.stribeck or (gear and p.motor_stribeck)):
        return "m3" if gear else "m1", gear
    if not gear:
        return "m2", stribeck
    return "m4", stribeck | gear | {"load_friction_stribeck": p.motor_stribeck}


def _notes(p: LumpedParameters, model: str, added: AddedMass) -> Iterator[str]:
    """Name what BAM's format cannot represent of a joint, or interprets differently."""
    covered = {"loop_kp"} | ({"load"} if added.mass else set())
    if rest := beyond(p, _HELD | covered):
        yield f"Not representable in BAM: {listed(p, rest, InputKind.VOLTAGE.unit)}."
    if any(row.offered and row.name != "latency" for row in rest):
        optional = _HELD - {*PARAMETERS, *SETTINGS}
        held = [name for name in TERMS if name in optional and getattr(p, name)]
        yield (
            "BAM's servo fits worse without these. To refit the others, identify with --terms "
            f'"{",".join(held)}".'
        )
    if p.compression:
        yield f"BAM has no compression: its motor is 1 + {p.compression:.4g} |V| times stronger."
    if model == "m6":
        yield (
            "In BAM the larger torque decides whether motor or load drives, here the direction of "
            "motion; they differ while a load is braked."
        )
    if p.geared and not p.back_emf:
        yield (
            "BAM's friction grows with the motor torque minus back EMF, here with p4 u: no back "
            "EMF was identified."
        )
    if p.p3:
        yield (
            f"p3 = {p.p3:.4g} N m belongs to the bare joint. In a BAM log, set arm_mass = "
            f"{2 * p.p3 / _GRAVITY:.4g} kg m / length, and subtract arm_mass length²/3 from "
            "armature, which already includes it."
        )
    if not math.isclose(added.gravity, _GRAVITY, rel_tol=_SAME):
        yield f"BAM's gravity is {_GRAVITY} m/s²; here it is {added.gravity:g}."
    yield (
        "Give mass, length, kp and vin in BAM's logs. q_offset 0: angles start at the hanging "
        "position."
    )


def _of_loop(p: LumpedParameters, actuator: str, servo: ServoLoop | None) -> Iterator[str]:
    """Name what BAM's format cannot represent of a servo's loop, or interprets differently."""
    if p.loop_kp != 1 and actuator != "sts3215":
        yield f"The identified P gain is {p.loop_kp:.4g} times kp: multiply kp in BAM's logs by it."
    if servo is None or _OF_LAWS.get(servo.law) != actuator:
        law = "no loop was given" if servo is None else f"the law is {servo.law}"
        yield f"BAM's {actuator} has its own control law; here {law}."
        return
    held = {*_OF_LOGS, "speed_limit"} if actuator == "sts3215" else {*_OF_LOGS}
    if rest := told_of(servo, held):
        yield f"BAM's {actuator} has only a P gain; not included: {', '.join(rest)}."
