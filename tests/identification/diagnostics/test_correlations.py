"""Correlations against closed forms, and bands that hold as often as they say."""

from __future__ import annotations

import numpy as np
import pytest

from butterfly.identification.diagnostics.residuals import Curve, autocorrelation, cross_correlation

COUNT, LAGS = 3000, 150


def _autoregressive(pole, shape, rng):
    errors = rng.standard_normal(shape)
    for k in range(1, shape[0]):
        errors[k] += pole * errors[k - 1]
    return errors


def test_an_autoregressive_process_has_the_powers_of_its_pole():
    """rho(k) = a^k, within 4 of Bartlett's standard deviations."""
    pole = 0.9
    found = autocorrelation(_autoregressive(pole, (40_000, 1), np.random.default_rng(0)), 30)[:, 0]
    expected = pole ** np.arange(1, 31)
    spread = np.sqrt((1 + pole**2) / (1 - pole**2) / 40_000)
    np.testing.assert_allclose(found, expected, atol=4 * spread)


def test_correlations_are_their_sums():
    rng = np.random.default_rng(1)
    errors, inputs = rng.standard_normal((200, 3)), rng.standard_normal(200) + 5
    own, crossed = autocorrelation(errors, 9), cross_correlation(errors, inputs, 9)
    moving = inputs - inputs.mean()
    for series in range(3):
        e = errors[:, series]
        for lag in range(1, 10):
            assert own[lag - 1, series] == pytest.approx(e[lag:] @ e[:-lag] / (e @ e))
        for lag in range(10):
            size = np.sqrt((e @ e) * (moving @ moving))
            assert crossed[lag, series] == pytest.approx(e[lag:] @ moving[: 200 - lag] / size)


def test_what_the_input_caused_shows_at_its_delay():
    rng = np.random.default_rng(2)
    inputs = rng.standard_normal(COUNT)
    errors = np.roll(inputs, 7) + 0.5 * rng.standard_normal(COUNT)
    found = cross_correlation(errors[:, None], inputs, 20)[:, 0]
    assert np.argmax(found) == 7
    assert found[7] == pytest.approx(1 / np.sqrt(1.25), abs=0.02)


@pytest.mark.parametrize("pole", [0.0, 0.7])
def test_of_good_logs_one_curve_in_forty_leaves_the_inner_band(pole):
    """5 % of logs, half of them by the autocorrelation; white errors and lasting ones."""
    rng = np.random.default_rng(3)
    lag = np.arange(1, LAGS + 1)
    tries, left = 200, np.zeros(2)
    for _ in range(tries):
        curves = autocorrelation(_autoregressive(pole, (COUNT, 25), rng), LAGS)
        left += Curve.of(lag, curves, COUNT, 0.0).excess > 1
    assert left[0] / tries < 0.06
    assert left[1] <= left[0]


def test_lasting_errors_leave_the_bands_of_white_ones():
    rng = np.random.default_rng(4)
    white, lasting = rng.standard_normal((COUNT, 24)), _autoregressive(0.2, (COUNT, 1), rng)
    curves = autocorrelation(np.column_stack([lasting, white]), LAGS)
    assert Curve.of(np.arange(1, LAGS + 1), curves, COUNT, 0.0).excess[1] > 1
