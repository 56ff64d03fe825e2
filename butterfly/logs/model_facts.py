"""What somebody's robot model says of one of its joints, as a data set carries it.

The numbers are read from MJCF or URDF by `butterfly.twin.joint_of_model`; whatever fits or shows
logs needs no simulator for them.
"""

from __future__ import annotations

from pydantic import Field, NonNegativeFloat

from butterfly.model.parameters import JointKind
from butterfly.yaml_files import StrictModel

STILL = 5e-3
"""Rad or m, by which a joint may move and counts as still."""

_SHORTEST = 0.02  # m, arm of the mass that stands for a pose
_ENOUGH = 0.2  # share of the largest gravity moment that is left to tell the scale by


class LinkMasses(StrictModel):
    """How well the masses of a model's links are known."""

    uncertainty: NonNegativeFloat = 0.05
    """Standard uncertainty as a share: 0.05 for 5 %."""
    independent: bool = False
    """Whether each link is off by itself; otherwise all masses are off by one factor."""


class ActuatorFacts(StrictModel):
    """An actuator of the joint, at the joint's side of its gear."""

    name: str
    gear: float = 1.0
    gain: float
    """Torque in N m per unit of ctrl."""
    kp: float = 0.0
    """Stiffness in N m/rad with which it holds a position; 0 for a motor."""
    kv: float = 0.0
    """Damping in N m s/rad that it adds."""
    effort: float | None = None
    """Largest torque in N m; None without a limit."""
    shortcut: str = "motor"
    """Element of MJCF: motor, position, velocity, or general."""
    by_ratio: bool = False
    """Whether its kv was written as a ``dampratio``, which changes with the armature."""


class PoseFacts(StrictModel):
    """The joint in one pose of the others: what it moves, and how gravity pulls at it."""

    pose: dict[str, float] = Field(default={})
    """Positions of the other joints in rad or m."""
    inertia: float
    """Of the links that it moves, about its axis, in kg m^2 (kg for a slide), without armature."""
    moment: NonNegativeFloat
    """Gravity moment in N m: it is ``moment sin(angle - zero)``."""
    zero: float
    """Angle in rad at which it would hang."""


class ModelFacts(StrictModel):
    """What a model says of a joint."""

    file: str
    """Name of the model's file."""
    urdf: bool = False
    joint: str
    kind: JointKind
    gravity: NonNegativeFloat
    """Gravity in m/s^2 across the axis, in the pose where it is largest."""
    poses: list[PoseFacts]
    """Of the logs: the different ones, the first log's first."""
    range: tuple[float, float] | None = None
    """In rad or m."""
    armature: float
    """As the file says, in kg m^2: without the actuators' own."""
    rotors: float = 0.0
    """Armature that actuators add, in kg m^2 at the joint."""
    damping: float
    """In N m s/rad, without that of actuators."""
    motor_damping: float = 0.0
    """In N m s/rad, that actuators add by their own ``damping``."""
    frictionloss: float
    stiffness: float = 0.0
    effort: float | None = None
    """Largest torque in N m that the joint's own limit lets through."""
    actuators: list[ActuatorFacts] = Field(default_factory=list)
    others: list[str] = Field(default_factory=list)
    """The other joints."""
    links: LinkMasses = LinkMasses()
    warnings: list[str] = Field(default_factory=list)
    """What the model has that one joint alone does not."""

    @property
    def bare(self) -> tuple[float, float]:
        """Inertia and gravity moment of the joint that every pose adds to.

        Of one pose they are its own. Of several they are the least, and the inertia so much less
        that a mass at an arm of at least 2 cm can be what each pose adds.
        """
        if len(self.poses) == 1:
            return self.poses[0].inertia, self.poses[0].moment
        moment = min(pose.moment for pose in self.poses)
        return min(self._without(pose, moment) for pose in self.poses), moment

    def _without(self, pose: PoseFacts, moment: float) -> float:
        """Return a pose's inertia without that of the mass at the shortest arm."""
        if not self.gravity:
            return pose.inertia
        return pose.inertia - _SHORTEST * (pose.moment - moment) / self.gravity

    @property
    def largest(self) -> float:
        """The largest gravity moment in N m of all poses."""
        return max(pose.moment for pose in self.poses)

    @property
    def gravity_tells_scale(self) -> bool:
        """Whether the identified gravity moment shows by which factor the masses are off."""
        return not self.links.independent and self.bare[1] > _ENOUGH * self.largest
