"""Write a robot's parameters into the shipped MJCF model."""

from __future__ import annotations

import math
from pathlib import Path
from xml.etree import ElementTree

import mujoco

from butterfly.errors import InputError
from butterfly.files import shipped
from butterfly.model.parameters import (
    GRAVITY,
    NO_ADDED_MASS,
    AddedMass,
    Base,
    Drive,
    LumpedParameters,
    VoltageDrive,
)
from butterfly.model.terms import BEYOND_MUJOCO
from butterfly.plant.robot import Assistance, Clutch, Robot, Shape

MODELS = "models"
"""Folder of the shipped mechanisms (`Shape`), each with its scene: light, camera etc."""

NO_CONSTANT = 1e-12
"""Motor constant in N m/A of MuJoCo motors without back EMF: 0 is not allowed, and this adds a
damping of 1e-24 N m s/rad."""

_PLATE = 0.15  # m from the axis to the end of a plate
_SCENE = 0.2  # m from the axis that the camera shows at least
_BRASS = 8500.0  # kg/m³
_FLATNESS = 0.5  # thickness of the disc over its radius
_SMALLEST = 0.004  # m, a disc that can be seen
_BOLT = 0.28  # radius of the disc's bolt over its own
_FRONT = -0.0145  # m along the axis, where the painted front plate ends
_ROD = 0.004  # m, radius


def compile_model(
    robot: Robot, added: AddedMass = NO_ADDED_MASS, *, scene: bool = False
) -> mujoco.MjModel:
    """Compile the MuJoCo model of a robot for `butterfly.plant.joints.MujocoJoint`."""
    root = built(robot, added, scene=scene, assisted=True)
    if not scene:  # all that is drawn would cost time where nobody looks
        for parent in root.iter():
            for child in [element for element in parent if element.tag in {"geom", "asset"}]:
                parent.remove(child)
    return mujoco.MjModel.from_xml_string(text_of(root))


def hinge_of(model: mujoco.MjModel) -> int:
    """Return the index of a model's joint, which follows that of a moving base."""
    return int(model.jnt_dofadr[model.actuator_trnid[0, 0]])  # it is what the motor drives


def text_of(root: ElementTree.Element) -> str:
    """Return a model as text."""
    return ElementTree.tostring(root, encoding="unicode")


def built(
    robot: Robot, added: AddedMass, *, scene: bool, assisted: bool = False
) -> ElementTree.Element:
    """Return the shipped model with the robot's values, ``assisted`` for `MujocoJoint`.

    Every number reads back bit for bit. Unless assisted, a robot that MuJoCo alone cannot run is an
    InputError. If assisted and the current is a state, the command is the current: MuJoCo's own
    current gives an error of 6e-4 rad at 1 ms.
    """
    friction = robot.loaded(added)
    beyond = [name for name in BEYOND_MUJOCO if getattr(robot.friction, name)]
    if beyond and not assisted:
        expected = (
            "none: MuJoCo has no friction that depends on torque or angle (`export` omits it)"
        )
        raise InputError("Friction", "terms", ", ".join(beyond), expected)
    if Assistance.STICKING in robot.assistance and not assisted:
        raise InputError(
            "Friction",
            "bristle_stiffness",
            0,
            "more than 0: MuJoCo needs bristles for Stribeck friction, or the actuators that "
            "`butterfly export` adds",
        )
    model = shipped(f"{MODELS}/{robot.shape}.xml")
    root = _parse(model)
    tilt = robot.hand.tilt  # of gravity along the axis, instead of the axis
    pull = f"0 {GRAVITY * math.sin(tilt)!r} {-GRAVITY * math.cos(tilt)!r}"
    next(root.iter("option")).set("gravity", pull)
    inertial = next(named(root, "hand").iter("inertial"))
    inertial.set("pos", f"{robot.hand.com_offset!r} 0 {-robot.hand.com_distance!r}")
    slides = robot.shape is Shape.SLIDE  # whose inertia is its mass
    inertial.set("mass", repr(robot.hand.inertia if slides else robot.hand.mass))
    inertia = robot.inertia_of(added)  # MuJoCo refuses a negative one: the hand's is reduced
    inertial.set("diaginertia", " ".join([repr(robot.hand.inertia + min(inertia, 0.0))] * 3))
    joint = named(root, "hinge")
    joint.set("damping", f"{robot.friction.viscous!r} {friction.drag!r}")
    joint.set("stiffness", repr(robot.friction.spring))
    joint.set("frictionloss", repr(0.0 if friction.bristle_stiffness else friction.coulomb))
    body = named(root, "added_mass")
    body.set("pos", f"0 0 {-added.arm!r}")
    inertial = next(body.iter("inertial"))
    inertial.set("mass", repr(added.mass))
    inertial.set("diaginertia", " ".join([repr(max(inertia, 0.0))] * 3))
    if robot.clutch:
        _insert_clutch(root, robot.clutch)
    if robot.base:
        _insert_base(root, robot.base, robot.base.mass - robot.hand.mass)
    _set_motor(named(root, "motor"), robot.drive, commands_current=assisted)
    next(root.iter("actuator")).extend(_pulls(friction))
    if scene:
        _merge(root, _parse(model.with_name("scene.xml")))
    _dress(root, added)
    return root


