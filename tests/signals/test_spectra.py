"""Periodogram, amplitude (71), resampling and steady window."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from butterfly.errors import InputError
from butterfly.logs.log import Sine
from butterfly.signals.spectrum import periodogram, resample, rms_amplitude, uniform_grid
from butterfly.signals.window import steady_window


@given(periods=st.integers(1, 30), length=st.integers(3, 20), amplitude=st.floats(0.1, 10))
def test_a_sine_on_a_bin_has_the_periodogram_33(periods, length, amplitude):
    count = periods * length
    values = amplitude * np.sin(2 * np.pi / length * np.arange(1, count + 1))
    omega, power = periodogram(values, 1.0)
    peak = np.argmax(power)
    assert omega[peak] == pytest.approx(2 * np.pi / length)
    assert power[peak] == pytest.approx(count * amplitude**2 / 4)
    assert np.delete(power, peak) == pytest.approx(0, abs=1e-9 * count * amplitude**2)


@given(st.lists(st.floats(-10, 10), min_size=3, max_size=60))
def test_the_periodogram_keeps_the_energy_of_a_centred_signal(values):
    centred = np.array(values) - np.mean(values)
    _, power = periodogram(centred, 0.1)
    both_sides = 2 * power.sum() - (power[-1] if len(values) % 2 == 0 else 0)
    assert both_sides == pytest.approx(np.sum(centred**2), abs=1e-9)


def test_white_noise_biases_the_amplitude_71_as_the_errata_say():
    time = np.arange(200_000) * 0.001
    noise = 0.3 * np.random.default_rng(0).standard_normal(time.size)
    clean = 0.5 * np.sin(2 * np.pi * time)
    assert rms_amplitude(clean) == pytest.approx(0.5, rel=1e-9)
    assert rms_amplitude(clean + noise) == pytest.approx(np.sqrt(0.5**2 + 2 * 0.3**2), rel=5e-3)


@given(step=st.floats(0.01, 1), count=st.integers(2, 200))
def test_the_uniform_grid_stays_within_the_stamps(step, count):
    time = np.linspace(0.3, 0.3 + step * (count - 1), count)
    grid = uniform_grid(time, step)
    assert grid.size == count
    assert grid[-1] <= time[-1] + 1e-9
    np.testing.assert_allclose(uniform_grid(time), time)


def test_resampling_is_exact_for_a_straight_line():
    time = np.sort(np.random.default_rng(1).uniform(0, 1, 50))
    grid = np.linspace(time[0], time[-1], 33)
    np.testing.assert_allclose(resample(time, 3 * time - 1, grid), 3 * grid - 1)


@pytest.mark.parametrize("omega", [2.0, 4.75, 16.0])
def test_the_steady_window_holds_whole_periods_at_the_end(sine_log, omega):
    rows = steady_window(sine_log, omega, 30.0)
    duration = rows.sum() * sine_log.mean_step
    periods = duration * omega / (2 * np.pi)
    assert rows[-1]
    assert periods == pytest.approx(round(periods), abs=0.01)
    assert 30 - 2 * np.pi / omega < duration <= 30.001


def test_three_periods_of_a_slow_sine_may_take_longer_than_the_window(sine_log):
    slowest = 3.5 * 2 * np.pi / (sine_log.time[-1] - sine_log.time[0])
    seconds = 2.0 * np.pi / slowest  # room for one
    rows = steady_window(sine_log, slowest, seconds)
    assert rows.sum() * sine_log.mean_step == pytest.approx(3.0 * seconds, rel=1e-2)


def test_a_log_of_too_few_periods_is_refused(sine_log):
    short = replace(sine_log, excitation=Sine(omega=0.3, amplitude=1.0))
    with pytest.raises(InputError, match="at least 3 periods"):
        steady_window(short, 0.3)
