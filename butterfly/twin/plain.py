"""A joint as most formats have it: URDF, and JSON of an actuator of mjlab and of Isaac Lab.

They have inertia, gravity, one damping and one level of dry friction; whoever drives them
multiplies the command by p4, and sends it so many steps later.

URDF's elements and units are those of the wiki pages urdf/XML/link and urdf/XML/joint of ROS:
``dynamics`` has damping in N m s/rad and friction in N m, ``limit`` effort in N m and velocity in
rad/s. Both actuators drive a joint by ``stiffness (q* - q) + damping (v* - v) + effort``, clipped
at +-effort_limit and, for a motor, between ``+-saturation_effort - saturation_effort
v/velocity_limit``: a limit of voltage, with the back EMF as damping. Delays are in physics steps.
mjlab: names of 1.6.0, src/mjlab/actuator/{actuator,pd_actuator,dc_actuator}.py of mujocolab/mjlab
018e7ee. Isaac Lab: of 2.3.2, actuator_{base,pd}_cfg.py of isaac-sim/IsaacLab 17ad46e and 01ff1d8;
3.0 reads them too, and calls the limits actuator_effort_limit and actuator_velocity_limit.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import fields, replace

from butterfly.arrays import Samples
from butterfly.files import json_text
from butterfly.identification.parameter import unit_of
from butterfly.logs.log import InputKind
from butterfly.model.parameters import LumpedParameters
from butterfly.model.servo import LawStructure, Output
from butterfly.model.terms import LOOP_TERMS, held_by
from butterfly.plant.robot import Shape
from butterfly.twin.accuracy import Case, Yardstick
from butterfly.twin.forms import Options, xml_comment
from butterfly.twin.stand_alone import Form, mover
from butterfly.twin.twin import Accuracy, Twin, Written, beyond, listed, told_of

_HELD = {*held_by("urdf"), "gravity", "carried_moment"}
_OF_LOOP = ("law", "kp", "kd", "limit", "supply", "clock", "torque_constant")
_BEYOND = 1e6  # of effort, velocity or way, where no limit is known and URDF wants one


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
    stiffness, damping, effort, speed = drive_at_joint(twin)
    known = {name: quantity.value for name, quantity in twin.known.physical.items()}
    joints = ["slide" if twin.shape is Shape.SLIDE else "hinge"]
    shared = {"stiffness": stiffness, "damping": damping}
    if math.isfinite(effort):
        shared["effort_limit"] = effort
    if is_motor := math.isfinite(speed):
        shared |= {"saturation_effort": effort, "velocity_limit": speed}
    if "rotor_inertia" in known:
        shared["armature"] = known.get("gear_ratio", 1.0) ** 2 * known["rotor_inertia"]
    viscous = p.p2 - (p.back_emf if is_motor else 0.0)
    mjlab = {
        "target_names_expr": joints,
        **shared,
        "frictionloss": p.coulomb,
        "viscous_damping": viscous,
        "delay_min_lag": steps,
        "delay_max_lag": steps,
    }
    isaaclab = {
        "joint_names_expr": joints,
        **shared,
        "friction": p.coulomb + p.stribeck,
        "dynamic_friction": p.coulomb,
        "viscous_friction": viscous,
    }
    name = "IdealPDActuatorCfg"
    if is_motor:
        name = "DCMotorCfg"
    elif steps:
        name = "DelayedPDActuatorCfg"
        isaaclab |= {"min_delay": steps, "max_delay": steps}
    notes = [*_of_loop(twin)]
    if p.delay > 0:
        notes.append(
            f"The delay of {1e3 * p.delay:.3g} ms is written as {_steps_text(steps, options)}."
        )
    if steps and is_motor:
        notes.append("Isaac Lab's DCMotorCfg has no delay.")
    if "armature" not in shared:
        notes.append(
            f"Set armature yourself: p1 ({p.p1:.6g}) minus the inertia of your body, without the "
            "motor, about the axis."
        )
    if p.coulomb or p.stribeck:
        notes.append("Isaac Lab's friction is a torque since Isaac Sim 5.0, a coefficient before.")
    notes += left_out(twin, "An actuator")
    loop = bool(stiffness or damping) and twin.servo is not None
    error = None if loop else _accuracy(twin, options)
    measured = ["In MuJoCo, driven by efforts as in mjlab:", *error.lines] if error else []
    actuator = "DcMotorActuatorCfg" if is_motor else "IdealPdActuatorCfg"
    content = {
        "name": twin.name,
        "timestep": options.timestep,
        "mjlab": {"class": actuator, "fields": mjlab},
        "isaaclab": {"class": name, "fields": isaaclab},
        "gain": {"value": p.p4 or 1.0, "unit": unit_of("p4", twin.kind, twin.joint)},
        "body": {"inertia_about_axis": p.p1, "gravity_moment": p.p3},
        "notes": [*twin.log_lines, *notes, *measured],
    }
    about = f"{actuator} of mjlab, {name} of Isaac Lab"
    return Written(text=json_text(content), about=about, left_out=tuple(notes), accuracy=error)


def drive_at_joint(twin: Twin) -> tuple[float, float, float, float]:
    """Return stiffness, damping with the back EMF, effort at standstill and speed without load.

    Without a servo's loop its gains are 0; a limit that is not known is `math.inf`.
    """
    p, servo, limit, worth = twin.parameters, twin.servo, twin.limit, _worth(twin)
    kp = kd = 0.0
    if servo is not None and worth is not None:
        kp, _, kd = servo.gains_si
        kp, kd = worth * p.loop_kp * kp, worth * p.loop_kd * kd
        if servo.rule.structure is LawStructure.CASCADE:
            kp *= servo.gains_si[2] * p.loop_kd
        elif servo.rule.structure is LawStructure.SPEED:
            kp, kd = 0.0, kp
        most = servo.rule.limit if servo.limit is None else servo.limit
        limit = min(limit, worth * most)
    effort = p.p4 * limit
    speed = effort / p.back_emf if p.back_emf else math.inf
    damping = p.p4 * kd + (p.back_emf if math.isfinite(speed) else 0.0)
    return p.p4 * kp, damping, effort, speed


def _worth(twin: Twin) -> float | None:
    """Return the drive's command for one unit of what a servo's law makes; None if not known."""
    if twin.servo is None or twin.servo.rule.output is not Output.DUTY:
        return 1.0
    return 1.0 if twin.kind is InputKind.DUTY else twin.servo.supply


def _of_loop(twin: Twin) -> Iterator[str]:
    """Say what the targets are, and what they do not include."""
    if (servo := twin.servo) is None:
        yield _effort(twin)
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


def _accuracy(twin: Twin, options: Options) -> Accuracy:
    """Measure the joint of such a format as MuJoCo simulates it, with its own settings of friction.

    Terms that such formats cannot hold are left out; the delay is in whole steps.
    """
    steps = _late_steps(twin, options)
    move = mover(options, Form(grip=None, delay="whole" if steps else "none"))

    def moved(case: Case) -> Samples:
        values = {name: getattr(case.twin.parameters, name) for name in names}
        p = LumpedParameters(**values | {"delay": steps * options.timestep})
        return move(replace(case, twin=replace(case.twin, parameters=p, robot=None)))

    names = [field.name for field in fields(LumpedParameters) if field.name in _HELD]
    return Yardstick.of(twin, options.timestep).accuracy(moved)


def _effort(twin: Twin) -> str:
    """Say what a command is worth."""
    unit = unit_of("coulomb", joint=twin.joint)
    if not twin.parameters.p4:
        return f"p4 is unknown: nothing drives the joint. Effort is in {unit}."
    worth = f"{twin.parameters.p4:.6g} {unit}"
    return f"Compute the effort yourself: command times {worth} per {twin.kind.unit} (p4)."


def left_out(twin: Twin, form: str) -> Iterator[str]:
    """Say what the joint has beyond this."""
    if rest := beyond(twin.loaded, {*_HELD, *LOOP_TERMS, "back_emf"}):
        yield f"{form} cannot represent {listed(twin.loaded, rest, twin.kind.unit)}."
    if twin.resolution:
        yield f"{form} does not round commands: round to multiples of {twin.resolution:g} yourself."
    if twin.built[0].clutch:
        yield f"{form} cannot represent the play of the clutch."
