"""Random robots of the independent integrator; `make coverage` makes many of them."""

import numpy as np
import pytest

from tests.benchmarks.coverage import report
from tests.independent.robots import FAMILIES, draw
from tests.independent.scores import METHODS, score

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


def test_numbers_determine_a_robot_and_a_repeat_its_noise_alone(robot):
    numbers = robot.family, robot.number, robot.seed
    same, other = draw(*numbers), draw(*numbers, repeat=1)
    assert same.truth == other.truth == robot.truth
    for log, again, noisy in zip(robot.logs, same.logs, other.logs, strict=True):
        np.testing.assert_array_equal(again.angle, log.angle)
        np.testing.assert_array_equal(noisy.time, log.time)
        assert 0.0 < np.std(noisy.angle - log.angle) < 5e-3
