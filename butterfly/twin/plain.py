"""A joint as most formats have it: URDF, and JSON of an actuator of mjlab and of Isaac Lab.

They have inertia, gravity, one damping and one level of dry friction; whoever drives them
multiplies the command by p4, and sends it so many steps later.

URDF's elements and units are those of the wiki pages urdf/XML/link and urdf/XML/joint of ROS:
``dynamics`` has damping in N m s/rad and friction in N m, ``limit`` effort in N m and velocity in
rad/s.

mjlab's native motor is MuJoCo's ``dcmotor``: ``K (V - K v)/R``, with ``K = sqrt(kt ke)`` and either
the voltage itself as input (mode 0), or ``V = stiffness (q* - q) - damping v`` of a position
(mode 1), or ``stiffness (v* - v)`` of a velocity (mode 2), which its voltage_limit clips. Its other
native drives are a position with a velocity, a velocity, and a motor whose gear is p4. Names are
those of the wheel mjlab 1.6.0, mjlab/actuator/{actuator,builtin_actuator}.py; that the limit does
not clip mode 0 was tried there, with MuJoCo 3.11.0.

Isaac Lab drives a joint by ``stiffness (q* - q) + damping (v* - v) + effort``, clipped at
+-actuator_effort_limit and, for a motor, between ``+-saturation_effort - saturation_effort
v/actuator_velocity_limit``: a limit of voltage, with the back EMF as damping. Names are of 3.0,
actuators/actuator_{base,pd}_cfg.py of isaac-sim/IsaacLab 01ff1d8 and 17ad46e; 2.3 calls the limits
effort_limit and velocity_limit, names which 3.0 still reads. Delays are in physics steps.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from dataclasses import fields, replace
from typing import Any

from butterfly.arrays import Samples
from butterfly.files import json_text
from butterfly.identification.trust import unit_of
from butterfly.logs.log import InputKind
from butterfly.model.parameters import LumpedParameters
from butterfly.model.servo import LawStructure, Output
from butterfly.model.terms import LOOP_TERMS, TERMS, held_by
from butterfly.plant.robot import Shape
from butterfly.twin.bam import motor_damping
from butterfly.twin.forms import Options, xml_comment
from butterfly.twin.stand_alone import Form, mover
from butterfly.twin.twin import Accuracy, Case, Twin, Written, Yardstick, beyond, listed, told_of

HELD = {*held_by("urdf"), "gravity", "carried_moment"}
"""Terms that most formats hold."""

_OF_LOOP = ("law", "kp", "kd", "limit", "supply", "clock", "torque_constant")
_COGGING = {row.name for row in TERMS.values() if row.name.startswith("cogging")}
_BEYOND = 1e6  # of effort, velocity or way, where no limit is known and URDF wants one

OF_MJLAB = (
    "mjlab 1.6.0 needs MuJoCo 3.11, butterfly 4: give mjlab an environment of its own (python -m "
    "venv mjlab && mjlab/bin/pip install mjlab)."
)
"""What there is to say of its installation."""


def as_urdf(twin: Twin, options: Options) -> Written:
    """Return a twin as URDF, with what URDF cannot say in comments."""
    error, p, steps = _accuracy(twin, options), twin.loaded, _late_steps(twin, options)
    missing = [_effort(twin)]
    if steps:
        late = f"{_steps_text(steps, options)} (delay {1e3 * p.delay:.3g} ms)"
        missing.append(f"Delay each effort yourself by {late}.")
    if twin.servo is not None:
        law = twin.servo.law
        missing.append(f"The servo's loop ({law}) is not included: the command is its drive's.")
    if p.p2 or p.coulomb:
        missing.append(
            "Importers may drop damping and friction (Isaac Sim 6.1.0, IsaacSim#841): check both."
        )
    missing += left_out(twin, "URDF")
    first = (f"{twin.name}, as identified.", *twin.log_lines)
    notes = (*first, *missing, "In MuJoCo, driven this way:", *error.lines)
    comments, name = "\n  ".join(map(xml_comment, notes)), twin.identifier
    kind, joint, axis = "continuous", "hinge", "0 -1 0"
    if slides := twin.shape is Shape.SLIDE:
        kind, joint, axis = "prismatic", "slide", "1 0 0"
    mass, offset, below, inertia = twin.body
    limit = ""
    if slides or math.isfinite(twin.limit):  # a slide has to have limits
        effort = abs(p.p4) * twin.limit
        velocity = effort / p.back_emf if p.back_emf else math.inf
        ends = f'lower="{-_BEYOND!r}" upper="{_BEYOND!r}" ' if slides else ""
        most = f'effort="{min(effort, _BEYOND)!r}" velocity="{min(velocity, _BEYOND)!r}"'
        limit = f"\n    <limit {ends}{most}/>"
    text = f"""<?xml version="1.0"?>
