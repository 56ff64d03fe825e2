"""Averages over bumps: those of derivatives, wherever a bump lies, whatever the turn."""

import numpy as np
import pytest

from butterfly.identification.test_functions import Bumps

HALF, STEP = 0.25, 1e-3


def _bump(s):
    return (1 - s**2) ** 4


def test_against_a_derivative_of_the_bump_averages_are_those_of_the_signal_s_derivative():
    time = STEP * np.arange(2000)
    bumps = Bumps(half_width=HALF, step=STEP, size=time.size, margin=250)
    rate = bumps.means(3 * np.cos(3 * time))
    np.testing.assert_allclose(-bumps.means(np.sin(3 * time), 1), rate, rtol=0, atol=1e-9)
    bend = bumps.means(-9 * np.sin(3 * time))
    np.testing.assert_allclose(bumps.means(np.sin(3 * time), 2), bend, rtol=0, atol=1e-7)


@pytest.mark.parametrize("half_width", [0.25, 0.2503, 0.0047, 0.001, 0.0004])
@pytest.mark.parametrize("order", [0, 1, 2])
def test_every_bump_sums_its_own_samples_wherever_it_lies(half_width, order):
    signal = np.random.default_rng(order).standard_normal(1000)
    margin = int(np.ceil(half_width / STEP)) + 3
    bumps = Bumps(half_width=half_width, step=STEP, size=signal.size, margin=margin)
    s = np.polynomial.Polynomial([0, 1])
    shape = ((1 - s**2) ** 4).deriv(order) if order else (1 - s**2) ** 4
    places = np.arange(-400, 401) * STEP / half_width
    places = places[np.abs(places) < 1 - 1e-9]
    weights = shape(places) / half_width**order / _bump(places).sum()
    if order == 2:  # of a constant angle there is none
        weights -= _bump(places) * weights.sum() / _bump(places).sum()
    reach = places.size // 2
    expected = [weights @ signal[k - reach : k + reach + 1] for k in bumps.centres]
    found = bumps.means(signal, order)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11 * np.abs(weights).sum())
    assert bumps.centres[0] == margin
    assert signal.size - margin - bumps.centres[-1] <= max(1, round(0.5 * half_width / STEP))


@pytest.mark.parametrize("half_width", [0.1, 0.25])
def test_many_turns_of_angle_are_no_acceleration_to_the_test_functions(half_width):
    step, size = 4e-3, 400
    bumps = Bumps(half_width=half_width, step=step, size=size, margin=80)
    angle = 500 - 30 * step * np.arange(size)
    assert np.abs(bumps.means(angle, 2)).max() < 1e-8
    np.testing.assert_allclose(bumps.means(angle**2, 2), 2 * 30**2, rtol=1e-3)
