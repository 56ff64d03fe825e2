"""Encoder and noise are told from a log, and drawn as they are."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from butterfly.identification.diagnostics.residuals import SensorErrors, encoder_step
from butterfly.plant.sensors import Encoder

TIME = np.arange(0, 20, 1e-3)


def _read(angle, steps, noise=0.0, seed=0):
    return Encoder(steps=steps, noise=noise).read(TIME, angle, np.random.default_rng(seed))


@given(st.integers(256, 65536), st.floats(0.05, 2.0), st.floats(0.5, 8.0))
def test_the_step_of_an_encoder_is_found_from_its_readings(steps, swing, omega):
    step = math.tau / steps
    readings = _read(swing * np.sin(omega * TIME), steps)
    if swing > 10 * step:
        assert encoder_step(readings) == pytest.approx(step, rel=1e-6)


def test_readings_on_no_grid_have_no_step():
    angle = np.sin(3 * TIME) + 1e-3 * np.random.default_rng(0).standard_normal(TIME.size)
    assert encoder_step(angle) == 0.0
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


def test_noise_without_an_encoder_is_its_own_size():
    noise = 3e-4 * np.random.default_rng(1).standard_normal(TIME.size)
    angle = 0.4 * np.sin(4 * TIME)
    found = SensorErrors.of(angle + noise, angle)
    assert found.step == 0
    assert found.noise == pytest.approx(3e-4, rel=0.02)


def test_errors_are_white_where_noise_covers_a_step_and_last_where_it_does_not():
    """Rounding without noise keeps its error until the angle has moved on by a step."""
    slow = 0.02 * np.sin(0.5 * TIME)
    rng = np.random.default_rng(2)
    for noise, lowest, highest in ((0.0, 0.9, 1.0), (6e-3, -0.05, 0.05)):
        errors = SensorErrors(step=6e-3, noise=noise).draw(slow, rng, unsure=0.0)
        lasting = np.mean(errors[1:] * errors[:-1]) / np.mean(errors**2)
        assert lowest < lasting < highest