<robot name="{name}">
  {comments}
  <link name="base"/>
  <link name="{name}">
    <inertial>
      <origin xyz="{offset!r} 0 {-below!r}"/>
      <mass value="{mass!r}"/>
      <inertia ixx="{inertia!r}" iyy="{inertia!r}" izz="{inertia!r}" ixy="0" ixz="0" iyz="0"/>
    </inertial>
  </link>
  <joint name="{joint}" type="{kind}">
    <parent link="base"/>
    <child link="{name}"/>
    <origin xyz="0 0 0" rpy="{0.0 - p.tilt!r} 0 0"/>
    <axis xyz="{axis}"/>
    <dynamics damping="{p.p2!r}" friction="{p.coulomb!r}"/>{limit}
  </joint>
</robot>
"""
    about = f"URDF of {kind} joint {joint!r}, link {name!r}"
    return Written(text=text, about=about, left_out=tuple(missing), accuracy=error)


def as_actuator(twin: Twin, options: Options) -> Written:
    """Return the fields of a twin's actuator in mjlab and in Isaac Lab."""
    p, steps = twin.loaded, _late_steps(twin, options)
    native, of_mjlab, takes = _of_mjlab(twin, steps)
    name, of_isaac_lab = _of_isaac_lab(twin, steps)
    notes = [*_of_loop(twin), *takes]
    if p.delay > 0:
        notes.append(
            f"The delay of {1e3 * p.delay:.3g} ms is written as {_steps_text(steps, options)}."
        )
    if steps and name == "DCMotorCfg":
        notes.append("Isaac Lab's DCMotorCfg has no delay.")
    if "armature" not in of_mjlab:
        notes.append(
            f"Set armature yourself: p1 ({p.p1:.6g}) minus the inertia of your body, without the "
            "motor, about the axis."
        )
    held = set(_COGGING) if "cogging" in of_mjlab else set()
    if held:
        notes.append("Isaac Lab has no cogging; in mjlab its phase counts from angle 0 here.")
    notes += left_out(twin, "An actuator", held)
    loop = any(_loop(twin)[:2]) and twin.servo is not None
    error = None if loop else _accuracy(twin, options, held)
    measured = ["In MuJoCo, driven by efforts as in mjlab:", *error.lines] if error else []
    content = {
        "name": twin.name,
        "timestep": options.timestep,
        "mjlab": {"class": native, "fields": of_mjlab},
        "isaaclab": {"class": name, "fields": of_isaac_lab},
        "gain": {"value": p.p4 or 1.0, "unit": unit_of("p4", twin.kind, twin.joint)},
        "body": {"inertia_about_axis": p.p1, "gravity_moment": p.p3},
        "notes": [*twin.log_lines, *notes, OF_MJLAB, *measured],
    }
    about = f"{native} of mjlab, {name} of Isaac Lab"
    text = json_text(content)
    return Written(text=text, about=about, left_out=tuple(notes), accuracy=error, notes=(OF_MJLAB,))


