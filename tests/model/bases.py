"""A joint on a base that gives, and its motion."""

import numpy as np

from butterfly.model.greybox import simulate
from butterfly.model.parameters import AddedMass, Base, LumpedParameters
from tests.model.joints import instants

BASE = Base(compliance=2e-3, frequency=25.0, damping=0.3)
JOINT = LumpedParameters(
    p1=0.0034, p2=0.012, p3=0.04, p4=0.5, drag=1e-4, bias=-5e-4, spring=2e-3, p3_offset=3e-3,
    **BASE.terms(),
)  # fmt: skip
ADDED = AddedMass(mass=0.3, arm=0.1)
TIME = np.arange(0.0, 1.5, 1e-3)


def drive(t):
    """Return the command at instants."""
    return 0.12 * np.sin(5 * t) * np.exp(-t / 8) + 0.05 * np.sin(11 * t)


def simulated(joint, added=ADDED):
    """Return angles and velocities of the joint, driven by it."""
    return simulate(joint.with_added_mass(added), TIME, drive(instants(TIME)), 0.1)
