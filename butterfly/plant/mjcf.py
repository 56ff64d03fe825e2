"""Write a robot's parameters into the shipped MJCF model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import mujoco

from butterfly.model.parameters import (
    NO_ADDED_MASS,
    AddedMass,
    Drive,
    Friction,
    Hand,
    VoltageDrive,
    lump,
)
from butterfly.resources import shipped

if TYPE_CHECKING:
    from pathlib import Path

    from butterfly.model.parameters import LumpedParameters

MODEL = "models/butterfly_hand/hand.xml"
"""The shipped mechanism."""

SCENE = "models/butterfly_hand/scene.xml"
"""Light, background and camera for pictures of it."""


@dataclass(frozen=True, kw_only=True)
class Robot:
    """A hand, what drives it and what brakes it."""

    hand: Hand
    drive: Drive
    friction: Friction

    @property
    def lumped(self) -> LumpedParameters:
        """p1..p4 and Coulomb torque of the bare hand (6)."""
        return lump(self.hand, self.drive, self.friction)


def mjcf(
    robot: Robot,
    added: AddedMass = NO_ADDED_MASS,
    *,
    scene: bool = False,
    current_by_callback: bool = False,
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
    current_by_callback
        Whether the armature's current, if it is a state, is left to MuJoCo's activation callback
        (see `butterfly.plant.joints`): accurate, where MuJoCo's own integration of it is of first
        order and 6e-4 rad off at 1 ms.
    """
    root = _parse(shipped(MODEL))
    hand = _named(root, "body", "hand")
    _set_inertial(hand, robot.hand.mass, -robot.hand.com_distance, robot.hand.inertia)
    joint = _named(root, "joint", "hinge")
    joint.set("damping", repr(robot.friction.viscous))
    joint.set("frictionloss", repr(robot.friction.coulomb))
    body = _named(root, "body", "added_mass")
    body.set("pos", f"0 0 {-added.arm!r}")
    _set_inertial(body, added.mass, 0.0, 0.0)
    motor = _named(root, "dcmotor", "motor")
    if current_by_callback and robot.drive.time_constant > 0:
        _set_user_current(motor, robot.drive)
    else:
        _set_motor(motor, robot.drive)
    if scene:
        _merge(root, _parse(shipped(SCENE)))
    return ElementTree.tostring(root, encoding="unicode")


def compile_model(robot: Robot) -> mujoco.MjModel:
    """Compile the MuJoCo model of a robot without added mass (see `mount`)."""
    return mujoco.MjModel.from_xml_string(mjcf(robot, current_by_callback=True))


def mount(model: mujoco.MjModel, added: AddedMass) -> None:
    """Put a point mass on the compiled model, in place of the one it carries."""
    body = model.body("added_mass").id
    model.body_mass[body] = added.mass
    model.body_pos[body] = [0, 0, -added.arm]
    mujoco.mj_setConst(model, mujoco.MjData(model))


def _parse(path: Path) -> ElementTree.Element:
    builder = ElementTree.TreeBuilder(insert_comments=True)
    return ElementTree.parse(path, ElementTree.XMLParser(target=builder)).getroot()  # noqa: S314 - our own file


def _named(root: ElementTree.Element, tag: str, name: str) -> ElementTree.Element:
    return next(element for element in root.iter(tag) if element.get("name") == name)


def _set_inertial(body: ElementTree.Element, mass: float, height: float, inertia: float) -> None:
    inertial = next(body.iter("inertial"))
    inertial.set("pos", f"0 0 {height!r}")
    inertial.set("mass", repr(mass))
    inertial.set("diaginertia", " ".join([repr(inertia)] * 3))


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
