"""Scales that no log shows move parameters as they move the motion."""

import numpy as np
import pytest

from butterfly.identification.inference.consistency import OF_SCALES
from butterfly.model.greybox import simulate
from butterfly.model.parameters import LumpedParameters

ROBOT = {"p1": 0.004, "p2": 0.002, "p3": 0.05, "p4": 0.3, "coulomb": 0.001}
FRICTION = [
    {"drag": 3e-4},
    {"back_emf": 0.002, "time_constant": 0.02},
    {"stribeck": 0.002, "stribeck_velocity": 0.3},
    {"bristle_stiffness": 0.5, "bristle_damping": 0.002},
]


@pytest.mark.parametrize("more", FRICTION, ids=lambda more: next(iter(more)))
def test_with_another_clock_the_same_motion_has_parameters_by_their_units(more):
    """No equation is used: the simulator is asked for the same motion in other seconds."""
    scale, recorded, of_clock = 1.3, np.linspace(0.0, 4.0, 2001), OF_SCALES["time_scale"]
    inputs = np.repeat(0.1 * np.sin(5 * recorded[:-1, None]), 3, axis=1)
    true = {
        name: value * scale ** of_clock.get(name, 0.0) for name, value in (ROBOT | more).items()
    }
    read, _ = simulate(LumpedParameters(**ROBOT, **more), recorded, inputs, 0.2)
    meant, _ = simulate(LumpedParameters(**true), scale * recorded, inputs, 0.2)
    np.testing.assert_allclose(meant, read, atol=1e-5 * np.ptp(read))
