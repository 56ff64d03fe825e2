"""A run is sound where friction explains its rest, and where it shows the mass it should."""

from types import SimpleNamespace

import numpy as np
import pytest

from butterfly.campaigns.bench import ENOUGH
from butterfly.campaigns.drive import SafetyStop
from butterfly.campaigns.plan import Rests, require_changed
from butterfly.identification.estimate import Estimate
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass

MASS = AddedMass(mass=0.1, arm=0.1)
VALUES = {"p1": 0.004, "p2": 0.002, "p3": 0.05, "p4": 0.3, "coulomb": 0.001}


def model(**others):
    """What identification makes of a joint, with intervals that have no width."""
    values = np.array([*(VALUES | others).values()])
    limits = {"lower": values, "upper": values, "covariance": np.zeros((5, 5))}
    estimate = Estimate(method="", names=(*VALUES,), values=values, **limits)
    return SimpleNamespace(estimate=estimate, parameters=estimate.parameters)


@pytest.mark.parametrize("mass", [NO_ADDED_MASS, MASS])
def test_a_rest_outside_two_bands_of_friction_is_a_slip(mass):
    moment = VALUES["p3"] + 9.81 * mass.mass * mass.arm
    most = 2 * 2 * VALUES["coulomb"] / moment + ENOUGH  # friction holds it either side of 0
    rests = Rests()
    rests.take(mass, 0.3)
    rests.require_no_slip(0.3 + 0.99 * most, mass, model())
    rests.require_no_slip(0.3 + 9 * most, mass, None)
    with pytest.raises(SafetyStop, match="encoder slips"):
        rests.require_no_slip(0.3 - 1.01 * most, mass, model())


def _step(mass):
    return SimpleNamespace(added_mass=mass)


def test_a_joint_that_moves_as_it_did_without_the_mass_does_not_carry_it():
    inertia, moment = MASS.mass * MASS.arm**2, 9.81 * MASS.mass * MASS.arm
    unloaded = model(p1=VALUES["p1"] - inertia, p3=VALUES["p3"] - moment)  # by logs said to have it
    steps = _step(NO_ADDED_MASS), _step(MASS)
    require_changed(model(), *steps, model)
    with pytest.raises(SafetyStop, match="is not mounted"):
        require_changed(model(), *steps, lambda: unloaded)


@pytest.mark.parametrize("mass", [NO_ADDED_MASS, AddedMass(mass=1e-4, arm=0.1)])
def test_a_mass_that_changes_hardly_anything_is_not_asked_about(mass):
    require_changed(model(), _step(NO_ADDED_MASS), _step(mass), lambda: pytest.fail("asked"))
