"""A joint in MJCF: a model that stands alone, or a snippet for another one."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple
from xml.etree import ElementTree

import mujoco
import numpy as np
from mujoco import rollout

from butterfly.arrays import Samples
from butterfly.identification.trust import unit_of
from butterfly.model.parameters import LumpedParameters
from butterfly.model.terms import BEYOND_MUJOCO
from butterfly.plant.mjcf import built, hinge_of, named, text_of
from butterfly.plant.robot import Shape
from butterfly.twin.forms import DEFAULTS, Options, xml_comment
from butterfly.twin.twin import NO_DELAY, Accuracy, Case, Mover, Twin, Written, Yardstick, unheard

GRIPS = (0.12, 0.25, 0.06)
"""Time constants in steps with which dry friction stops the joint, the usual first."""

_KNOTS = 12  # of the polygon that stands for Stribeck's curve,
_REACH = 3.0  # Stribeck velocities long: there all but 1e-4 is lost
_CROWD = 1.3  # by which power they crowd about 0, where most logs are
_FINE = 4001  # points at which the polygon is fitted to the curve
_NO_GAIN = 1e-30  # MuJoCo takes a gain of 0 beside a slope for a damping ratio


class Form(NamedTuple):
    """One way to write a twin at a step."""

    # time constant in steps with which dry friction stops the joint; None for MuJoCo's own
    grip: float | None = GRIPS[0]
    # how a delay is written: none, in whole steps, between past commands, or half a step later
    delay: str = "whole"

    def late(self, delay: float, step: float) -> float | None:
        """Return MuJoCo's delay of a command in s; None for none."""
        if self.delay == "none" or delay <= NO_DELAY:
            return None
        if self.delay == "whole":
            return max(round(delay / step), 1) * step
        return float(max(delay + (step / 2 if self.delay == "later" else 0.0), step))


@dataclass(frozen=True, kw_only=True)
class StandAlone:
    """A twin's MJCF, how far it moves as ours does, and in sentences what it leaves out."""

    root: ElementTree.Element
    accuracy: Accuracy
    left_out: tuple[str, ...]
    notes: tuple[str, ...]  # on the encoder's zero, and a delay that is written as another


def as_mjcf(twin: Twin, options: Options) -> Written:
    """Return a twin as a file for plain MuJoCo."""
    made = stand_alone(twin, options)
    name = "the butterfly's hand" if twin.shape is Shape.BUTTERFLY else f"joint {twin.identifier!r}"
    first = (
        f"{twin.name}: a complete model for plain MuJoCo. ctrl[0] (motor) is the command, as its "
        "mean over each step; leave other ctrl at 0."
    )
    head, rest = text_of(made.root).split("\n", 1)
    comments = map(xml_comment, [first, *made.notes, *made.left_out, *made.accuracy.lines])
    step = f"steps of {1e3 * options.timestep:g} ms by {options.integrator}"
    return Written(
        text="\n  ".join([head, *comments, rest.lstrip()]),
        about=f"{name} in {step}",
        left_out=made.left_out,
        accuracy=made.accuracy,
    )


def stand_alone(twin: Twin, options: Options = DEFAULTS) -> StandAlone:
    """Return a twin that moves by itself in plain MuJoCo, in the most exact form for its step."""
    yardstick = Yardstick.of(twin, options.timestep)
    form = _best(twin, options, yardstick)
    return StandAlone(
        root=_root(twin, options, form),
        accuracy=yardstick.accuracy(mover(options, form)),
        left_out=tuple(_left_out(twin, form)),
        notes=(*twin.log_lines, *_late(twin.parameters.delay, form, options.timestep)),
    )


