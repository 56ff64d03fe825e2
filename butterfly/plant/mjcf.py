"""Fill the shipped MJCF model with a robot's parameters."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco

from butterfly.model.parameters import AddedMass, Drive, Friction, Hand, VoltageDrive, lump
from butterfly.model.parameters import LumpedParameters as Lumped
from butterfly.resources import shipped

MODEL = "models/butterfly_hand/hand.xml"
"""The shipped model."""


@dataclass(frozen=True, kw_only=True)
class Robot:
    """A hand, what drives it and what brakes it."""

    hand: Hand
    drive: Drive
    friction: Friction

    @property
    def lumped(self) -> Lumped:
        """p1..p4 and Coulomb torque of the bare hand (6)."""
        return lump(self.hand, self.drive, self.friction)


def compile_model(robot: Robot) -> mujoco.MjModel:
    """Compile the MuJoCo model of a robot without added mass.

    MuJoCo's `dcmotor` takes one constant K = sqrt(k_i k_emf) for torque and back EMF. Unequal ones
    are rescaled exactly: with K = k_emf and R' = R k_emf/k_i the torque K/R' (v - K thd) equals
    k_i/R (v - k_emf thd). A current-controlled drive is a plain gear.
    """
    spec = mujoco.MjSpec.from_file(str(shipped(MODEL)))
    hand = spec.body("hand")
    hand.mass = robot.hand.mass
    hand.ipos = [0, 0, -robot.hand.com_distance]
    hand.inertia = [robot.hand.inertia] * 3
    joint = spec.joint("hinge")
    joint.damping[0] = robot.friction.viscous
    joint.frictionloss = robot.friction.coulomb
    motor = spec.actuator("motor")
    drive = robot.drive
    if isinstance(drive, VoltageDrive) and drive.back_emf_constant > 0:
        scale = drive.back_emf_constant / drive.torque_constant
        constants = [drive.back_emf_constant] * 2
        motor.set_to_dcmotor(motorconst=constants, resistance=drive.resistance * scale)
    else:
        motor.set_to_motor()
        motor.gear = [drive.gain, 0, 0, 0, 0, 0]
    return spec.compile()


def mount(model: mujoco.MjModel, added: AddedMass) -> None:
    """Put a point mass on the compiled model, in place of the one it carries."""
    body = model.body("added_mass").id
    model.body_mass[body] = added.mass
    model.body_pos[body] = [0, 0, -added.arm]
    mujoco.mj_setConst(model, mujoco.MjData(model))
