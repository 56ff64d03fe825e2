from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from butterfly.logs.log import Intersample
from butterfly.signals import hold

ZERO, FIRST = Intersample.ZERO_ORDER_HOLD, Intersample.FIRST_ORDER_HOLD


def _samples(seed, count=40):
    rng = np.random.default_rng(seed)
    return np.cumsum(rng.uniform(0.5, 1.5, count)), rng.standard_normal(count)


@pytest.mark.parametrize("kind", list(Intersample))
@given(seed=st.integers(0, 1000), step=st.floats(0.1, 7.0))
def test_the_moments_are_the_integrals_of_the_value(kind, seed, step):
    time, inputs = _samples(seed)
    edges = np.arange(time[0] - 2, time[-1] + 3, step)
    found = hold.moments(time, inputs, edges, kind)
    for cell in (0, found.shape[1] // 2, found.shape[1] - 1):
        begin, end = edges[cell], edges[cell + 1]
        inner = time[(time > begin) & (time < end)]
        for order, weigh in enumerate(
            (lambda _: 1, lambda x: 3 * x, lambda x: 2.5 * (3 * x**2 - 1))
        ):

            def integrand(t, weigh=weigh, begin=begin, end=end):
                x = (2 * t - begin - end) / (end - begin)
                return float(hold.value(time, inputs, np.array([t]), kind)[0]) * weigh(x)

            points = np.concatenate([[begin], inner, [end]])
            pieces = [quad(integrand, a, b, epsabs=1e-10)[0] for a, b in pairwise(points.tolist())]
            assert found[order, cell] == pytest.approx(sum(pieces) / (end - begin), abs=1e-7)


def test_no_impulse_is_lost_wherever_the_edges_fall():
    time, inputs = _samples(3)
    for kind in Intersample:
        coarse, fine = (np.linspace(time[0] - 1, time[-1], n) for n in (7, 301))
        totals = [hold.mean(time, inputs, e, kind) @ np.diff(e) for e in (coarse, fine)]
        assert totals[0] == pytest.approx(totals[1], rel=1e-12)


def test_before_the_first_stamp_a_command_is_0_and_a_signal_what_it_is_there():
    time, inputs = np.array([1.0, 2.0, 3.0]), np.array([5.0, 7.0, 4.0])
    early, late = np.array([0.0, 0.9]), np.array([3.0, 9.0])
    np.testing.assert_array_equal(hold.value(time, inputs, early, ZERO), [0, 0])
    np.testing.assert_array_equal(hold.value(time, inputs, early, FIRST), [5, 5])
    for kind in Intersample:
        np.testing.assert_array_equal(hold.value(time, inputs, late, kind), [4, 4])


@pytest.mark.parametrize("kind", list(Intersample))
def test_the_gain_is_that_of_the_held_sine_s_fundamental(kind):
    omega, step = 9.0, 2 * np.pi / 9.0 / 20  # 20 samples a period
    time = step * np.arange(401)
    fine = time[0] + (np.arange(40_000) + 0.5) * (time[-1] - time[0]) / 40_000
    held = hold.value(time, np.sin(omega * time), fine, kind)
    phasor = 2 * np.mean(held * np.exp(-1j * omega * fine)) * 1j
    assert hold.gain(omega, step, kind) == pytest.approx(complex(phasor), abs=3e-4)
