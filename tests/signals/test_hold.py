"""What an input does between its stamps, against integrals by quadrature."""

from __future__ import annotations

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
def test_before_between_and_after_its_stamps_an_input_is_what_its_hold_says(kind):
    instants = np.array([1.5, 0.1, 0.35, 0.75, 1.0, 0.3])
    found = hold.value(TIME, INPUTS, instants, kind)
    np.testing.assert_allclose(found, [_held(t, kind) for t in instants])


@pytest.mark.parametrize("kind", [ZERO, FIRST])
def test_the_moments_over_intervals_are_the_legendre_integrals(kind):
    edges = np.array([0.1, 0.25, 0.5, 0.77, 0.78, 1.25, 1.6])
    found = hold.moments(TIME, INPUTS, edges, kind)
    for cell, (begin, end) in enumerate(pairwise(edges)):
        middle, half = (begin + end) / 2, (end - begin) / 2
        polynomials = (np.ones_like, lambda x: 3 * x, lambda x: 5 * (3 * x**2 - 1) / 2)
        inside = [t for t in TIME if begin < t < end]
        for order, weight in enumerate(polynomials):

            def integrand(t, weight=weight, middle=middle, half=half):
                return _held(t, kind) * weight((t - middle) / half) / (2 * half)

            expected, _ = quad(integrand, begin, end, points=inside or None)
            assert found[order, cell] == pytest.approx(expected, abs=1e-8)
    np.testing.assert_array_equal(hold.mean(TIME, INPUTS, edges, kind), found[0])


@pytest.mark.parametrize("kind", [ZERO, FIRST])
def test_the_gain_of_a_hold_is_the_fourier_coefficient_of_the_held_sine(kind):
    """Over a whole number of samples and periods, so that no window leaks."""
    count, step = 8, 0.2
    omega = 2 * np.pi * 3 / (count * step)
    time = step * np.arange(count + 1)
    samples = np.exp(1j * omega * time)
    total = 0j
    for k in range(count):

        def integrand(t, k=k):
            share = (t - time[k]) / step if kind is FIRST else 0.0
            held = samples[k] + share * (samples[k + 1] - samples[k])
            return held * np.exp(-1j * omega * t)

        total += quad(integrand, time[k], time[k + 1], complex_func=True)[0]
    assert hold.gain(omega, step, kind) == pytest.approx(total / time[-1], rel=1e-9)


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
