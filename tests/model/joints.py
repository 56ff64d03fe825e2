"""Joints for the tests of the model, and what drives them."""

from dataclasses import replace
from functools import partial

import numpy as np
from hypothesis import strategies as st

from butterfly.model.greybox import Readings
from butterfly.model.parameters import AddedMass, LumpedParameters

PENDULUM = LumpedParameters(p1=0.00325, p2=0.001, p3=0.04905, p4=0.025)
SLIDING = LumpedParameters(
    **vars(PENDULUM)
    | {"p3_offset": 1e-3, "tilt": 0.1, "delay": 0.0033, "compression": 0.05, "dead_zone": 0.013}
    | {"coulomb": 8e-4, "load": 1e-4, "stribeck": 3e-4, "stribeck_velocity": 0.15, "drag": 1e-5}
    | {"bias": 2e-4, "spring": 2e-3, "mass_inertia": 0.05}
    | {"cogging": 1e-4, "cogging_cosine": 2e-4, "cogging_periods": 3.0}
)
"""All terms at work, but for those that make a state."""

LAG = {"back_emf": 3e-4, "time_constant": 0.0043}  # no whole number of steps, which would change
BRISTLES = {"bristle_stiffness": 2.0, "bristle_damping": 1e-3}
positive = st.floats(1e-4, 10)


def some(kind, **ranges):
    """Hypothesis's builds of a kind with numbers in ranges, each of them now and then 0."""
    zero = st.just(0.0)
    return st.builds(kind, **{name: zero | st.floats(*ends) for name, ends in ranges.items()})


def instants(time):
    """(n - 1, 3) start, middle and end of each of the intervals between (n,) instants."""
    return np.column_stack([time[:-1], (time[1:] + time[:-1]) / 2, time[1:]])


def angle_readings(count):
    """Readings of the angle at the end of each of ``count`` intervals."""
    return Readings(into=np.arange(count), weights=np.outer([0.0, 0.0, 1.0, 0.0], np.ones(count)))


def agrees(found, moved, steps, allowed=1e-5, at_0=None):
    """Whether the difference by one of some steps is within a relative error.

    It is central, or to one side of values at 0.
    """

    def difference(h):
        if at_0 is None:
            return (moved(h) - moved(-h)) / (2 * h)
        return (4 * moved(h) - 3 * at_0 - moved(2 * h)) / (2 * h)

    limit = allowed * (np.linalg.norm(found) or 1)
    return any(np.linalg.norm(difference(h) - found) < limit for h in steps)


WHOLE = replace(
    SLIDING, delay=0.0, coulomb=0.0, load=0.0, stribeck=0.0, compression=0.3, dead_zone=0.0, **LAG
)
OTHERS = {
    "bristles": replace(SLIDING, delay=0.0, **BRISTLES),
    "friction that creeps at rest": replace(PENDULUM, coulomb=1e-4, drag=1e-4),
    "a gear": replace(PENDULUM, motor_friction=0.1, load_friction=0.05, **LAG),
}
ARMS = {"p1": (1e-3, 1e-2), "p2": (3e-4, 5e-3), "p3": (-0.02, 0.2), "p4": (0.01, 10)}
EXTRAS = {"p3_offset": (-0.02, 0.02), "tilt": (-0.5, 0.5), "delay": (1e-4, 0.1)}
EXTRAS |= {"back_emf": (0, 3e-4), "time_constant": (1e-4, 0.05), "coulomb": (0, 1e-3)}
EXTRAS |= {"cogging": (-5e-3, 5e-3), "cogging_cosine": (-5e-3, 5e-3), "load": (0, 1e-3)}
robots = st.builds(
    lambda joint, arm: replace(joint, **arm),
    some(partial(LumpedParameters, p1=1, p2=1, p3=1, p4=1, cogging_periods=7.0), **EXTRAS),
    st.fixed_dictionaries({name: st.floats(*ends) for name, ends in ARMS.items()}),
)
masses = some(AddedMass, mass=(0, 0.2), arm=(0, 0.15))
