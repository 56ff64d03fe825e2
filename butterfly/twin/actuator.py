"""A twin's actuator as JSON, under the names of mjlab and of Isaac Lab.

Both drive a joint by ``stiffness (q* - q) + damping (v* - v) + effort``, clipped at +-effort_limit
and, for a motor, between ``+-saturation_effort - saturation_effort v/velocity_limit``: a limit of
voltage, with the back EMF as damping. Delays are in physics steps. mjlab: names of 1.6.0,
src/mjlab/actuator/{actuator,pd_actuator,dc_actuator}.py of mujocolab/mjlab 018e7ee. Isaac Lab: of
2.3.2, actuator_{base,pd}_cfg.py of isaac-sim/IsaacLab 17ad46e and 01ff1d8; 3.0 reads them too, and
calls the limits actuator_effort_limit and actuator_velocity_limit.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

from butterfly.files import json_text
from butterfly.logs.log import InputKind
from butterfly.model.servo import LawStructure, Output
from butterfly.plant.robot import Shape
from butterfly.twin.forms import Options
from butterfly.twin.plain import (
    accuracy,
    effort_text,
    effort_unit,
    late_steps,
    left_out,
    steps_text,
)
from butterfly.twin.twin import Twin, Written, told_of

_OF_LOOP = ("law", "kp", "kd", "limit", "supply", "clock", "torque_constant")


class _Drive(NamedTuple):
    """What both frameworks ask of a drive; `math.inf` is a limit that is not known."""

    stiffness: float = 0.0  # N m/rad
    damping: float = 0.0  # N m s/rad
    effort: float = math.inf  # N m at standstill
    speed: float = math.inf  # rad/s at which no torque is left


def as_actuator(twin: Twin, options: Options) -> Written:
    """Return the fields of a twin's actuator in mjlab and in Isaac Lab."""
    p, steps = twin.loaded, late_steps(twin, options)
    drive, notes = _drive(twin), tuple(_notes(twin, options))
    joints = ["slide" if twin.built[0].shape is Shape.SLIDE else "hinge"]
    shared = {"stiffness": drive.stiffness, "damping": drive.damping}
    if math.isfinite(drive.effort):
        shared["effort_limit"] = drive.effort
    if is_motor := math.isfinite(drive.speed):
        shared |= {"saturation_effort": drive.effort, "velocity_limit": drive.speed}
    if (armature := _armature(twin)) is not None:
        shared["armature"] = armature
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
    loop = bool(drive.stiffness or drive.damping) and twin.servo is not None
    error = None if loop else accuracy(twin, options)
    measured = ["In MuJoCo, driven by efforts as in mjlab:", *error.lines] if error else []
    own = "DcMotorActuatorCfg" if is_motor else "IdealPdActuatorCfg"
    content = {
        "name": twin.name,
        "timestep": options.timestep,
        "mjlab": {"class": own, "fields": mjlab},
        "isaaclab": {"class": name, "fields": isaaclab},
        "gain": {"value": p.p4 or 1.0, "unit": f"{effort_unit(twin)}/{twin.kind.unit}"},
        "body": {"inertia_about_axis": p.p1, "gravity_moment": p.p3},
        "notes": [*twin.zero_lines, *notes, *measured],
    }
    about = f"{own} of mjlab, {name} of Isaac Lab"
    return Written(text=json_text(content), about=about, left_out=notes, accuracy=error)


def _drive(twin: Twin) -> _Drive:
    """Return the loop of a servo, or a drive that takes efforts, and its limits."""
    p, servo, limit, worth = twin.parameters, twin.servo, twin.limit, _worth(twin)
    kp = kd = 0.0
    if servo is not None and worth is not None:
        kp, _, kd = servo.told
        kp, kd = worth * p.loop_kp * kp, worth * p.loop_kd * kd
        if servo.rule.structure is LawStructure.CASCADE:
            kp *= servo.told[2] * p.loop_kd
        elif servo.rule.structure is LawStructure.SPEED:
            kp, kd = 0.0, kp
        most = servo.rule.limit if servo.limit is None else servo.limit
        limit = min(limit, worth * most)
    effort = p.p4 * limit
    speed = effort / p.back_emf if p.back_emf else math.inf
    damping = p.p4 * kd + (p.back_emf if math.isfinite(speed) else 0.0)
    return _Drive(p.p4 * kp, damping, effort, speed)


def _worth(twin: Twin) -> float | None:
    """Return the drive's command for one unit of what a servo's law makes; None if not known."""
    if twin.servo is None or twin.servo.rule.output is not Output.DUTY:
        return 1.0
    return 1.0 if twin.kind is InputKind.DUTY else twin.servo.supply


def _armature(twin: Twin) -> float | None:
    """Return the inertia in kg m² of a rotor that was known."""
    known = {name: each.value for name, each in twin.known.physical.items()}
    rotor = known.get("rotor_inertia")
    return None if rotor is None else known.get("gear_ratio", 1.0) ** 2 * rotor


def _notes(twin: Twin, options: Options) -> Iterator[str]:
    """Explain the numbers, and what they do not include."""
    p, servo, steps = twin.loaded, twin.servo, late_steps(twin, options)
    if servo is None:
        yield effort_text(twin)
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
    if p.delay > 0:
        yield f"The delay of {1e3 * p.delay:.3g} ms is written as {steps_text(twin, options)}."
    if steps and math.isfinite(_drive(twin).speed):
        yield "Isaac Lab's DCMotorCfg has no delay."
    if _armature(twin) is None:
        yield (
            f"Set armature yourself: p1 ({p.p1:.6g}) minus the inertia of your body, without the "
            "motor, about the axis."
        )
    if p.coulomb or p.stribeck:
        yield "Isaac Lab's friction is a torque since Isaac Sim 5.0, a coefficient before."
    yield from left_out(twin, "An actuator")
