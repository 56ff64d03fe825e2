"""Means of neighbouring samples stand for logs that have far more of them than motion."""

from dataclasses import replace

import numpy as np
import pytest

from butterfly.identification.data import DataSet
from butterfly.identification.estimators.output_error import OutputError
from butterfly.logs.health import examine, thinned
from butterfly.logs.log import InputKind, Intersample, Lead, Log
from butterfly.model.prior import Prior
from tests.independent.integrator import Joint, motion

P1, P2, P3, P4, DELAY = 0.011, 0.012, 0.3, 0.4, 0.004
STEP = 1e-4


def _log(hold, phase):
    """A swing by an integrator that shares no code with ours, under an input held or straight."""
    time = STEP * np.arange(100_000)
    inputs = 0.12 * np.sin(3.0 * time) + 0.1 * np.sin(7.3 * time + phase)
    straight = hold == "first_order_hold"
    held = np.append((inputs[1:] + inputs[:-1]) / 2, 0.0) if straight else inputs
    joint = Joint(inertia=P1, viscous=P2, gravity=P3, gain=P4, delay=DELAY)
    measured = np.round(motion(joint, time, held)[0] / 1e-3) * 1e-3
    return Log(time, inputs, measured, input_kind=InputKind.TORQUE, intersample=hold, name="swing")


@pytest.mark.parametrize(("hold", "phase"), [("zero_order_hold", 1.0), ("first_order_hold", 0.0)])
def test_a_fit_to_means_finds_what_a_fit_to_all_samples_does(hold, phase):
    log = _log(hold, phase)
    few = thinned(log, log.time.size // 8)
    assert few.time.size == log.time.size // 8
    known = Prior.of({"p4": P4}, "test")
    true = {"p1": P1, "p2": P2, "p3": P3, "delay": DELAY}
    for each in (log, few):
        found = OutputError()(DataSet.of([each], known=known)).parameters
        for name, value in true.items():
            tolerance = 2e-5 if name == "delay" else 1e-3 * value
            assert getattr(found, name) == pytest.approx(value, abs=tolerance), (name, hold)


def test_short_logs_and_fast_motion_stay_as_they_are():
    time = np.arange(200_000) * 1e-3
    slow, fast = np.sin(2.0 * time), np.sin(400.0 * time)
    random = np.random.default_rng(0).normal(size=time.size)
    log = Log(time, slow, slow + 0.3 * random)
    assert thinned(log) is log
    assert thinned(Log(time, fast, fast), 10_000).time.size == time.size
    assert thinned(log, 10_000).time.size == 10_000  # noise is no motion


def test_motion_is_as_slow_as_it_says_whatever_the_means_alias_it_to():
    time = np.arange(200_000) * 1e-3
    ringing = np.sin(2 * np.pi * 50.0 * time)  # of which the mean over 20 samples is 0
    assert thinned(Log(time, ringing, ringing), 10_000).time.size > 100_000


def test_no_mean_is_taken_across_a_gap_and_none_is_moved():
    time = np.arange(100_000) * 1e-3
    time[50_005:] += 0.5
    log = Log(time, 2.0 * time, 3.0 * time, intersample=Intersample.FIRST_ORDER_HOLD)
    few = thinned(log, 10_000)
    assert few.time.size == 10_000 - 1
    assert np.allclose(few.input, 2.0 * few.time, rtol=1e-12)  # straight lines stay so
    assert np.allclose(few.angle, 3.0 * few.time, rtol=1e-12)


def test_a_held_input_acts_as_much_and_as_late_as_before():
    time = np.arange(100_000) * 1e-3
    few = thinned(Log(time, 2.0 * time, 3.0 * time), 10_000)
    middles = few.time + 0.5 * (few.time[1] - few.time[0])
    assert np.allclose(few.input[1:-1], 2.0 * (middles[1:-1] - 0.5e-3), rtol=1e-9)
    step = Log(time, np.where(time < 50.0037, 0.0, 1.0), 3.0 * time)
    some = thinned(step, 10_000)
    assert 10 * some.input[:-1].sum() == pytest.approx(step.input[:-5].sum(), abs=1.0)


def test_what_a_held_input_did_before_the_first_mean_is_not_lost():
    time = np.arange(100_000) * 1e-3
    log = Log(time, np.ones(time.size), 3.0 * time)
    few = thinned(log, 10_000)
    step = few.time[1] - few.time[0]
    np.testing.assert_allclose(step * np.cumsum(few.input)[:-1], few.time[1:], rtol=1e-9)
    lead = Lead(time=np.array([-1e-3]), input=np.array([1.0]))
    np.testing.assert_allclose(thinned(replace(log, lead=lead), 10_000).input, 1.0, rtol=1e-9)


def test_a_slower_part_of_a_log_stays():
    steps = np.repeat([1e-3, 2.5e-3], 50_000)
    time = np.cumsum(steps)
    few = thinned(Log(time, np.sin(time), np.sin(time)), 10_000)
    assert few.time.size == 10_000
    jittered = np.cumsum(np.random.default_rng(1).gamma(3.0, 1e-3 / 3, 100_000))
    log = Log(jittered, np.sin(jittered), np.sin(jittered))
    share = thinned(log, 50_000).time.size / 50_000
    _, health = examine(log)
    assert 1 - share <= health.gaps / 50_000
