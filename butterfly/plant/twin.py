"""The robot in MuJoCo that moves as identified parameters say."""

from __future__ import annotations

from typing import TYPE_CHECKING

from butterfly.model.parameters import unlump
from butterfly.plant.robot import Robot

if TYPE_CHECKING:
    from butterfly.model.parameters import LumpedParameters

MASS = 0.3
"""Mass in kg given to an identified hand; the motion does not tell it."""


def twin(parameters: LumpedParameters, mass: float = MASS) -> Robot:
    """Return a robot that moves as ``parameters`` say (see `unlump`)."""
    hand, drive, friction = unlump(parameters, mass)
    return Robot(hand=hand, drive=drive, friction=friction)
