"""Regimes of a clock are found from stamps alone, and no clock is accused that has one."""

from dataclasses import replace

import numpy as np
import pytest

from butterfly.logs.clock import Regime, between_regimes, find_regimes
from butterfly.logs.health import examine
from butterfly.plant.sensors import Clock, ClockRegime, stamps_of

FAST, SLOW = 1.117e-3, 1.21e-3


@pytest.mark.parametrize("begin", [2.0, 5.0, 10.0])
def test_a_switch_is_found_with_both_intervals(begin):
    clock = Clock(step=SLOW, jitter=2e-4, regimes=(ClockRegime(begin=begin, step=FAST),))
    time = 3.0 + stamps_of(clock.cycles(12.0, np.random.default_rng(1)))
    first, second = find_regimes(time)
    assert second.begin - 3.0 == pytest.approx(begin, abs=0.05)
    assert first.interval == pytest.approx(SLOW, rel=0.01)
    assert second.interval == pytest.approx(FAST, rel=0.01)


def test_two_switches_are_found_and_a_gap_is_none():
    back = ClockRegime(begin=6.0, step=SLOW)
    clock = Clock(step=SLOW, jitter=1e-4, regimes=(ClockRegime(begin=3.0, step=FAST), back))
    time = stamps_of(clock.cycles(9.0, np.random.default_rng(2)))
    begins = [each.begin for each in find_regimes(time)]
    np.testing.assert_allclose(begins, [0.0, 3.0, 6.0], atol=0.05)
    time = np.arange(8000) * 1e-3
    time[4000:] += 0.5
    assert len(find_regimes(time)) == 1


def _jittered(rng, n):
    return np.cumsum(np.maximum(1 + 0.3 * rng.random() * rng.standard_normal(n), 0.05))


def _quantised(rng, n):
    step = rng.choice([0.01, 0.1, 0.5, 1.0])
    return np.unique(np.round(np.arange(n) * rng.uniform(0.9, 1.3) / step) * step)


def _with_losses(rng, n):
    return np.arange(n)[rng.random(n) > 0.3 * rng.random()].astype(float)


def _drifting(rng, n):
    share, rate = np.linspace(0, 1, n), rng.uniform(0.3, 3)
    kinds = share, share**2, np.exp(-10 * rate * share), np.sin(2 * np.pi * rate * share)
    drift = 0.1 * rng.random() * kinds[rng.integers(4)]
    return np.cumsum(1 + drift + 0.1 * rng.random() * rng.standard_normal(n))


@pytest.mark.parametrize("clock", [_jittered, _quantised, _with_losses, _drifting])
def test_no_clock_of_one_regime_is_accused(clock):
    rng = np.random.default_rng(3)
    for _ in range(40):
        time = 1e-3 * clock(rng, int(rng.integers(1500, 12_000)))
        assert len(find_regimes(time)) == 1


def test_health_tells_of_a_switch_and_the_log_of_its_slow_commands(sine_log):
    time = np.where(sine_log.time < 10, sine_log.time, 10 + 0.9 * (sine_log.time - 10))
    clean, health = examine(replace(sine_log, time=time))
    assert any("switches from 1 to 0.9 ms at 10 s" in each for each in health.findings)
    np.testing.assert_array_equal(clean.is_slow(0.95e-3), time < health.regimes[1].begin)
    twice = clean.timed(2.0)
    np.testing.assert_array_equal(twice.is_slow(1.9e-3), clean.is_slow(0.95e-3))


def test_one_interval_parts_the_regimes_of_all_logs():
    switches, slow = (Regime(0.0, SLOW), Regime(5.0, FAST)), (Regime(0.0, 1.20e-3),)
    assert FAST < between_regimes([switches, slow], [30.0, 20.0]) < 1.20e-3
    assert between_regimes([slow, slow], [30.0, 20.0]) == 0
