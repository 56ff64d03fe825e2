"""Polynomials between a simulation's instants, and slopes of local ones, against SciPy's."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicHermiteSpline
from scipy.signal import savgol_filter

from butterfly.signals import hold

VALUES = np.cumsum(np.random.default_rng(0).standard_normal(3000))


def _random(seed):
    rng = np.random.default_rng(seed)
    grid = np.cumsum(rng.uniform(0.5, 1.5, 20))
    angle, velocity = rng.standard_normal((2, grid.size))
    count = int(rng.integers(1, 80))
    instants = np.sort(rng.uniform(grid[0], grid[-1], count))
    if seed % 2:
        instants = np.sort(np.concatenate([instants, grid[[0, 3, -1]], grid[-1:] + 0.1]))
    return grid, angle, velocity, instants, rng.standard_normal(instants.size)


@given(seed=st.integers(0, 10**6), slopes=st.booleans())
def test_they_are_the_cubic_hermite_splines_and_go_on_beyond_the_end(seed, slopes):
    grid, angle, velocity, instants, _ = _random(seed)
    expected = CubicHermiteSpline(grid, angle, velocity)(instants, int(slopes))
    found = hold.interpolate(grid, angle, velocity, instants, slopes)
    np.testing.assert_allclose(found, expected, atol=1e-12)


@settings(max_examples=40)
@given(seed=st.integers(0, 10**6), slopes=st.booleans())
def test_averages_are_those_over_the_instants_of_each_interval(seed, slopes):
    grid, angle, velocity, instants, values = _random(seed)
    into, weights, means, counts = hold.averages(grid, instants, values, slopes)
    spline = CubicHermiteSpline(grid, angle, velocity)
    expected, rates = (spline(instants, int(slopes) + more) for more in (0, 1))
    cell = np.clip(np.searchsorted(grid, instants, "right") - 1, 0, grid.size - 2)
    assert sorted(set(cell)) == np.flatnonzero(into >= 0).tolist()
    for k in np.unique(cell):
        row, inside = into[k], cell == k
        ends = [angle[k], velocity[k], angle[k + 1], velocity[k + 1]]
        assert weights[:4, row] @ ends == pytest.approx(expected[inside].mean(), abs=1e-12)
        assert weights[4:, row] @ ends == pytest.approx(-rates[inside].mean(), rel=1e-9, abs=1e-9)
        assert counts[row] == inside.sum()
        assert means[row] == pytest.approx(values[inside].mean(), abs=1e-12)


@pytest.mark.parametrize(
    ("size", "reach", "order"),
    [(3000, 62, 4), (2150, 20, 4), (3000, 3, 4), (125, 62, 4), (126, 62, 4), (7, 3, 4), (99, 4, 2)],
)
def test_slopes_are_those_of_scipy_s_savitzky_golay_filter_up_to_the_ends(size, reach, order):
    values, step = VALUES[:size], 0.01
    found = hold.slope(values, reach, order, step)
    expected = savgol_filter(values, 2 * reach + 1, order, deriv=1, delta=step, mode="interp")
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_the_slope_of_a_polynomial_is_exact_up_to_the_ends(order):
    time = 0.02 * np.arange(200) - 1
    found = hold.slope(time**order, 10, 4, 0.02)
    np.testing.assert_allclose(found, order * time ** (order - 1), rtol=0, atol=1e-11)


def test_at_rest_the_slope_is_0_to_the_last_bit():
    """Its sign is the direction of friction."""
    assert not hold.slope(np.full(300, 0.1), 20, 4, 1e-3).any()
