"""The pole of a transient, from what a fit of the steady response leaves over."""

from __future__ import annotations

import numpy as np
import pytest

from butterfly.signals.frequency_response import pole_of
from butterfly.signals.sine_fit import fit_sine, sine_basis


def _decay(time, pole, phase=0.7):
    return np.real(0.1 * np.exp(pole * time + 1j * phase))


@pytest.mark.parametrize("pole", [-0.05 + 4.3j, -0.3 + 6.1j, -1.0 + 9.0j])
def test_the_pole_of_a_decay_is_found(pole):
    time = 3.0 + np.arange(0, 30, 2e-3)
    assert pole_of(time, _decay(time, pole)) == pytest.approx(pole, rel=1e-3)


def test_noise_and_jittered_stamps_move_it_little():
    rng = np.random.default_rng(0)
    time = np.sort(np.arange(0, 30, 2e-3) + 4e-4 * rng.standard_normal(15_000))
    pole = -0.1 + 5.2j
    noisy = _decay(time, pole) + 5e-3 * rng.standard_normal(time.size)
    assert pole_of(time, noisy) == pytest.approx(pole, abs=5e-3)


def test_what_grows_is_called_no_decay():
    time = np.arange(0, 30, 2e-3)
    assert pole_of(time, _decay(time, 0.1 + 5.2j)).real <= 0


def test_a_sine_beside_a_ringing_transient_is_read_right_with_its_pole():
    time = np.arange(0, 30, 2e-3)
    omega, phasor = 3.0, 0.2 * np.exp(-0.4j)
    angle = np.real(phasor * np.exp(1j * omega * time)) + _decay(time, -0.05 + 3.6j)
    plain = fit_sine(time, angle, omega)
    pole = pole_of(time, angle - plain.on(sine_basis(time, omega)))
    calmer = fit_sine(time, angle, omega, pole=pole)
    errors = [abs(fit.fundamental - phasor) / abs(phasor) for fit in (plain, calmer)]
    assert errors[0] > 0.02
    assert errors[1] < 0.05 * errors[0]
