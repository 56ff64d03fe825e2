"""The robot in MuJoCo that moves as identified parameters say."""

from __future__ import annotations

from butterfly.model.parameters import GRAVITY, NO_ADDED_MASS, AddedMass, LumpedParameters, unlump
from butterfly.plant.robot import Robot

MASS = 0.3
"""Mass in kg given to an identified hand; the motion does not tell it."""


def twin(parameters: LumpedParameters, mass: float = MASS) -> Robot:
    """Return a robot that moves as ``parameters`` say (see `unlump`), numbers of any kind."""
    plain = LumpedParameters(**{key: float(value) for key, value in vars(parameters).items()})
    hand, drive, friction = unlump(plain, mass)
    return Robot(hand=hand, drive=drive, friction=friction)


def carrying_twin(
    parameters: LumpedParameters, added: AddedMass, mass: float = MASS
) -> tuple[Robot, AddedMass]:
    """Return a robot and what it is to carry, that move together as a loaded joint does.

    MuJoCo's joint is a hinge under Earth's gravity: what a slide carries, or a joint across another
    gravity, becomes part of the hand.
    """
    if added.gravity == GRAVITY:
        return twin(parameters, mass), added
    return twin(parameters.with_added_mass(added), mass + added.mass), NO_ADDED_MASS


def command_of(parameters: LumpedParameters) -> dict[str, float]:
    """Return what becomes of the command before it is a torque, as `stand_alone` takes it."""
    return {"delay": float(parameters.delay), "compression": float(parameters.compression)}
