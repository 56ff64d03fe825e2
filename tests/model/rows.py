"""Motions and values by which the rows of the table of terms are tried."""

from butterfly.model.parameters import AddedMass, LumpedParameters
from butterfly.model.terms import TERMS

ADDED = AddedMass(mass=0.4, arm=0.0)  # on the axis: it loads the bearing only
SETTINGS = {"cogging_periods": 3.0, "stribeck_velocity": 0.4}
PLAIN = LumpedParameters(p1=0.004, p2=0.0, p3=0.0, p4=0.0, **SETTINGS)
VALUE = 0.013
STATES = [(0.7, 0.9), (-2.1, -0.3), (3.0, 1.7)]
COMMAND = 0.6
LOAD = -0.21
YIELDED = {"compression": lambda c: COMMAND / (1 + c * COMMAND), "dead_zone": lambda d: COMMAND - d}
STATIC = [name for name, row in TERMS.items() if row.basis is not None]


def motion_at(angle, velocity, **more):
    """Return the motion of a joint without terms, with more of what acts on it."""
    return PLAIN.motion(angle, velocity)._replace(**more)
