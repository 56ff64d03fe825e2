import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from butterfly.signals.frequency_response import fit_basis, fit_halves, sine_basis
from tests.signals.sines import fit_sine


def _stamps(rng, count=4000, step=1e-2):
    return np.cumsum(step * rng.uniform(0.5, 1.5, count))


@settings(max_examples=30)
@given(st.floats(0.7, 20), st.floats(0.01, 10), st.floats(-3.1, 3.1), st.floats(-5, 5))
def test_a_noise_free_sine_with_harmonics_is_recovered_from_irregular_samples(
    omega, amplitude, phase, offset
):
    time = _stamps(np.random.default_rng(0))
    wave = np.cos(omega * time + phase) + 0.1 * np.sin(3 * omega * time)
    values = offset + amplitude * wave
    fit = fit_sine(time, values, omega)
    assert fit.amplitude == pytest.approx(amplitude, rel=1e-9)
    assert np.exp(1j * fit.phase) == pytest.approx(np.exp(1j * phase), abs=1e-9)
    assert fit.offset == pytest.approx(offset, abs=1e-9 * (1 + amplitude))
    assert fit.distortion == pytest.approx(0.1, rel=1e-7)
    assert fit.residual_rms < 1e-9 * (1 + amplitude + abs(offset))


def test_standard_errors_are_those_of_repeated_experiments_and_of_the_cramer_rao_bound():
    rng = np.random.default_rng(3)
    omega, noise, count = 3.0, 0.05, 2000
    time = np.arange(count) * 0.01
    fits = []
    for _ in range(300):
        values = 0.4 * np.cos(omega * time + 0.7) + noise * rng.standard_normal(count)
        fits.append(fit_sine(time, values, omega))
    bound = noise * np.sqrt(2 / count)
    assert np.std([f.amplitude for f in fits]) == pytest.approx(bound, rel=0.12)
    assert np.sqrt(np.mean([f.amplitude_error**2 for f in fits])) == pytest.approx(bound, rel=0.12)
    assert np.std([f.phase for f in fits]) == pytest.approx(bound / 0.4, rel=0.12)
    claimed = np.sqrt(np.mean([f.phase_error**2 for f in fits]))
    assert claimed == pytest.approx(bound / 0.4, rel=0.12)


def test_standard_errors_hold_for_noise_that_is_correlated_over_a_second():
    rng = np.random.default_rng(4)
    omega, time = 3.0, np.arange(6000) * 0.01
    fits = []
    for _ in range(200):
        white = rng.standard_normal(time.size + 100)
        coloured = 0.05 * np.convolve(white, np.ones(101) / np.sqrt(101), mode="valid")
        fits.append(fit_sine(time, 0.4 * np.cos(omega * time) + coloured, omega))
    claimed = np.sqrt(np.mean([f.amplitude_error**2 for f in fits]))
    assert np.std([f.amplitude for f in fits]) == pytest.approx(claimed, rel=0.25)


def test_a_fit_is_the_least_squares_solution_with_and_without_a_transient():
    rng = np.random.default_rng(5)
    time, omega, pole = _stamps(rng), 3.0, -0.2 + 2j
    values = rng.standard_normal(time.size)
    angles = omega * np.outer(time, [1, 2, 3])
    sines = np.column_stack([np.ones(time.size), np.cos(angles), np.sin(angles)])
    wave = np.exp(pole * (time - time[0]))
    for design, asked in ((sines, None), (np.column_stack([sines, wave.real, wave.imag]), pole)):
        expected = np.linalg.lstsq(design, values)[0]
        fit = fit_sine(time, values, omega, pole=asked)
        np.testing.assert_allclose(fit.phasors, expected[1:4] - 1j * expected[4:7], atol=1e-12)
        assert fit.offset == pytest.approx(expected[0], abs=1e-12)
    basis = sine_basis(time, omega)
    lone, first = fit_sine(time, values, omega, harmonics=1), fit_basis(basis[:3], values, omega, 1)
    np.testing.assert_allclose(first.phasors, lone.phasors, rtol=1e-12)
    np.testing.assert_allclose(first.covariance, lone.covariance, rtol=1e-12)


def test_a_signal_and_its_halves_are_fitted_as_each_is_alone():
    rng = np.random.default_rng(6)
    time, omega = _stamps(rng, count=4001), 3.0
    values = np.linspace(1, 2, time.size) * np.cos(omega * time) + rng.standard_normal(time.size)
    whole, first, second = fit_halves(sine_basis(time, omega), values, omega)
    alone = fit_sine(time, values, omega)
    np.testing.assert_allclose(whole.phasors, alone.phasors, rtol=1e-10)
    np.testing.assert_allclose(whole.covariance, alone.covariance, rtol=1e-10)
    for half, phasor in ((slice(2000), first), (slice(2000, None), second)):
        expected = fit_sine(time[half], values[half], omega).fundamental
        assert phasor == pytest.approx(expected, rel=1e-10)
