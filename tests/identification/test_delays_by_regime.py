"""Regimes of a clock, each with a delay of its own: recovered, named, and not made up."""

import numpy as np
import pytest

from butterfly.identification.blocks import Condition
from butterfly.identification.data import DataSet
from butterfly.identification.estimators import HarmonicBalance, OutputError, WeakForm
from butterfly.logs.log import Sine
from butterfly.model.parameters import LumpedParameters
from butterfly.plant.motor import CommandPath
from butterfly.plant.rig import Rig, Simulator
from butterfly.plant.robot import Robot
from butterfly.plant.rollout import simulate_runs
from butterfly.plant.sensors import Clock, ClockRegime, Encoder
from tests.conftest import MASSES

ROBOT = LumpedParameters(p1=0.00325, p2=0.00145, p3=0.04905, p4=0.025, coulomb=3e-4)
DELAY, MESSAGE = 0.003, 0.002
SLOW, FAST = 2.2e-3, 2e-3


def _data(message):
    """Logs whose clocks switch, sooner or later, but for two; faster, commands come late."""
    logs = []
    for number, (mass, omega) in enumerate((m, w) for m in MASSES for w in (3.0, 5.0, 7.0, 9.0)):
        begin = (5.0, 8.0, 11.0)[number % 3]
        switch = ClockRegime(begin=begin, step=FAST, delay=message)
        clock = Clock(step=SLOW, jitter=3e-4, regimes=(switch,) if number > 1 else ())
        rig = Rig(
            robot=Robot.of_lumped(ROBOT),
            simulator=Simulator.GREY_BOX,
            clock=clock,
            path=CommandPath(delay=DELAY),
            encoder=Encoder(noise=2e-4),
        )
        sine = Sine(omega=omega, amplitude=0.6 if omega > 4 else 0.35)
        logs += simulate_runs(rig, [(mass, sine)], 16.0, [np.random.SeedSequence(number)])
    return DataSet.of(logs)


@pytest.fixture(scope="module")
def late():
    return _data(MESSAGE)


def test_both_delays_are_recovered_unasked_and_predict_by_the_interval_alone(late):
    found = OutputError(workers=1)(late)
    values = dict(zip(found.names, found.values.tolist(), strict=True))
    assert values["delay"] == pytest.approx(DELAY + MESSAGE, abs=2e-4)
    assert values["slow_delay"] == pytest.approx(-MESSAGE, abs=2e-4)
    assert FAST < found.fixed["slow_interval"] < SLOW
    one = OutputError(workers=1, terms=())(late)
    gained = late.simulations.fits(found) - late.simulations.fits(one)
    assert gained.mean() > 0.1


def test_where_no_delay_switches_none_is_claimed():
    found = OutputError(workers=1)(_data(0.0))
    assert "slow_delay" not in found.names
    assert "slow_interval" not in found.fixed


@pytest.mark.parametrize("estimator", [HarmonicBalance(), WeakForm()])
def test_other_methods_name_the_regimes(late, estimator):
    first = estimator(late).agreement[0]
    print(estimator(late).agreement)
    assert (first.parameter, first.condition) == ("delay", Condition.REGIME)
