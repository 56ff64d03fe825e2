"""Slopes of local polynomials, against SciPy's filter and against polynomials themselves."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import savgol_filter

from butterfly.signals.local_polynomial import slope

VALUES = np.cumsum(np.random.default_rng(0).standard_normal(3000))


@pytest.mark.parametrize(
    ("size", "reach", "order"),
    [(3000, 62, 4), (2150, 20, 4), (3000, 3, 4), (125, 62, 4), (126, 62, 4), (7, 3, 4), (99, 4, 2)],
)
def test_slopes_are_those_of_scipy_s_savitzky_golay_filter_up_to_the_ends(size, reach, order):
    values, step = VALUES[:size], 0.01
    found = slope(values, reach, order, step)
    expected = savgol_filter(values, 2 * reach + 1, order, deriv=1, delta=step, mode="interp")
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_the_slope_of_a_polynomial_is_exact_up_to_the_ends(order):
    time = 0.02 * np.arange(200) - 1
    found = slope(time**order, 10, 4, 0.02)
    np.testing.assert_allclose(found, order * time ** (order - 1), rtol=0, atol=1e-11)


def test_at_rest_the_slope_is_0_to_the_last_bit():
    """Its sign is the direction of friction."""
    assert not slope(np.full(300, 0.1), 20, 4, 1e-3).any()
