"""Lines to paste into one's own MJCF: the joint, its actuators, and a body where there is none."""

from __future__ import annotations

from collections.abc import Iterator
from xml.etree import ElementTree

import mujoco

from butterfly.identification.parameter import unit_of
from butterfly.plant.mjcf import named, text_of
from butterfly.plant.robot import Shape
from butterfly.twin.forms import Options, xml_comment
from butterfly.twin.stand_alone import stand_alone
from butterfly.twin.twin import Twin, Written


def as_snippet(twin: Twin, options: Options) -> Written:
    """Return the lines of a twin that go into one's own MJCF, each with what it is."""
    made, robot = stand_alone(twin, options), twin.built[0]
    left_out = [*made.left_out]
    if aside := [name for name in ("base", "clutch") if getattr(robot, name)]:
        left_out.append(
            f"Not in these lines: the {' and the '.join(aside)}. Use the whole model (--to mjcf)."
        )
    accuracy = None if aside else made.accuracy
    joint = named(made.root, "slide" if robot.shape is Shape.SLIDE else "hinge")
    actuators = next(made.root.iter("actuator"))
    joint.set("name", twin.identifier)
    joint.set("armature", "0")
    for actuator in actuators:
        actuator.attrib |= {
            "name": f"{twin.identifier}_{actuator.get('name')}",
            "joint": twin.identifier,
        }
    ElementTree.indent(actuators)
    head = (
        f"{twin.name}: lines for your own MJCF. Written for MuJoCo {mujoco.__version__}.",
        f'Only for <option timestep="{options.timestep:g}" integrator="{options.integrator}"/>; '
        "export again for another step.",
        *(*made.notes, *left_out, *(accuracy.lines if accuracy else ())),
    )
    on_joint = [
        "1. Joint: replaces the joint of your body. Set your own name, axis, pos and range.",
        "Angle 0 is the hanging position, axis horizontal. If your zero differs, adapt ref, "
        "springref and the phase of cogging.",
        "damping: viscous friction, then drag. frictionloss: friction at rest. solreffriction and "
        "solimpfriction: its stiffness, for this step.",
    ]
    if twin.shape is Shape.SLIDE:
        del on_joint[1]
    parts = (
        *map(xml_comment, head),
        *("", *map(xml_comment, on_joint)),
        text_of(joint).strip(),
        *("", *map(xml_comment, _on_body(twin))),
        xml_comment(f" {inertial(twin)} "),
        *("", *map(xml_comment, _on_actuators(twin))),
        text_of(actuators).strip(),
    )
    return Written(
        text="\n".join((*parts, "")),
        about=f"lines for your own MJCF, joint {twin.identifier!r}",
        left_out=tuple(left_out),
        accuracy=accuracy,
    )


def inertial(twin: Twin) -> str:
    """Return the MJCF of the body that swings, with what it carries."""
    mass, offset, below, inertia = twin.body
    turns = " ".join([repr(inertia)] * 3)
    return f'<inertial pos="{offset!r} 0 {-below!r}" mass="{mass!r}" diaginertia="{turns}"/>'


def _on_body(twin: Twin) -> Iterator[str]:
    p = twin.loaded
    if twin.shape is Shape.SLIDE:
        yield f"2. Body. p1 = {p.p1:.6g} kg is the total moving mass, motor included."
        yield f"a) If your body has the mass m without the motor: armature = {p.p1:.6g} - m."
    else:
        yield (
            f"2. Body. p1 = {p.p1:.6g} kg m² is the total inertia about the axis, motor included; "
            f"p3 = {p.p3:.6g} N m is the gravity moment m g l."
        )
        yield (
            "a) If your body has the inertia I about the axis without the motor: armature = "
            f"{p.p1:.6g} - I. Its m g l must equal p3."
        )
        if p.p3_offset or p.tilt:
            yield (
                f"Its centre of mass is offset {twin.body.offset:.4g} m to the side; the axis is "
                f"tilted {p.tilt:.4g} rad from horizontal."
            )
    yield (
        'b) If your body has no mass yet: armature="0", and add the next line to it, in a frame '
        "with the axis as above and gravity along -z at angle 0."
    )


def _on_actuators(twin: Twin) -> Iterator[str]:
    p, worth = (
        twin.parameters,
        f"{twin.built[0].drive.gain:.6g} {unit_of('coulomb', joint=twin.joint)}",
    )
    yield (
        f"3. Drive. ctrl of {twin.identifier}_motor is the command: {worth} per {twin.kind.unit} "
        "at standstill. Set it to the command's mean over each step."
    )
    others = {
        "slip: the drop of Stribeck friction with velocity": p.stribeck,
        "bias: a constant torque": p.bias,
        "cogging: a torque that repeats over a turn": p.cogging or p.cogging_cosine,
        "bristles: friction that is elastic before it slides": p.bristle_stiffness,
    }
    if descriptions := [text for text, there in others.items() if there]:
        yield f"Leave ctrl of the other actuators at 0. {'; '.join(descriptions)}."
