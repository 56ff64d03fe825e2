"""Runs that are proposed lie where a pendulum's formulas say, and within the limits."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from butterfly.campaigns.bench import STILL
from butterfly.campaigns.guard import Expected, Limits
from butterfly.campaigns.plan import candidates, duration_of, played, probe, validation
from butterfly.logs.log import InputKind, Sine
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass
from tests.campaigns.robots import COMMAND, TRUE

LIMITS = Limits(command=COMMAND, angle=1.0)
MASS = AddedMass(mass=0.1, arm=0.1)
KNOWN = SimpleNamespace(parameters=TRUE)


def resonance(mass):
    """The frequency in rad/s at which a damped pendulum swings most, with a mass on its arm."""
    inertia = TRUE.p1 + mass.mass * mass.arm**2
    stiffness = TRUE.p3 + mass.mass * mass.arm * 9.81
    return math.sqrt(stiffness / inertia - (TRUE.p2 / inertia) ** 2 / 2)


@pytest.mark.parametrize("mass", [NO_ADDED_MASS, MASS])
def test_a_run_lasts_eight_periods_of_the_resonance(mass):
    periods = 8 * 2 * math.pi / resonance(mass)
    assert duration_of(TRUE, mass, LIMITS) == pytest.approx(STILL + periods, rel=1e-3)


@pytest.mark.parametrize("mass", [NO_ADDED_MASS, MASS])
def test_sines_are_proposed_on_both_sides_of_the_resonance_within_the_command(mass):
    recipes = candidates(KNOWN, mass, LIMITS, InputKind.TORQUE)
    sines = [each.signal for each in recipes if isinstance(each.signal, Sine)]
    tones = {round(sine.omega / resonance(mass), 3) for sine in sines}
    assert min(tones) < 1 < max(tones)
    assert tones <= {0.6, 0.8, 1.25, 1.6, 2.5}
    assert all(sine.amplitude <= 0.6 * COMMAND for sine in sines)


def test_no_sine_is_proposed_that_may_not_move_the_joint_from_rest():
    def least(breakaway):
        recipes = candidates(KNOWN, NO_ADDED_MASS, LIMITS, InputKind.TORQUE, breakaway)
        return min(each.signal.amplitude for each in recipes if isinstance(each.signal, Sine))

    assert least(0.0) < 1.2 * 0.04 <= least(0.04)


def test_the_run_that_is_predicted_moves_the_joint_from_rest_within_the_command():
    def largest(breakaway):
        of_run = KNOWN, NO_ADDED_MASS, LIMITS, InputKind.TORQUE, breakaway
        signal = validation(*of_run).signal
        return np.abs(signal.sample(np.arange(0, 2 * math.pi / signal.base, 0.001))).max()

    assert largest(0.05) == pytest.approx(1.2 * 0.05, rel=0.01)
    assert largest(9.0) == pytest.approx(0.6 * COMMAND, rel=0.01)


def test_a_relay_that_is_played_on_the_model_swings_as_far_as_it_should_and_no_farther():
    recipe = probe(NO_ADDED_MASS, 0.05, LIMITS, 12.5)
    log = played(None, KNOWN, recipe, LIMITS, Expected(resonance=resonance(NO_ADDED_MASS)))
    late = np.abs(log.angle[(log.time > 5) & (log.time < 8)])
    assert late.max() == pytest.approx(0.6 * 0.3 * LIMITS.angle, rel=0.3)
    assert np.abs(log.input).max() <= 0.6 * COMMAND
