"""Write a robot's parameters into the shipped MJCF model."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import mujoco

from butterfly.errors import InputError, require_number
from butterfly.model.parameters import (
    GRAVITY,
    NO_ADDED_MASS,
    AddedMass,
    Drive,
    Hand,
    VoltageDrive,
    lump,
)
from butterfly.resources import shipped

if TYPE_CHECKING:
    from pathlib import Path

    from butterfly.model.friction import Friction
    from butterfly.model.parameters import LumpedParameters

MODEL = "models/butterfly_hand/hand.xml"
"""The shipped mechanism."""

SCENE = "models/butterfly_hand/scene.xml"
"""Light, background and camera for pictures of it."""


NO_CONSTANT = 1e-12
"""Motor constant in N m/A of the parts that MuJoCo calls a motor and that are none: it takes no 0,
and this adds a damping of 1e-24 N m s/rad."""


@dataclass(frozen=True, kw_only=True)
class Clutch:
    """A clutch with play between motor shaft and hand; friction and encoder stay on the shaft.

    Parameters
    ----------
    backlash
        Whole play in rad.
    rotor_inertia
        The motor side's share of the hand's inertia, in kg m^2.
    """

    backlash: float
    rotor_inertia: float

    def __post_init__(self) -> None:
        require_number(
            "Clutch", positive=True, backlash=self.backlash, rotor_inertia=self.rotor_inertia
        )


@dataclass(frozen=True, kw_only=True)
class Robot:
    """A hand, what drives it, what brakes it, and what is between; no clutch is a rigid one."""

    hand: Hand
    drive: Drive
    friction: Friction
    clutch: Clutch | None = None

    def __post_init__(self) -> None:
        if self.clutch and not self.clutch.rotor_inertia < self.hand.inertia:
            raise InputError(
                "Clutch",
                "rotor_inertia",
                self.clutch.rotor_inertia,
                f"less than the {self.hand.inertia:g} kg m^2 of hand and rotor together",
            )

    @property
    def lumped(self) -> LumpedParameters:
        """The lumped parameters of the bare hand (6), its clutch without play."""
        return lump(self.hand, self.drive, self.friction)


def mjcf(
    robot: Robot,
    added: AddedMass = NO_ADDED_MASS,
    *,
    scene: bool = False,
    assisted: bool = False,
) -> str:
    """Return the MJCF text of a robot, which loads in plain MuJoCo.

    Every number is written so that it reads back bit for bit.

    Parameters
    ----------
    robot
        The robot.
    added
        What it carries.
    scene
        Whether to add light, background and camera.
    assisted
        Whether `butterfly.plant.joints.MujocoJoint` is to run it, which does what MuJoCo alone
        cannot: an armature's current of more than first order (MuJoCo's own is 6e-4 rad off at
        1 ms), and friction that sticks harder than it slides.

    Raises
    ------
    InputError
        If MuJoCo alone cannot run the robot.
    """
    friction = _loaded(robot, added)
    if friction.sticks_harder and not assisted:
        raise InputError(
            "Friction",
            "bristle_stiffness",
            0,
            "more than 0: in a model of its own, MuJoCo has Stribeck friction with bristles only",
        )
    root = _parse(shipped(MODEL))
    _set_gravity(root, robot.hand.tilt)
    _set_inertial(_named(root, "body", "hand"), robot.hand)
    joint = _named(root, "joint", "hinge")
    joint.set("damping", f"{robot.friction.viscous!r} {robot.friction.drag!r}")
    joint.set("frictionloss", repr(0.0 if friction.bristle_stiffness else friction.coulomb))
    body = _named(root, "body", "added_mass")
    body.set("pos", f"0 0 {-added.arm!r}")
    next(body.iter("inertial")).set("mass", repr(added.mass))
    if robot.clutch:
        _insert_clutch(root, robot.clutch)
    motor = _named(root, "dcmotor", "motor")
    if assisted and robot.drive.time_constant > 0:
        _set_user_current(motor, robot.drive)
    else:
        _set_motor(motor, robot.drive)
    actuators = next(root.iter("actuator"))
    actuators.extend(_pulls(friction))
    if scene:
        _merge(root, _parse(shipped(SCENE)))
    return ElementTree.tostring(root, encoding="unicode")


def compile_model(robot: Robot) -> mujoco.MjModel:
    """Compile the MuJoCo model of a robot without added mass (see `mount`)."""
    return mujoco.MjModel.from_xml_string(mjcf(robot, assisted=True))


def mount(model: mujoco.MjModel, robot: Robot, added: AddedMass) -> None:
    """Put a point mass on the compiled model of a robot, in place of the one it carries."""
    body = model.body("added_mass").id
    model.body_mass[body] = added.mass
    model.body_pos[body] = [0, 0, -added.arm]
    loaded = _loaded(robot, added)
    if loaded.bristle_stiffness:
        model.actuator("bristles").biasprm[3:5] = loaded.coulomb, loaded.holding
    else:
        model.joint("hinge").frictionloss[0] = loaded.coulomb
    mujoco.mj_setConst(model, mujoco.MjData(model))


def _loaded(robot: Robot, added: AddedMass) -> LumpedParameters:
    loaded = robot.lumped.with_added_mass(added)
    if loaded.coulomb < 0:
        expected = f"one that leaves Coulomb friction at {added} positive"
        raise InputError("Friction", "load", robot.friction.load, expected)
    return loaded


def _parse(path: Path) -> ElementTree.Element:
    builder = ElementTree.TreeBuilder(insert_comments=True)
    return ElementTree.parse(path, ElementTree.XMLParser(target=builder)).getroot()  # noqa: S314 - our own file


def _named(root: ElementTree.Element, tag: str, name: str) -> ElementTree.Element:
    return next(element for element in root.iter(tag) if element.get("name") == name)


def _set_gravity(root: ElementTree.Element, tilt: float) -> None:
    """Tilt gravity, along the axis, instead of the axis."""
    pull = f"0 {GRAVITY * math.sin(tilt)!r} {-GRAVITY * math.cos(tilt)!r}"
    next(root.iter("option")).set("gravity", pull)


def _set_inertial(body: ElementTree.Element, hand: Hand) -> None:
    inertial = next(body.iter("inertial"))
    inertial.set("pos", f"{hand.com_offset!r} 0 {-hand.com_distance!r}")
    inertial.set("mass", repr(hand.mass))
    inertial.set("diaginertia", " ".join([repr(hand.inertia)] * 3))


def _insert_clutch(root: ElementTree.Element, clutch: Clutch) -> None:
    """Put a rotor between world and hand, which then hangs on a joint with play."""
    world, hand = next(root.iter("worldbody")), _named(root, "body", "hand")
    inertial = next(hand.iter("inertial"))
    rest = float(inertial.get("diaginertia", "").split()[0]) - clutch.rotor_inertia
    inertial.set("diaginertia", " ".join([repr(rest)] * 3))
    hinge = _named(hand, "joint", "hinge")
    rotor = ElementTree.SubElement(world, "body", name="rotor")
    rotor.append(hinge)
    own = " ".join([repr(clutch.rotor_inertia)] * 3)
    ElementTree.SubElement(rotor, "inertial", pos="0 0 0", mass="0.001", diaginertia=own)
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


def _pulls(p: LumpedParameters) -> list[ElementTree.Element]:
    """Return the actuators that add bias, cogging and bristles; they take no command."""
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


def _set_motor(motor: ElementTree.Element, drive: Drive) -> None:
    """Fill in the motor; a torque drive, or a motor without back EMF, is a gain (with a lag).

    MuJoCo's dcmotor takes one constant K = sqrt(k_i k_emf) for torque and back EMF. Unequal ones
    are rescaled exactly: with K = k_emf and R' = R k_emf/k_i the torque K/R' (v - K thd) equals
    k_i/R (v - k_emf thd).
    """
    if isinstance(drive, VoltageDrive) and drive.back_emf_constant > 0:
        scale = drive.back_emf_constant / drive.torque_constant
        motor.set("motorconst", " ".join([repr(drive.back_emf_constant)] * 2))
        motor.set("resistance", repr(drive.resistance * scale))
        if drive.time_constant > 0:
            motor.set("inductance", f"{drive.inductance * scale!r} {drive.time_constant!r}")
        return
    motor.tag = "general"
    motor.attrib = {"name": "motor", "joint": "hinge", "gainprm": repr(drive.gain)}
    if drive.time_constant > 0:
        motor.attrib |= {"dyntype": "filterexact", "dynprm": repr(drive.time_constant)}


def _set_user_current(motor: ElementTree.Element, drive: Drive) -> None:
    """Make the current a state of the motor, with R, k_emf and L for the callback."""
    assert isinstance(drive, VoltageDrive)  # noqa: S101 - only such a drive has a time constant
    motor.tag = "general"
    motor.attrib = {
        "name": "motor",
        "joint": "hinge",
        "gainprm": repr(drive.torque_constant),
        "dyntype": "user",
        "dynprm": f"{drive.resistance!r} {drive.back_emf_constant!r} {drive.inductance!r}",
        "actdim": "1",
    }


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
