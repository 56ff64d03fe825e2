"""Other parameters on the same logs, and what that costs."""

import math
from dataclasses import replace

import pytest

from butterfly.identification import free_run
from butterfly.identification.data import DataSet
from butterfly.identification.parameters_by_hand import best_gain, try_parameters
from butterfly.identification.simulation import Simulation
from tests.identification.simulated import ROBOT, SWINGS, steady


@pytest.fixture
def data():
    return DataSet.of(steady(ROBOT, dict(list(SWINGS.items())[::2]))[::2])


@pytest.fixture
def built(monkeypatch):
    """Count the trajectories that are built."""
    count = []

    class Counted(Simulation):
        def __init__(self, *arguments):
            count.append(arguments[0].name)
            super().__init__(*arguments)

    monkeypatch.setattr(free_run, "Simulation", Counted)
    return count


def test_the_best_gain_is_the_true_one_and_each_trajectory_is_built_once(data, built):
    found = best_gain(replace(ROBOT, p4=math.nan), data)
    assert found == pytest.approx(ROBOT.p4, rel=1e-3)
    assert sorted(built) == sorted(log.name for log in data.logs)


def test_comparisons_share_the_trajectories_and_say_whether_the_gain_was_fitted(data, built):
    fitted = try_parameters("sheet", replace(ROBOT, p4=math.nan), data)
    given = try_parameters("table", replace(ROBOT, p1=1.2 * ROBOT.p1), data)
    assert (fitted.gain_fitted, given.gain_fitted) == (True, False)
    assert fitted.summary.worst > 99
    assert given.summary.median < fitted.summary.median - 5
    assert len(built) <= 2 * len(data.logs)  # the grid follows the resonance, not the gain
