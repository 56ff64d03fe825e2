"""The robot in MuJoCo that moves as identified parameters say."""

from __future__ import annotations

from butterfly.errors import InputError
from butterfly.model.parameters import (
    GRAVITY,
    NO_ADDED_MASS,
    AddedMass,
    LumpedParameters,
    least_mass,
    unlump,
)
from butterfly.plant.robot import Robot

MASS = 0.3
"""Mass in kg of an identified hand if none is given; the motion does not depend on it."""

_AMPLE = 2.0  # least masses, of a hand that cannot be as light as MASS: half of p1 is its J_p


def twin(parameters: LumpedParameters, mass: float | None = None) -> Robot:
    """Return a robot that moves as ``parameters`` say, numbers of any kind (see `unlump`).

    Parameters
    ----------
    parameters
        Of the bare hand.
    mass
        Of the hand in kg; if not given `MASS`, or more where no hand so light moves so.

    Raises
    ------
    InputError
        If no hand of the mass given moves so, or a friction is negative.
    """
    plain = LumpedParameters(**{key: float(value) for key, value in vars(parameters).items()})
    least = least_mass(plain)
    if mass is None:
        mass = MASS if least < MASS else _AMPLE * least
    if not mass > max(least, 0.0):
        expected = f"more than {least:.3g} kg, for p1 and p3 to be possible; or none, to have one"
        raise InputError("Hand", "mass (--hand-mass)", mass, f"{expected} chosen")
    hand, drive, friction = unlump(plain, mass)
    return Robot(hand=hand, drive=drive, friction=friction)


def carrying_twin(
    parameters: LumpedParameters, added: AddedMass, mass: float | None = None
) -> tuple[Robot, AddedMass]:
    """Return a robot and what it is to carry, that move together as a loaded joint does.

    MuJoCo's joint is a hinge under Earth's gravity: what a slide carries, or a joint across another
    gravity, becomes part of the hand.
    """
    if added.gravity == GRAVITY:
        return twin(parameters, mass), added
    whole = None if mass is None else mass + added.mass
    return twin(parameters.with_added_mass(added), whole), NO_ADDED_MASS


def command_of(parameters: LumpedParameters) -> dict[str, float]:
    """Return what becomes of the command before it is a torque, as `stand_alone` takes it."""
    return {"delay": float(parameters.delay), "compression": float(parameters.compression)}
