"""Periodogram, amplitude (71), uniform grid and the frequency at which a signal moves most."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from butterfly.signals.frequency_response import (
    dominant_frequency,
    dominant_period,
    periodogram,
    rms_amplitude,
    uniform_grid,
)
from tests.independent.integrator import Joint, motion


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


@pytest.mark.parametrize("omega", [0.7, 5.0, 40.0])
def test_the_frequency_of_a_noisy_sine_is_found_on_any_clock(omega):
    rng = np.random.default_rng(3)
    time = np.cumsum(rng.uniform(1e-3, 3e-3, 15_000))
    values = 0.4 + np.sin(omega * time + 0.3) + 0.2 * rng.standard_normal(time.size)
    found, share = dominant_frequency(time, values)
    assert found == pytest.approx(omega, rel=1e-3)
    assert 0.9 < share < 1.0


def test_a_long_log_is_thinned_and_a_constant_has_no_frequency():
    time = np.arange(0, 100, 1e-3)
    assert dominant_frequency(time, np.sin(3 * time))[0] == pytest.approx(3.0, rel=1e-5)
    assert dominant_frequency(time, np.ones_like(time)) == (0.0, 0.0)


@pytest.mark.parametrize("samples", [10, 60])
@pytest.mark.parametrize("ratio", [0.01, 0.15])
def test_two_noisy_periods_of_a_damped_swing_show_their_period(ratio, samples):
    """A film's noise is up to a tenth of the swing; half of the swings are about another rest."""
    time = 9.0 / samples * np.arange(2 * samples + 1)
    omega, rng = 2 * np.pi / 9.0, np.random.default_rng(1)
    joint = Joint(inertia=1.0, viscous=2 * ratio * omega, gravity=omega**2, gain=1.0)
    true = 9.0 / np.sqrt(1 - ratio**2)
    for start in (0.4, 0.0):
        torque = np.full(time.size, 0.2 * omega**2 * (start == 0))
        angle, _ = motion(joint, time, torque, start, step=0.02)
        for noise in (0.0, 0.03, 0.1):
            seen = angle + noise * 0.4 * rng.standard_normal(time.size)
            assert dominant_period(time, seen) == pytest.approx(true, rel=0.12)


def test_a_drift_hides_no_period_and_a_drift_alone_has_that_of_its_length():
    time = np.arange(0.0, 40.0, 0.05)
    assert dominant_period(time, 0.2 * time + np.sin(1.5 * time)) == pytest.approx(4.19, rel=0.05)
    assert dominant_period(time, 0.2 * time) == pytest.approx(time[-1])
    assert dominant_period(time, np.ones_like(time)) == pytest.approx(time[-1])
