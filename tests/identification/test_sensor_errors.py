"""What is left over: its sensor's errors, its correlations, and the missing term it looks like."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from butterfly.identification.sensor_errors import (
    Curve,
    SensorErrors,
    correlations,
    encoder_step,
)
from butterfly.plant.sensors import Encoder

TIME = np.arange(0, 20, 1e-3)
COUNT, LAGS = 3000, 150


def _read(angle, steps, noise=0.0, seed=0):
    return Encoder(steps=steps, noise=noise).read(TIME, angle, np.random.default_rng(seed))


@given(st.integers(256, 65536), st.floats(0.05, 2.0), st.floats(0.5, 8.0))
def test_the_step_of_an_encoder_is_found_from_its_readings(steps, swing, omega):
    step = math.tau / steps
    readings = _read(swing * np.sin(omega * TIME), steps)
    if swing > 10 * step:
        assert encoder_step(readings) == pytest.approx(step, rel=1e-6)


def test_readings_on_no_grid_have_no_step_and_their_noise_is_its_own_size():
    noise = 3e-4 * np.random.default_rng(1).standard_normal(TIME.size)
    angle = 0.4 * np.sin(4 * TIME)
    found = SensorErrors.of(angle + noise, angle)
    assert found.step == 0
    assert found.noise == pytest.approx(3e-4, rel=0.02)
    assert encoder_step(np.zeros(5)) == 0.0


@pytest.mark.parametrize("steps", [1024, 16384])
@pytest.mark.parametrize("noise", [0.0, 2e-4, 1e-3])
def test_the_noise_before_rounding_is_found_beside_a_misfit(steps, noise):
    """A smooth misfit of 10 mrad does not count as noise; much less noise than a step does not
    show."""
    angle = 0.4 * np.sin(4 * TIME)
    misfit = 0.01 * np.sin(4 * TIME + 1)
    found = SensorErrors.of(_read(angle + misfit, steps, noise), angle)
    step = math.tau / steps
    assert found.step == pytest.approx(step, rel=1e-6)
    assert found.noise == pytest.approx(noise, abs=max(0.1 * noise, 0.05 * step))


def test_errors_are_white_where_noise_covers_a_step_and_last_where_it_does_not():
    """Rounding without noise keeps its error until the angle has moved on by a step."""
    slow = 0.02 * np.sin(0.5 * TIME)
    rng = np.random.default_rng(2)
    for noise, lowest, highest in ((0.0, 0.9, 1.0), (6e-3, -0.05, 0.05)):
        ones = np.ones(slow.size, dtype=int)
        errors = SensorErrors(step=6e-3, noise=noise).draw(slow, np.zeros(1), ones, rng)[:, 0]
        lasting = np.mean(errors[1:] * errors[:-1]) / np.mean(errors**2)
        assert lowest < lasting < highest


@pytest.mark.parametrize("noise", [0.0, 1e-4, 1e-3, 2.9e-3])
def test_means_of_errors_are_drawn_as_if_each_reading_were(noise):
    """Their mean and spread, of an angle that is off or not, are those of an encoder's readings."""
    angle, step, tries = 0.1 * np.sin(2 * TIME[:4000]), 6e-3, 400
    counts, shifts = np.tile([9, 11], 200), np.repeat([0.0, 2e-3], tries)
    drawn = SensorErrors(step=step, noise=noise).draw(
        angle, shifts, counts, np.random.default_rng(1)
    )
    rng, begins = np.random.default_rng(2), np.cumsum(counts) - counts
    for shift in (0.0, 2e-3):
        moved = angle + shift + noise * rng.standard_normal((tries, angle.size))
        errors = step * np.rint(moved / step) - angle - shift
        read = np.add.reduceat(errors, begins, axis=1) / counts
        found = drawn[:, shifts == shift].T
        np.testing.assert_allclose(found.mean(axis=0), read.mean(axis=0), atol=0.12 * step)
        assert np.abs(found.mean(axis=0) - read.mean(axis=0)).mean() < 0.02 * step
        assert found.std(axis=0).mean() == pytest.approx(
            read.std(axis=0).mean(), rel=0.05, abs=1e-9
        )


def _autoregressive(pole, shape, rng):
    errors = rng.standard_normal(shape)
    for k in range(1, shape[0]):
        errors[k] += pole * errors[k - 1]
    return errors


def test_correlations_are_their_sums():
    rng = np.random.default_rng(1)
    errors, inputs = rng.standard_normal((200, 3)), rng.standard_normal(200) + 5
    own, crossed = correlations(errors.T, inputs, 9)
    moving = inputs - inputs.mean()
    for series in range(3):
        e = errors[:, series]
        for lag in range(1, 10):
            assert own[lag - 1, series] == pytest.approx(e[lag:] @ e[:-lag] / (e @ e))
        for lag in range(10):
            size = np.sqrt((e @ e) * (moving @ moving))
            assert crossed[lag, series] == pytest.approx(e[lag:] @ moving[: 200 - lag] / size)


@pytest.mark.slow
@pytest.mark.parametrize("pole", [0.0, 0.7])
def test_of_good_logs_one_curve_in_forty_leaves_its_band(pole):
    """5 % of logs, half of them by the autocorrelation; white errors and lasting ones."""
    rng = np.random.default_rng(3)
    lag = np.arange(1, LAGS + 1)
    tries, left = 200, 0
    for _ in range(tries):
        errors = _autoregressive(pole, (COUNT, 25), rng)
        curves, _ = correlations(errors.T, errors[:, 0], LAGS)
        left += Curve.of(lag, curves, COUNT, 0.0).excess > 1
    assert left / tries < 0.06


def test_lasting_errors_leave_the_bands_of_white_ones():
    rng = np.random.default_rng(4)
    white, lasting = rng.standard_normal((COUNT, 24)), _autoregressive(0.2, (COUNT, 1), rng)
    curves, _ = correlations([*lasting.T, *white.T], white[:, 0], LAGS)
    assert Curve.of(np.arange(1, LAGS + 1), curves, COUNT, 0.0).excess > 1
