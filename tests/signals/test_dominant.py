"""The frequency at which a signal moves most."""

import numpy as np
import pytest

from butterfly.signals.spectrum import dominant_frequency


@pytest.mark.parametrize("omega", [0.7, 5.0, 40.0])
def test_the_frequency_of_a_noisy_sine_is_found_on_any_clock(omega):
    rng = np.random.default_rng(3)
    time = np.cumsum(rng.uniform(1e-3, 3e-3, 15_000))
    values = 0.4 + np.sin(omega * time + 0.3) + 0.2 * rng.standard_normal(time.size)
    found, share = dominant_frequency(time, values)
    assert found == pytest.approx(omega, rel=1e-3)
    assert 0.9 < share < 1.0


def test_a_long_log_is_thinned_and_a_constant_has_no_frequency():
    time = np.arange(0, 100, 1e-3)
    assert dominant_frequency(time, np.sin(3 * time))[0] == pytest.approx(3.0, rel=1e-5)
    assert dominant_frequency(time, np.ones_like(time)) == (0.0, 0.0)