def _best(twin: Twin, options: Options, yardstick: Yardstick) -> Form:
    """Return the form that strays least from our own simulation of some logs."""
    forms = [Form()]
    if twin.parameters.delay > NO_DELAY:
        short = ("none",) if twin.parameters.delay < options.timestep else ()
        forms = [Form(delay=delay) for delay in (*short, "whole", "later", "between")]
    error = cache(lambda form: yardstick.worst_of_some(mover(options, form)))
    best = min(forms, key=error) if len(forms) > 1 else forms[0]
    if twin.loaded.holding:
        best = min((best._replace(grip=grip) for grip in GRIPS), key=error)
    return best


def mover(options: Options, form: Form) -> Mover:
    """Return what moves a twin in MuJoCo, in one form."""

    def move(case: Case) -> Samples:
        model = mujoco.MjModel.from_xml_string(text_of(_root(case.twin, options, form)))
        data = mujoco.MjData(model)
        hinge = hinge_of(model)
        data.qpos[hinge], data.qvel[hinge] = case.angle, case.velocity
        if remembered := model.actuator_history[0, 0]:
            mujoco.mj_initCtrlHistory(model, data, 0, None, case.past[-remembered:, None])
        state = np.zeros((1, mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
        mujoco.mj_getState(model, data, state[0], mujoco.mjtState.mjSTATE_FULLPHYSICS)
        controls = np.zeros((1, case.commands.size, model.nu))
        controls[0, :, 0] = case.commands
        reached, _ = rollout.rollout(model, data, state, controls)
        return np.append(case.angle, reached[0, :, 1 + hinge])

    return move


def _root(twin: Twin, options: Options, form: Form) -> ElementTree.Element:
    """Return the MJCF of a twin in one form."""
    (robot, added), step = twin.built, options.timestep
    friction, braking = robot.loaded(added), robot.friction
    if braking.sticks_harder:  # dry friction is at all velocities what it is at rest
        rigid = replace(braking, coulomb=braking.holding, stribeck=0.0)
        braking = replace(rigid, **dict.fromkeys(BEYOND_MUJOCO, 0.0))
    root = built(replace(robot, friction=braking), added, scene=False)
    next(root.iter("option")).attrib |= {"timestep": repr(step), "integrator": options.integrator}
    joint = named(root, "hinge")
    if form.grip is None:
        del joint.attrib["solreffriction"], joint.attrib["solimpfriction"]
    else:  # which, said so, grips within a step whatever the flags of the model are
        joint.set("solreffriction", f"-1 {gripping(form.grip, step)!r}")
    motor = named(root, "motor")
    if math.isfinite(twin.limit):
        motor.set("ctrlrange", f"{-twin.limit!r} {twin.limit!r}")
    if (late := form.late(twin.parameters.delay, step)) is not None:
        motor.attrib |= {
            "delay": repr(late),
            "nsample": str(_samples(late, step)),
            "interp": "zoh" if form.delay == "whole" else "linear",
        }
    if friction.stribeck and not friction.bristle_stiffness:
        next(root.iter("actuator")).extend(_slips(friction))
    if robot.shape is not Shape.BUTTERFLY:
        root.set("model", twin.identifier)
        named(root, "hand").set("name", twin.identifier)
    if robot.shape is Shape.SLIDE:
        for node in root.iter():
            node.attrib |= {k: "slide" for k in ("name", "joint") if node.get(k) == "hinge"}
    return root


def gripping(grip: float, step: float) -> float:
    """Return the second number of ``solreffriction``, after -1, of a time constant in steps.

    Said so, friction grips within a step whatever the flags of the model are.
    """
    return -2 / (grip * step)


def _left_out(twin: Twin, form: Form) -> Iterator[str]:
    """Name what the file cannot represent, and the remedies."""
    p = twin.loaded
    if beyond := [name for name in BEYOND_MUJOCO if getattr(p, name)]:
        yield (
            f"Not included: {', '.join(beyond)} (friction that depends on torque or angle). Set "
            "dof_frictionloss yourself in each step."
        )
    for flaw, remedy in (
        (twin.resolution, "does not round commands: set ctrl to multiples of {:g}"),
        (p.dead_zone, "has no dead zone: move ctrl by up to {:g} towards 0"),
        (p.compression, "has no gain compression: set ctrl to u/(1 + {:g} |u|)"),
    ):
        if flaw > 0:
            yield f"MuJoCo {remedy.format(flaw)} yourself."
    if not p.p4:
        yield (
            "p4 is unknown: nothing drives the joint in the logs. ctrl has 1 N m per unit, a "
            "default."
        )
    if form.delay == "none" and p.delay > NO_DELAY:
        yield (
            f"The delay of {1e3 * p.delay:.3g} ms is not included: it is shorter than a step, and "
            "no delay is more accurate than a whole step."
        )
    yield from unheard(twin)


def _late(delay: float, form: Form, step: float) -> Iterator[str]:
    """Say why a delay in s is written as another."""
    late = form.late(delay, step)
    if late is None or abs(late - delay) <= NO_DELAY:
        return
    why = "of whole steps" if form.delay == "whole" else "of at least a step"
    if form.delay == "later":
        why = "half a step more: ctrl is a mean, of the middle of its step"
    yield f"The delay of {1e3 * delay:.4g} ms is written as {1e3 * late:.4g} ms, {why}."


def models(
    drawn: Iterable[LumpedParameters], twin: Twin, options: Options = DEFAULTS
) -> Iterator[str]:
    """Yield the MJCF of a twin with each set of parameters, all in the form that suits the twin."""
    form, step = _best(twin, options, Yardstick.of(twin, options.timestep)), options.timestep
    sets = list(drawn)
    remembered = 0
    if any(form.late(p.delay, step) is not None for p in sets):  # states of one size then
        sets = [replace(p, delay=max(p.delay, 2 * NO_DELAY)) for p in sets]
        remembered = max(_samples(form.late(p.delay, step) or 0.0, step) for p in sets)
    for parameters in sets:
        variant = replace(twin, parameters=parameters, robot=None)
        root = _root(variant, options, form)
        if remembered:
            named(root, "motor").set("nsample", str(remembered))
        yield text_of(root)


def _samples(late: float, step: float) -> int:
    """Count the past commands that a delay in s needs."""
    return math.ceil(late / step - 1e-9) + 1


def _slips(friction: LumpedParameters) -> list[ElementTree.Element]:
    """Return actuators that take from dry friction what it loses once the joint slides.

    T_s (1 - exp(-(v/v_s)^2)) sgn v is a polygon in v, and that a sum of ramps that end: negative
    dampers of limited torque, one for each knot.
    """
    knots = _REACH * np.linspace(0.0, 1.0, _KNOTS + 1) ** _CROWD
    slopes = np.diff(_polygon(knots)) / np.diff(knots)
    bends = slopes - np.append(slopes[1:], 0.0)
    damping = friction.stribeck / friction.stribeck_velocity * bends
    most = friction.stribeck * abs(bends) * knots[1:]
    return [
        ElementTree.Element(
            "general",
            name=f"slip_{k}",
            joint="hinge",
            gainprm=repr(_NO_GAIN),
            biastype="affine",
            biasprm=f"0 0 {slope!r}",
            forcerange=f"{-end!r} {end!r}",
        )
        for k, (slope, end) in enumerate(zip(damping.tolist(), most.tolist(), strict=True), 1)
    ]


def _polygon(knots: Samples) -> Samples:
    """(n,) values of the polygon nearest to 1 - exp(-x^2); through points it brakes too little."""
    points = np.linspace(0.0, knots[-1], _FINE)
    _, *inner, last = np.eye(knots.size)
    hats = np.array([np.interp(points, knots, hat) for hat in inner])
    rest = 1.0 - np.exp(-(points**2)) - np.interp(points, knots, last)
    return np.asarray(last + np.linalg.lstsq(hats.T, rest, rcond=None)[0] @ np.array(inner))


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
