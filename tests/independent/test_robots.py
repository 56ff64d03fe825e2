"""Random robots of the independent integrator; `make coverage` makes many of them."""

import math

import numpy as np
import pytest

from tests.benchmarks.coverage import report
from tests.independent.robots import FAMILIES, draw
from tests.independent.scores import METHODS, score

pytestmark = pytest.mark.slow

SEED = 7
ROBOTS = {"A": 0, "B": 0, "C": 1}
"""One of each family, in which no method ends far off."""

SHARED = ("p1", "p3", "p4")  # the closed forms know nothing of some friction in B


@pytest.fixture(scope="module", params=FAMILIES)
def robot(request):
    return draw(request.param, ROBOTS[request.param], SEED)


def test_every_method_finds_a_robot_of_another_integrator(robot):
    methods = [name for name, (_, families) in METHODS.items() if robot.family in families]
    scores = [score(robot, name) for name in methods]
    for each in scores:
        assert not each.refused
        assert not each.local_minimum
        assert max(abs(each.readings[name].error) for name in SHARED) < 5.0, each
    assert all(name in report(scores) for name in methods)


def test_sines_lie_on_both_sides_of_resonance_and_outdo_coulomb_friction(robot):
    truth, sines = robot.truth, [log for log in robot.logs if log.excitation]
    assert (len(sines) == len(robot.logs)) is (robot.family != "C")
    assert len(robot.masses) == 3
    for added in {log.added_mass for log in sines}:
        loaded = truth.with_added_mass(added)
        omegas = [log.excitation.omega for log in sines if log.added_mass == added]
        assert 4 <= len(omegas) <= 6
        assert min(omegas) < math.sqrt(loaded.p3 / loaded.p1) < max(omegas)
    for log in sines:
        assert truth.coulomb <= 0.3 * truth.p4 * log.excitation.amplitude
        assert np.abs(log.angle - robot.zero).max() < 1.0


def test_numbers_determine_a_robot_and_a_repeat_its_noise_alone(robot):
    numbers = robot.family, robot.number, robot.seed
    same, other = draw(*numbers), draw(*numbers, repeat=1)
    assert same.truth == other.truth == robot.truth
    for log, again, noisy in zip(robot.logs, same.logs, other.logs, strict=True):
        np.testing.assert_array_equal(again.angle, log.angle)
        np.testing.assert_array_equal(noisy.time, log.time)
        assert 0.0 < np.std(noisy.angle - log.angle) < 5e-3
