"""Scales that no log shows move parameters as they move the motion."""

import numpy as np
import pytest

from butterfly.identification.consistency import OF_SCALES, prior_contradictions
from butterfly.model.greybox import simulate
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass, LumpedParameters
from butterfly.model.prior import Known, Penalty, Prior
from butterfly.model.terms import TERMS
from tests.identification.simulated import cells

ROBOT = {"p1": 0.004, "p2": 0.002, "p3": 0.05, "p4": 0.3, "coulomb": 0.001}
FRICTION = [
    {"drag": 3e-4},
    {"back_emf": 0.002, "time_constant": 0.02},
    {"stribeck": 0.002, "stribeck_velocity": 0.3},
    {"bristle_stiffness": 0.5, "bristle_damping": 0.002},
]


def test_a_guess_that_logs_contradict_is_called_assumed_and_a_given_value_is_not():
    """Of a delay of .2 s where half a Cauchy distribution of 10 ms is linearised at its peak."""
    rng = np.random.default_rng(0)
    rows, residuals = 1e3 * rng.standard_normal((40, 1, 1)), 1e-2 * rng.standard_normal((40, 1))
    for heavy, assumed in ((True, ("0 to about 0.01",)), (False, ())):
        known = Prior({"delay": Known(value=0.0, uncertainty=0.01, heavy=heavy)})
        prior = Penalty.of(("delay",), known.parameters)
        fit = cells(("delay",), rows, residuals, values=np.array([0.2]), prior=prior)
        (found,) = prior_contradictions(fit, np.array([[1e-8]]), known)
        assert found.parameters == ("delay", *assumed)


def _moving(robot, times, inputs, start=0.2):
    """Return the simulated angles of a robot by its parameters."""
    return simulate(LumpedParameters(**robot), times, inputs, start)[0]


def _scaled(robot, scale, by):
    """Return the parameters that the same motion has where a scale of the records is another."""
    return {name: value * by ** OF_SCALES[scale].get(name, 0.0) for name, value in robot.items()}


SLOW = np.linspace(0.0, 4.0, 2001)
WAVE = np.repeat(0.1 * np.sin(5 * SLOW[:-1, None]), 3, axis=1)


@pytest.mark.parametrize(
    "more", [{}, {"dead_zone": 0.02}, {"compression": 3.0}], ids=lambda more: next(iter(more), "")
)
def test_with_another_unit_of_the_input_the_same_motion_has_parameters_by_their_units(more):
    read = _moving(ROBOT | more, SLOW, WAVE)
    meant = _moving(_scaled(ROBOT | more, "input_scale", 1.3), SLOW, WAVE / 1.3)
    np.testing.assert_allclose(meant, read, atol=1e-9)


@pytest.mark.parametrize(
    "more",
    [
        {"drag": 3e-4},
        {"bias": 2e-3},
        {"spring": 0.03},
        {"coulomb_slope": 1e-3},
        {"load": 1.5e-3, "carried": 1.0},
        {"load_drag": 8e-3, "carried": 1.0},
    ],
    ids=lambda more: next(iter(more)),
)
def test_with_another_unit_of_the_angle_the_same_motion_has_parameters_by_their_torques(more):
    """Without gravity, whose sine knows what a radian is."""
    added = AddedMass(mass=0.1, arm=0.0) if more.get("carried") else NO_ADDED_MASS
    robot = ROBOT | {"p3": 0.0} | {name: more[name] for name in more if name in TERMS}
    read, meant = (
        simulate(LumpedParameters(**each).with_added_mass(added), SLOW, WAVE, start)[0]
        for each, start in ((robot, 0.2), (_scaled(robot, "angle_scale", 1.3), 1.3 * 0.2))
    )
    np.testing.assert_allclose(meant, 1.3 * read, atol=1e-9)


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
