"""The thesis's index (118) is not what re-calibrates a model."""

from dataclasses import replace

import numpy as np
import pytest

from butterfly.model.energy import Orbit
from butterfly.model.parameters import NO_ADDED_MASS
from butterfly.orbit.controller import EnergyShaping, gain_for
from tests.orbit.setting import SIXTY, grey_rig, plant
from tests.thesis.index_118 import Index, minimise_index

TRUE = plant({"coulomb": 4e-4}).robot.lumped


@pytest.mark.parametrize(
    ("index", "vanishing"),
    [(Index.PRINTED, [0, 1]), (Index.NORMALISED, [2]), (Index.FIXED_INERTIA, [2])],
)
def test_118_fails_with_a_controller_built_on_wrong_parameters(index, vanishing):
    rng = np.random.default_rng(2)
    believed = replace(TRUE, coulomb=0.0, p2=1.3 * TRUE.p2, p4=0.8 * TRUE.p4)
    orbit = Orbit.of_amplitude(believed, SIXTY)
    gamma = gain_for(orbit, 0.5)
    rig = grey_rig(plant(), rng)
    log = rig(EnergyShaping(orbit, gamma), 1.4, 30.0, NO_ADDED_MASS)
    found = minimise_index(log, 0.0, believed, SIXTY, gamma=gamma, index=index)
    start = np.array([believed.p1, believed.p3, believed.p4])
    assert (found[vanishing] < 0.1 * start[vanishing]).all()


def test_118_works_only_with_the_inertia_fixed_and_an_exact_controller_without_noise():
    smooth = plant().model_copy(update={"encoder": plant().encoder.__class__(steps=2**40)})
    true = smooth.robot.lumped
    orbit = Orbit.of_amplitude(true, SIXTY)
    gamma = gain_for(orbit, 0.8)
    rig = grey_rig(smooth, np.random.default_rng())
    log = rig(EnergyShaping(orbit, gamma), 1.4, 12.0, NO_ADDED_MASS)
    start = replace(true, p3=1.1 * true.p3, p4=0.9 * true.p4)
    found = minimise_index(log, 0.0, start, SIXTY, gamma=gamma, index=Index.FIXED_INERTIA)
    np.testing.assert_allclose(found[1:], [true.p3, true.p4], rtol=0.02)
