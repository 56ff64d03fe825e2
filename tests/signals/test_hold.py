"""What an input does between its stamps, against integrals by quadrature."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from butterfly.logs.log import Intersample
from butterfly.signals import hold

ZERO, FIRST = Intersample.ZERO_ORDER_HOLD, Intersample.FIRST_ORDER_HOLD
TIME = np.array([0.3, 0.4, 0.75, 0.8, 1.3])
INPUTS = np.array([1.0, -2.0, 3.0, 0.5, 4.0])


def _held(t, kind):
    if kind is FIRST:
        return float(np.interp(t, TIME, INPUTS))
    return 0.0 if t < TIME[0] else float(INPUTS[np.flatnonzero(t >= TIME)[-1]])


@pytest.mark.parametrize("kind", [ZERO, FIRST])
def test_the_parabola_over_an_interval_has_the_moments_of_the_input(kind):
    edges = np.array([0.1, 0.25, 0.5, 0.77, 0.78, 1.25, 1.6])
    start, centre, end = hold.parabolas(TIME, INPUTS, edges, kind)[0].T
    found = [(start + 4 * centre + end) / 6, (end - start) / 2, (start - 2 * centre + end) / 3]
    for cell, (begin, end) in enumerate(pairwise(edges)):
        middle, half = (begin + end) / 2, (end - begin) / 2
        polynomials = (np.ones_like, lambda x: 3 * x, lambda x: 5 * (3 * x**2 - 1) / 2)
        inside = [t for t in TIME if begin < t < end]
        for order, weight in enumerate(polynomials):

            def integrand(t, weight=weight, middle=middle, half=half):
                return _held(t, kind) * weight((t - middle) / half) / (2 * half)

            expected, _ = quad(integrand, begin, end, points=inside or None)
            assert found[order][cell] == pytest.approx(expected, abs=1e-8)
    np.testing.assert_allclose(hold.mean(TIME, INPUTS, edges, kind), found[0], rtol=1e-12)


@pytest.mark.parametrize("kind", [ZERO, FIRST])
@given(seed=st.integers(0, 1000))
def test_no_impulse_is_lost_wherever_the_edges_fall(kind, seed):
    rng = np.random.default_rng(seed)
    time, inputs = np.cumsum(rng.uniform(0.5, 1.5, 40)), rng.standard_normal(40)
    begin, end = time[0] - 1, time[-1] + 2
    totals = []
    for count in rng.integers(2, 300, 2):
        edges = np.sort(np.concatenate([[begin, end], rng.uniform(begin, end, count)]))
        totals.append(hold.mean(time, inputs, edges, kind) @ np.diff(edges))
    assert totals[0] == pytest.approx(totals[1], rel=1e-9, abs=1e-9)


@given(seed=st.integers(0, 1000), delay=st.floats(0, 0.5))
def test_the_sums_of_a_held_input_against_parabolas_are_the_integrals(seed, delay):
    rng = np.random.default_rng(seed)
    grid = np.linspace(-2, 12, 29)
    time, inputs = np.cumsum(rng.uniform(0.1, 1.0, 12)) + delay, rng.standard_normal(12)
    inputs[-1] = 0.0  # so that no end of the clock counts
    samples = hold.for_sums(time, inputs, grid, ZERO)
    for order in range(3):
        integral = inputs[:-1] @ np.diff(time ** (order + 1) / (order + 1))
        assert samples @ grid**order * 0.5 == pytest.approx(integral, abs=1e-9)
    early = grid > 5
    cut = hold.for_sums(time, inputs, grid[early], ZERO)
    np.testing.assert_allclose(cut, samples[early], rtol=0, atol=1e-12)


def test_the_sums_of_a_held_sine_against_a_smooth_signal_converge_with_fourth_order():
    """Of a sine, stamped between the samples; the smooth signal is a cosine under a bump."""

    def smooth(t):
        return np.maximum(1 - (t - 3.1) ** 2, 0) ** 4 * np.cos(3 * t)

    errors = []
    for step in (0.08, 0.04, 0.02):
        grid = np.arange(0, 6, step)
        time = grid + 0.01
        inputs = np.sin(5 * time)
        nodes, weights = np.polynomial.legendre.leggauss(12)
        inner = time[:-1, None] + np.diff(time)[:, None] * (nodes + 1) / 2
        integral = inputs[:-1] @ (smooth(inner) @ weights / 2 * np.diff(time))
        errors.append(abs(hold.for_sums(time, inputs, grid, ZERO) @ smooth(grid) * step - integral))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert orders.min() > 3.5, orders
    assert errors[-1] < 1e-6


def test_the_values_of_a_continuous_input_stand_for_it_in_sums():
    grid = np.linspace(0, 2, 21)
    found = hold.for_sums(TIME, INPUTS, grid, FIRST)
    np.testing.assert_array_equal(found, np.interp(grid, TIME, INPUTS))


def _slope(time, inputs, edges, kind, step):
    """The parabolas' slope by a delay, as a difference."""
    later, earlier = (hold.parabolas(time, inputs, edges - by, kind)[0] for by in (step, -step))
    return (later - earlier) / (2 * step)


@pytest.mark.parametrize("kind", [ZERO, FIRST])
@given(delay=st.floats(-0.2, 0.4))
def test_the_slope_of_a_parabola_is_that_by_a_delay(kind, delay):
    edges = np.array([0.1, 0.25, 0.5, 0.77, 0.78, 1.25, 1.6])
    found = hold.parabolas(TIME, INPUTS, edges - delay, kind)
    step = 1e-7
    difference = _slope(TIME, INPUTS, edges - delay, kind, step)
    stamps = np.abs(TIME[:, None] - (edges - delay)).min(axis=0) < 2 * step
    smooth = ~(stamps[1:] | stamps[:-1])  # a stamp on an edge makes a kink
    np.testing.assert_allclose(found[1][smooth], difference[smooth], rtol=1e-4, atol=1e-3)


@given(count=st.integers(0, 4))
def test_where_stamps_fall_on_the_grid_a_delay_is_felt_as_between_them(count):
    """The derivative there is the mean of those on both sides, whatever rounding says."""
    time = 0.01 * np.arange(200)
    inputs = np.sin(7 * time)
    edges = time - 0.01 * count
    found = hold.parabolas(time, inputs, edges, ZERO)[1]
    expected = _slope(time, inputs, edges, ZERO, 1e-8)
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-4)