def _of_mjlab(twin: Twin, steps: int) -> tuple[str, dict[str, Any], list[str]]:
    """Return class and fields of mjlab's native actuator, and what there is to say of them."""
    p, (kp, kd, limit) = twin.loaded, _loop(twin)
    shared: dict[str, Any] = {"target_names_expr": [joint_name(twin)], **_armature(twin)}
    shared |= {"frictionloss": p.coulomb, "viscous_damping": p.p2}
    shared |= {"delay_min_lag": steps, "delay_max_lag": steps}
    least = {"effort_limit": p.p4 * limit} if math.isfinite(limit) else {}
    takes = f"mjlab's effort target is the command itself, in {twin.kind.unit}"
    looped, bounded = bool(kp or kd), math.isfinite(limit)
    volts = twin.kind is InputKind.VOLTAGE or bool(p.back_emf)
    electric = volts and p.p2 > 0 and p.p4 > 0
    if electric and (bounded or not looped):
        damping, source = motor_damping(p, twin.known)
        constant = damping / p.p4
        motor = {"kt": constant, "ke": constant, "resistance": damping / p.p4**2}
        fields = shared | {"viscous_damping": p.p2 - damping, "motor_params": motor}
        fields |= {"mode": 1 if kp else 2 if kd else 0}
        if looped:
            fields |= {"stiffness": kp, "damping": kd} if kp else {"stiffness": kd}
        if bounded:
            fields["voltage_limit"] = limit
        if p.cogging or p.cogging_cosine:
            size = math.hypot(p.cogging, p.cogging_cosine)
            phase = math.atan2(p.cogging_cosine, p.cogging)
            fields["cogging"] = [size, p.cogging_periods, phase]
        sentences = [f"kt, ke and resistance, at the joint: {source}."]
        if not looped:
            clip = f"; it does not clip it: do so at ±{limit:g}" if bounded else ""
            sentences.append(f"{takes}{clip}.")
        return "BuiltinDcMotorActuatorCfg", fields, sentences
    if kp:
        gains = {"stiffness": p.p4 * kp, "damping": p.p4 * kd}
        return "BuiltinPdActuatorCfg", shared | gains | least, []
    if kd:
        return "BuiltinVelocityActuatorCfg", shared | {"damping": p.p4 * kd} | least, []
    motor = {"gear": p.p4 or 1.0, "effort_limit": limit if bounded else _BEYOND}
    return "BuiltinMotorActuatorCfg", shared | motor, [f"{takes}."] if p.p4 else []


def _of_isaac_lab(twin: Twin, steps: int) -> tuple[str, dict[str, Any]]:
    """Return class and fields of Isaac Lab's actuator."""
    p = twin.loaded
    stiffness, damping, effort, speed = drive_at_joint(twin)
    is_motor = math.isfinite(speed)
    fields: dict[str, Any] = {"joint_names_expr": [joint_name(twin)]}
    fields |= {"stiffness": stiffness, "damping": damping}
    if math.isfinite(effort):
        fields["actuator_effort_limit"] = effort
    if is_motor:
        fields |= {"saturation_effort": effort, "actuator_velocity_limit": speed}
    fields |= {
        **_armature(twin),
        "friction": p.coulomb + p.stribeck,
        "dynamic_friction": p.coulomb,
        "viscous_friction": p.p2 - (p.back_emf if is_motor else 0.0),
    }
    if is_motor:
        return "DCMotorCfg", fields
    if steps:
        return "DelayedPDActuatorCfg", fields | {"min_delay": steps, "max_delay": steps}
    return "IdealPDActuatorCfg", fields


def joint_name(twin: Twin) -> str:
    """Return the name of the joint in the models of a twin."""
    return "slide" if twin.shape is Shape.SLIDE else "hinge"


def _armature(twin: Twin) -> dict[str, float]:
    """Return the armature of a rotor that was known."""
    known = {name: quantity.value for name, quantity in twin.known.physical.items()}
    if "rotor_inertia" not in known:
        return {}
    return {"armature": known.get("gear_ratio", 1.0) ** 2 * known["rotor_inertia"]}


def drive_at_joint(twin: Twin) -> tuple[float, float, float, float]:
    """Return stiffness, damping with the back EMF, effort at standstill and speed without load.

    Without a servo's loop its gains are 0; a limit that is not known is `math.inf`.
    """
    p, (kp, kd, limit) = twin.parameters, _loop(twin)
    effort = p.p4 * limit
    speed = effort / p.back_emf if p.back_emf else math.inf
    damping = p.p4 * kd + (p.back_emf if math.isfinite(speed) else 0.0)
    return p.p4 * kp, damping, effort, speed