def _parse(path: Path) -> ElementTree.Element:
    builder = ElementTree.TreeBuilder(insert_comments=True)
    return ElementTree.parse(path, ElementTree.XMLParser(target=builder)).getroot()  # noqa: S314 - our own file


def named(root: ElementTree.Element, name: str) -> ElementTree.Element:
    """Return the body, joint or motor of a name in the mechanism."""
    return next(element for element in root.iter() if element.get("name") == name)


def _insert_clutch(root: ElementTree.Element, clutch: Clutch) -> None:
    """Insert a rotor between world and body, with a joint with play."""
    world, hand = next(root.iter("worldbody")), named(root, "hand")
    inertial = next(hand.iter("inertial"))
    rest = float(inertial.get("diaginertia", "").split()[0]) - clutch.rotor_inertia
    inertial.set("diaginertia", " ".join([repr(rest)] * 3))
    hinge = named(root, "hinge")
    rotor = ElementTree.SubElement(world, "body", name="rotor")
    rotor.append(hinge)
    inertia = " ".join([repr(clutch.rotor_inertia)] * 3)
    ElementTree.SubElement(rotor, "inertial", pos="0 0 0", mass="0.001", diaginertia=inertia)
    world.remove(hand)
    hand.remove(hinge)
    rotor.append(hand)
    play = ElementTree.Element(
        "joint",
        name="clutch",
        type="hinge",
        axis=hinge.get("axis", ""),
        range=f"{-clutch.backlash / 2!r} {clutch.backlash / 2!r}",
        solreflimit="0.004 1",
    )
    hand.insert(0, play)


def _insert_base(root: ElementTree.Element, base: Base, mass: float) -> None:
    """Put all moving parts on a base with its own mass in kg, spring and damper."""
    world = next(root.iter("worldbody"))
    carried = [element for element in world if element.tag == "body"]
    body = ElementTree.SubElement(world, "body", name="base")
    slide = {"stiffness": repr(1 / base.compliance), "damping": repr(base.friction)}
    joint = {"name": "base", "type": "slide", "axis": "1 0 0"} | slide
    ElementTree.SubElement(body, "joint", joint)
    tiny = " ".join([repr(mass)] * 3)  # it does not turn
    ElementTree.SubElement(body, "inertial", pos="0 0 0", mass=repr(mass), diaginertia=tiny)
    for part in carried:
        world.remove(part)
        body.append(part)


def _pulls(p: LumpedParameters) -> list[ElementTree.Element]:
    """Return the actuators for bias, cogging and bristles, which take no command."""
    pulls = []
    idle = {"motorconst": f"{NO_CONSTANT!r} {NO_CONSTANT!r}", "resistance": "1"}
    if p.bias:
        constant = {"gainprm": "0", "biastype": "affine", "biasprm": f"{p.bias!r} 0 0"}
        pulls.append(_actuator("general", "bias", constant))
    if p.cogging or p.cogging_cosine:
        phase = math.atan2(p.cogging_cosine, p.cogging)
        shape = f"{math.hypot(p.cogging, p.cogging_cosine)!r} {p.cogging_periods!r} {phase!r}"
        pulls.append(_actuator("dcmotor", "cogging", idle | {"cogging": shape}))
    if p.bristle_stiffness:
        numbers = (p.bristle_stiffness, p.bristle_damping, p.coulomb, p.holding)
        shape = " ".join(repr(number) for number in (*numbers, p.stribeck_velocity))
        pulls.append(_actuator("dcmotor", "bristles", idle | {"lugre": shape}))
    return pulls


