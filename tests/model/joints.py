"""Joints for the tests of the model, and what drives them."""

import numpy as np
from hypothesis import strategies as st

from butterfly.model.greybox import Readings
from butterfly.model.parameters import LumpedParameters

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
