"""What the ranking of next experiments does while it works."""

import threading
from dataclasses import replace

import numpy as np
import pytest

from butterfly.errors import InputError
from butterfly.identification import design
from butterfly.identification.data import DataSet
from butterfly.identification.estimators import HarmonicBalance
from butterfly.logs.log import Sine
from butterfly.plant.motor import CommandPath
from butterfly.plant.rig import Rig, Simulator
from butterfly.plant.robot import Robot
from butterfly.plant.rollout import simulate_runs
from butterfly.plant.sensors import Clock
from butterfly.signals.excitations import FreeDecay, Multisine
from tests.conftest import MASSES
from tests.identification.simulated import ROBOT, steady


@pytest.fixture(scope="module")
def found():
    return HarmonicBalance(terms=(), check=False)(
        DataSet.of(steady(ROBOT, {2.0: 0.2, 4.4: 0.3, 8.5: 0.5}))
    )


def test_progress_is_shown_while_candidates_are_judged(found, monkeypatch):
    begun, judge = threading.Event(), design.judged_candidate

    def track(items, _):
        begun.set()
        yield from items

    def judged(*job, **options):
        assert begun.wait(5), "the work is over before its progress is shown"
        return judge(*job, **options)

    monkeypatch.setattr(design, "judged_candidate", judged)
    assert design.rank_experiments(found, [MASSES[1]], 0.05, track=track)


def test_every_proposed_input_can_be_run_as_it_is_proposed(found):
    ranked = design.rank_experiments(found, [MASSES[1]], 0.05, largest_swing=10.0)
    assert {type(each.signal) for each in ranked} == {Sine, Multisine, FreeDecay}
    robot = Robot.of_lumped(replace(found.parameters, delay=0.0))
    path = CommandPath(delay=max(found.parameters.delay, 0.0))
    rig = Rig(robot=robot, path=path, simulator=Simulator.GREY_BOX, clock=Clock(step=5e-3))
    runs = [(each.added_mass, each.signal) for each in ranked]
    seeds = np.random.SeedSequence(0).spawn(len(runs))
    for each, log in zip(ranked, simulate_runs(rig, runs, design.DURATION, seeds), strict=True):
        assert np.abs(log.angle).max() == pytest.approx(each.swing, rel=0.02), each.what


def test_a_swing_that_is_none_is_refused(found):
    for swing in (0.0, -1.0, float("nan"), "wide"):
        with pytest.raises(InputError, match="swing"):
            design.rank_experiments(found, [MASSES[1]], 0.05, largest_swing=swing)