def _actuator(kind: str, name: str, attributes: dict[str, str]) -> ElementTree.Element:
    return ElementTree.Element(kind, {"name": name, "joint": "hinge"} | attributes)


def _set_motor(motor: ElementTree.Element, drive: Drive, *, commands_current: bool) -> None:
    """Set the motor; without back EMF, or with the current as command, it is a gain.

    MuJoCo's dcmotor takes one constant K = sqrt(k_i k_emf) for torque and back EMF. Unequal ones
    are rescaled exactly: with K = k_emf and R' = R k_emf/k_i the torque K/R' (v - K thd) equals
    k_i/R (v - k_emf thd).
    """
    lags = drive.time_constant > 0
    if isinstance(drive, VoltageDrive) and lags and commands_current:
        _set_gain(motor, drive.torque_constant)
        return
    if isinstance(drive, VoltageDrive) and drive.back_emf_constant > 0:
        scale = drive.back_emf_constant / drive.torque_constant
        motor.set("motorconst", " ".join([repr(drive.back_emf_constant)] * 2))
        motor.set("resistance", repr(drive.resistance * scale))
        if lags:
            motor.set("inductance", f"{drive.inductance * scale!r} {drive.time_constant!r}")
        return
    _set_gain(motor, drive.gain)
    if lags:
        motor.attrib |= {"dyntype": "filterexact", "dynprm": repr(drive.time_constant)}


def _set_gain(motor: ElementTree.Element, gain: float) -> None:
    """Make the motor a gain in N m per unit of its command."""
    motor.tag = "general"
    motor.attrib = {"name": "motor", "joint": "hinge", "gainprm": repr(gain)}


def _merge(root: ElementTree.Element, scene: ElementTree.Element) -> None:
    """Add the scene's elements to those of the mechanism, section by section."""
    for section in scene:
        if not isinstance(section.tag, str) or section.tag == "include":
            continue
        target = root.find(section.tag)
        if target is None:
            root.append(section)
        else:
            target.extend(list(section))


def disc_radius(mass: float) -> float:
    """Return the radius in m of the brass disc drawn for an added mass in kg."""
    return max(_SMALLEST, math.cbrt(mass / (math.pi * _FLATNESS * _BRASS)))


def _dress(root: ElementTree.Element, added: AddedMass) -> None:
    """Draw the added mass: a disc of its size, screwed to the front plate or to a rod beyond it."""
    if not added.mass:
        return
    body = named(root, "added_mass")
    radius = disc_radius(added.mass)
    half, bolt = _FLATNESS * radius / 2, _BOLT * radius
    depth = _FRONT - half
    _geom(body, "brass", name="added_mass", size=(radius, half), pos=(0, depth, 0))
    _geom(body, "dark", size=(bolt, bolt / 4), pos=(0, depth - half - bolt / 4, 0))
    reach = added.arm + radius
    if reach > _PLATE:
        ends = (0, depth, 0, 0, depth, added.arm)
        _geom(body, "visual", type="capsule", size=(_ROD,), fromto=ends)
    if reach > _SCENE:  # the mass swings below the bench's floor, too
        for parent in root.iter("worldbody"):
            for floor in parent.findall("geom[@material='floor']"):
                parent.remove(floor)
        for tag, name in (("camera", "pos"), ("statistic", "extent")):
            for element in root.iter(tag):
                numbers = [float(number) for number in element.get(name, "").split()]
                element.set(name, " ".join(repr(reach / _SCENE * number) for number in numbers))


def _geom(body: ElementTree.Element, kind: str, **attributes: str | tuple[float, ...]) -> None:
    texts = {
        name: value if isinstance(value, str) else " ".join(map(repr, value))
        for name, value in attributes.items()
    }
    ElementTree.SubElement(body, "geom", {"class": kind} | texts)
