"""The robot: body, motor, friction and clutch; or one with identified parameters."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import StrEnum

from butterfly.errors import InputError, nearest, require_number
from butterfly.logs.log import InputKind
from butterfly.model.greybox import require_plain_base
from butterfly.model.parameters import (
    GRAVITY,
    NO_ADDED_MASS,
    AddedMass,
    Base,
    Drive,
    Friction,
    Hand,
    JointKind,
    LumpedParameters,
    TorqueDrive,
    VoltageDrive,
)
from butterfly.model.terms import BASE_TERMS

HAND_MASS = 0.3
"""Default mass in kg of an identified joint; the motion does not depend on it."""

_AMPLE = 2.0  # times the least mass, if `HAND_MASS` is too light: J_p is then half of p1


@dataclass(frozen=True, kw_only=True)
class Clutch:
    """A clutch with play between motor shaft and body; friction and encoder are on the shaft."""

    backlash: float  # Whole play in rad
    rotor_inertia: float  # The motor side's share of the hand's inertia, in kg m^2

    def __post_init__(self) -> None:
        require_number(
            "Clutch", positive=True, backlash=self.backlash, rotor_inertia=self.rotor_inertia
        )


class Shape(StrEnum):
    """Shape of a robot and kind of its joint: a model below models/."""

    BUTTERFLY = "butterfly_hand/hand"
    BAR = "plain_joint/bar"
    SLIDE = "plain_joint/slide"


@dataclass(frozen=True, kw_only=True)
class RobotChange:
    """A change of a simulated robot while it moves: parameters times factors, from an instant on.

    A part that is not in the lumped parameters, such as a clutch, is lost; so is an armature's
    current.
    """

    at: float  # s
    factors: dict[str, float]  # by lumped parameter of the bare hand

    def __post_init__(self) -> None:
        require_number("change", positive=True, at=self.at)
        for name, factor in self.factors.items():
            require_number(f"change.{name}", positive=True, factor=factor)
            if name not in LumpedParameters.__dataclass_fields__:
                expected = nearest(name, LumpedParameters.__dataclass_fields__)
                raise InputError("change", "factors", name, expected)

    def of(self, robot: Robot) -> Robot:
        """Return a robot with the changed lumped parameters."""
        lumped = robot.lumped
        changed = {name: factor * getattr(lumped, name) for name, factor in self.factors.items()}
        return Robot.of_lumped(replace(lumped, **changed))


PARTS = ("hand", "drive", "friction", "clutch", "base")
"""Parts of a robot."""


class Assistance(StrEnum):
    """What MuJoCo cannot do by itself and `butterfly.plant.joints.MujocoJoint` adds."""

    CURRENT = "a current integrated beyond first order"
    STICKING = "Stribeck friction, or friction that depends on torque or angle"
    BRISTLES = "steps short enough for bristles"


@dataclass(frozen=True, kw_only=True)
class Robot:
    """A joint: its body, drive, friction, clutch and base.

    No clutch means a rigid one, no base a fixed one.
    """

    hand: Hand
    drive: Drive
    friction: Friction
    clutch: Clutch | None = None
    base: Base | None = None
    shape: Shape = Shape.BUTTERFLY

    def __post_init__(self) -> None:
        if self.base:
            require_plain_base(self.lumped)
            if not self.base.mass > self.hand.mass:
                mass = f"a mass of {self.base.mass:g} kg"
                expected = f"more than the mass of the joint on it, {self.hand.mass:g} kg"
                raise InputError("Base", "compliance", mass, expected)
        if self.clutch and not self.clutch.rotor_inertia < self.hand.inertia:
            raise InputError(
                "Clutch",
                "rotor_inertia",
                self.clutch.rotor_inertia,
                f"less than {self.hand.inertia:g} kg m^2, the inertia of body and rotor together",
            )

    @classmethod
    def of_lumped(cls, parameters: LumpedParameters, mass: float | None = None) -> Robot:
        """Return a robot with the motion of ``parameters``: (6) inverted.

        The motion does not depend on the mass of the body in kg, if J_p = p1 - (p3^2 +
        p3_offset^2)/(m (g cos tilt)^2) is positive. By default it is `HAND_MASS`, or more if that
        is too small. The delay is ignored.
        """
        plain = LumpedParameters(**{key: float(value) for key, value in vars(parameters).items()})
        plain.require_gain("robot")
        if not plain.p1 > 0:
            raise InputError("Hand", "p1", plain.p1, "more than 0 kg m²")
        pull = GRAVITY * math.cos(plain.tilt)
        least = (math.hypot(plain.p3, plain.p3_offset) / pull) ** 2 / plain.p1
        base = None
        if plain.base_gives:
            base = Base(**{name.removeprefix("base_"): getattr(plain, name) for name in BASE_TERMS})
        if mass is None:
            mass = HAND_MASS if least < HAND_MASS else _AMPLE * least
            if base and not mass < base.mass:
                mass = (least + base.mass) / 2
        if not mass > max(least, 0.0):
            expected = f"more than {least:.3g} kg for this p1 and p3, or no mass to use a default"
            raise InputError("Hand", "mass (--hand-mass)", mass, expected)
        distance, offset = (moment / (mass * pull) for moment in (plain.p3, plain.p3_offset))
        hand = Hand(
            mass=mass,
            com_distance=distance,
            com_offset=offset,
            inertia=plain.p1 - mass * (distance**2 + offset**2),
            tilt=plain.tilt,
        )
        back_emf = min(plain.back_emf, plain.p2)  # part of p2 even with noise
        friction = Friction(viscous=plain.p2 - back_emf, **plain.terms())
        drive: Drive = TorqueDrive(gain=plain.p4)
        if back_emf:  # of a motor of 1 Ohm
            drive = VoltageDrive(
                resistance=1.0,
                torque_constant=plain.p4,
                back_emf_constant=back_emf / plain.p4,
                inductance=plain.time_constant,
            )
        return cls(hand=hand, drive=drive, friction=friction, base=base, shape=Shape.BAR)

    @classmethod
    def of_loaded(
        cls, parameters: LumpedParameters, added: AddedMass, mass: float | None = None
    ) -> tuple[Robot, AddedMass]:
        """Return a robot and an added mass with the motion of a loaded joint.

        On a slide, or under another gravity, the added mass becomes part of the body.
        """
        if added.gravity == GRAVITY:
            return cls.of_lumped(parameters, mass), added
        whole = None if mass is None else mass + added.mass
        robot = cls.of_lumped(parameters.with_added_mass(added), whole)
        if added.joint is JointKind.SLIDE:
            robot = replace(robot, shape=Shape.SLIDE)
        return robot, NO_ADDED_MASS

    @property
    def input_kind(self) -> InputKind:
        """Kind of the drive's command."""
        return InputKind.VOLTAGE if isinstance(self.drive, VoltageDrive) else InputKind.TORQUE

    @property
    def lumped(self) -> LumpedParameters:
        """The lumped parameters of the bare joint (6), with a rigid clutch."""
        hand, drive, friction = self.hand, self.drive, self.friction
        weight = hand.mass * GRAVITY * math.cos(hand.tilt)
        return LumpedParameters(
            p1=hand.inertia + hand.mass * (hand.com_distance**2 + hand.com_offset**2),
            p2=friction.viscous + drive.damping,
            p3=weight * hand.com_distance,
            p4=drive.gain,
            p3_offset=weight * hand.com_offset,
            tilt=hand.tilt,
            back_emf=drive.damping,
            time_constant=drive.time_constant,
            **friction.terms(),
            **(self.base.terms() if self.base else {}),
        )

    def loaded(self, added: AddedMass) -> LumpedParameters:
        """Return the lumped parameters with an added mass (78), or refuse it."""
        mounted = replace(added, gravity=GRAVITY, joint=JointKind.HINGE)
        if added.inertia_and_moment != mounted.inertia_and_moment:
            setup = f"{added} on a {added.joint} under {added.gravity:g} m/s²"
            expected = f"a mass on a hinge under {GRAVITY} m/s², as in the simulators"
            raise InputError("Robot", "added_masses", setup, expected)
        loaded = self.lumped.with_added_mass(added)
        bends = loaded.bristle_stiffness > 0
        if loaded.coulomb < 0 or (bends and loaded.coulomb == 0):
            expected = f"a load that keeps Coulomb friction positive with {added}"
            raise InputError("Friction", "load", self.friction.load, expected)
        return loaded

    def inertia_of(self, added: AddedMass) -> float:
        """Return the inertia in kg m^2 of an added mass about its own centre."""
        return added.own_inertia + self.friction.mass_inertia * added.swung

    @property
    def assistance(self) -> frozenset[Assistance]:
        """What MuJoCo needs help with; if nothing, its compiled loop can run the robot."""
        needed = {
            Assistance.CURRENT: self.drive.time_constant > 0,
            Assistance.STICKING: self.friction.sticks_harder,
            Assistance.BRISTLES: self.friction.bristle_stiffness > 0,
        }
        return frozenset(assistance for assistance, is_needed in needed.items() if is_needed)
