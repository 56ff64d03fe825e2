"""Robust losses: their weights and slopes are derivatives, and outliers count less."""

import numpy as np
import pytest

from butterfly.identification.loss import Loss, outlying

RESIDUALS = np.array([-3.1, -0.9, -0.2, 0.0, 0.3, 0.8, 1.7, 5.0])
STEP = 1e-6


@pytest.mark.parametrize("loss", Loss)
@pytest.mark.parametrize("scale", [0.5, 2.0])
def test_weights_and_slopes_are_derivatives_of_the_loss(loss, scale):
    def pull(residuals):
        return residuals * loss.weights(residuals, scale)

    above, below = RESIDUALS + STEP, RESIDUALS - STEP
    slopes = (loss.values(above, scale) - loss.values(below, scale)) / (2 * STEP)
    np.testing.assert_allclose(2 * pull(RESIDUALS), slopes, atol=1e-8)
    bent = (pull(above) - pull(below)) / (2 * STEP)
    np.testing.assert_allclose(loss.slopes(RESIDUALS, scale), bent, atol=1e-8)


@pytest.mark.parametrize("loss", [loss for loss in Loss if loss is not Loss.LINEAR])
def test_small_residuals_count_as_squares_and_outliers_less(loss):
    small = np.array([1e-4])
    np.testing.assert_allclose(loss.values(small, 1.0), small**2, rtol=1e-6)
    assert loss.values(np.array([100.0]), 1.0)[0] < 0.05 * 100.0**2


def test_of_normal_residuals_one_in_twenty_is_outlying_however_large_the_rest_is():
    residuals = np.random.default_rng(0).standard_normal(20_000)
    assert np.mean(np.abs(residuals) > outlying(residuals)) == pytest.approx(0.05, abs=0.005)
    spoilt = np.where(np.arange(residuals.size) % 10 == 0, 1e6, residuals)
    assert outlying(spoilt) == pytest.approx(outlying(residuals), rel=0.15)
