from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from butterfly.model.greybox import simulate
from butterfly.model.parameters import AddedMass
from tests.model.joints import PENDULUM, some


@settings(max_examples=40)
@given(
    terms=some(dict, load=(-0.1, 0.1), coulomb=(-0.01, 0.01), stribeck=(-0.01, 0.01)),
    stiffness=st.sampled_from([0.0, 5.0]),
    angle=st.floats(-3, 3),
)
def test_the_energy_of_a_free_decay_never_grows_whatever_friction_is_tried(terms, stiffness, angle):
    tried = replace(PENDULUM, p2=0, p4=1, **terms).with_added_mass(AddedMass(mass=0.05, arm=0.1))
    if stiffness and tried.coulomb <= 0:  # else bristles give back what they were lent
        tried = replace(tried, bristle_stiffness=stiffness)
    time = np.arange(0, 5, 1e-3)
    x, v = simulate(tried, time, np.zeros((time.size - 1, 3)), angle)
    energy = tried.p1 * v**2 / 2 + tried.p3 * (1 - np.cos(x))
    assert np.diff(energy).max() < 1e-10
    assert np.isfinite(energy).all()
