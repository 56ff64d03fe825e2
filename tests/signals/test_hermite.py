"""Polynomials between the instants of a simulation, against SciPy's."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import CubicHermiteSpline

from butterfly.signals import hermite


def _random(seed):
    rng = np.random.default_rng(seed)
    grid = np.cumsum(rng.uniform(0.5, 1.5, 20))
    angle, velocity = rng.standard_normal((2, grid.size))
    count = int(rng.integers(1, 80))
    instants = np.sort(rng.uniform(grid[0], grid[-1], count))
    if seed % 2:
        instants = np.sort(np.concatenate([instants, grid[[0, 3, -1]], grid[-1:] + 0.1]))
    return grid, angle, velocity, instants, rng.standard_normal(instants.size)


@given(seed=st.integers(0, 10**6))
def test_they_are_the_cubic_hermite_splines_and_go_on_beyond_the_end(seed):
    grid, angle, velocity, instants, values = _random(seed)
    expected = CubicHermiteSpline(grid, angle, velocity)(instants)
    found = hermite.interpolate(grid, angle, velocity, instants)
    np.testing.assert_allclose(found, expected, atol=1e-12)
    distance = hermite.squared_distance(grid, angle, velocity, instants, values)
    assert distance == pytest.approx(np.sum((expected - values) ** 2), rel=1e-10)


@given(seed=st.integers(0, 10**6))
def test_averages_are_those_over_the_instants_of_each_interval(seed):
    grid, angle, velocity, instants, values = _random(seed)
    into, weights, means = hermite.averages(grid, instants, values)
    expected = CubicHermiteSpline(grid, angle, velocity)(instants)
    cell = np.clip(np.searchsorted(grid, instants, "right") - 1, 0, grid.size - 2)
    assert sorted(set(cell)) == np.flatnonzero(into >= 0).tolist()
    for k in np.unique(cell):
        row, inside = into[k], cell == k
        ends = [angle[k], velocity[k], angle[k + 1], velocity[k + 1]]
        assert weights[:, row] @ ends == pytest.approx(expected[inside].mean(), abs=1e-12)
        assert means[row] == pytest.approx(values[inside].mean(), abs=1e-12)