def _loop(twin: Twin) -> tuple[float, float, float]:
    """Return a servo's gains on angle and velocity, and the limit, in units of the command."""
    p, servo, limit, worth = twin.parameters, twin.servo, twin.limit, _worth(twin)
    if servo is None or worth is None:
        return 0.0, 0.0, limit
    kp, _, kd = servo.gains_si
    kp, kd = worth * p.loop_kp * kp, worth * p.loop_kd * kd
    if servo.rule.structure is LawStructure.CASCADE:
        kp *= servo.gains_si[2] * p.loop_kd
    elif servo.rule.structure is LawStructure.SPEED:
        kp, kd = 0.0, kp
    most = servo.rule.limit if servo.limit is None else servo.limit
    return kp, kd, min(limit, worth * most)


def _worth(twin: Twin) -> float | None:
    """Return the drive's command for one unit of what a servo's law makes; None if not known."""
    if twin.servo is None or twin.servo.rule.output is not Output.DUTY:
        return 1.0
    return 1.0 if twin.kind is InputKind.DUTY else twin.servo.supply


def _of_loop(twin: Twin) -> Iterator[str]:
    """Say what the targets are, and what they do not include."""
    if (servo := twin.servo) is None:
        yield f"Isaac Lab: {_effort(twin)}" if twin.parameters.p4 else _effort(twin)
    elif _worth(twin) is None:
        yield (
            f"No stiffness and damping: the loop ({servo.law}) needs its supply in V "
            "(loop: {supply: ...})."
        )
    elif not servo.kp.value:
        yield f"No stiffness and damping: kp of the loop ({servo.law}) is unknown."
    else:
        yield f"Targets are the set-points of the servo's loop ({servo.law})."
        if rest := told_of(servo, _OF_LOOP):
            yield f"Not included from that loop: {', '.join(rest)}."
        yield "The error against our own simulation is not measured for this loop."


def _late_steps(twin: Twin, options: Options) -> int:
    """Return by how many whole steps a command is late."""
    return max(round(twin.parameters.delay / options.timestep), 0)


def _steps_text(steps: int, options: Options) -> str:
    return f"{steps} step{'' if steps == 1 else 's'} of {1e3 * options.timestep:g} ms"


def _accuracy(twin: Twin, options: Options, more: Collection[str] = ()) -> Accuracy:
    """Measure the joint of such a format as MuJoCo simulates it, with its own settings of friction.

    Terms that such formats cannot hold are left out, save ``more``; the delay is in whole steps.
    """
    steps = _late_steps(twin, options)
    move = mover(options, Form(grip=None, delay="whole" if steps else "none"))

    def moved(case: Case) -> Samples:
        values = {name: getattr(case.twin.parameters, name) for name in names}
        p = LumpedParameters(**values | {"delay": steps * options.timestep})
        return move(replace(case, twin=replace(case.twin, parameters=p, robot=None)))

    names = [field.name for field in fields(LumpedParameters) if field.name in {*HELD, *more}]
    return Yardstick.of(twin, options.timestep).accuracy(moved)


def _effort(twin: Twin) -> str:
    """Say what a command is worth."""
    unit = unit_of("coulomb", joint=twin.joint)
    if not twin.parameters.p4:
        return f"p4 is unknown: nothing drives the joint. Effort is in {unit}."
    worth = f"{twin.parameters.p4:.6g} {unit}"
    return f"Compute the effort yourself: command times {worth} per {twin.kind.unit} (p4)."


def left_out(twin: Twin, form: str, held: Collection[str] = ()) -> Iterator[str]:
    """Say what the joint has beyond this, and beyond what else is ``held``."""
    if rest := beyond(twin.loaded, {*HELD, *LOOP_TERMS, *held, "back_emf"}):
        yield f"{form} cannot represent {listed(twin.loaded, rest, twin.kind.unit)}."
    if twin.resolution:
        yield f"{form} does not round commands: round to multiples of {twin.resolution:g} yourself."
    if twin.built[0].clutch:
        yield f"{form} cannot represent the play of the clutch."
