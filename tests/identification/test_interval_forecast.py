"""Intervals that are forecast are those of the inference after such logs really were added."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import stdtrit

from butterfly.identification.forecast import IntervalForecast
from butterfly.identification.limits import cluster_covariance
from butterfly.model.prior import Prior
from tests.identification.simulated import estimate_of

NAMES = ("p1", "p4")


def _log(rng, mass, size=40):
    """Derivatives of a log by inertia and gain: without a mass their ratio is all that shows."""
    motion = rng.standard_normal(size)
    return np.column_stack([motion * (1 + mass), -motion]) + 1e-3 * rng.standard_normal((size, 2))


def _fitted(rng, logs):
    """Values, covariance and freedom of a fit to logs whose errors are white noise."""
    flat, noise = np.concatenate(logs), rng.standard_normal(sum(map(len, logs)))
    values = np.linalg.lstsq(flat, noise, rcond=None)[0]
    residuals = (noise - flat @ values).reshape(len(logs), -1)
    return values, *cluster_covariance(np.array(logs), residuals)


def _estimate(rng, logs):
    _, covariance, freedom = _fitted(rng, logs)
    half = stdtrit(freedom, 0.975) * np.sqrt(np.diag(covariance))
    ones = np.ones(len(NAMES))
    found = estimate_of(ones, covariance, names=NAMES)
    return replace(found, lower=ones - half, upper=ones + half, freedom=freedom)


@pytest.mark.parametrize("bare", [4, 14])
def test_half_widths_forecast_are_those_of_logs_that_are_added_then(bare):
    """On average over noise: within a quarter, as 200 draws of a width of t with 2 degrees give."""
    rng = np.random.default_rng(bare)
    logs = [_log(rng, 0.0) for _ in range(bare)] + [_log(rng, 1.0) for _ in range(2)]
    more, runs = _log(rng, 1.0), 3
    # the estimate as it is on average, so that noise is in what comes only
    covariance = np.linalg.inv(sum(x.T @ x for x in logs))
    freedom = _fitted(rng, logs)[2]
    half, ones = stdtrit(freedom, 0.975) * np.sqrt(np.diag(covariance)), np.ones(2)
    found = estimate_of(ones, covariance, names=NAMES)
    found = replace(found, lower=ones - half, upper=ones + half, freedom=freedom)
    so_far = IntervalForecast(found, logs)
    forecast = so_far.half_widths(so_far.log(more), runs)
    every = [*logs, *[more] * runs]
    came = [_fitted(rng, every)[1:] for _ in range(200)]
    squares = [stdtrit(f, 0.975) ** 2 * np.diag(c) for c, f in came]
    np.testing.assert_allclose(forecast, np.sqrt(np.mean(squares, axis=0)), rtol=0.25)


def test_where_a_value_rests_on_one_log_of_fifteen_two_more_of_that_kind_help_most():
    """Three logs have two degrees of freedom, t of which is a third of that of one degree."""
    rng = np.random.default_rng(1)
    logs = [_log(rng, 0.0) for _ in range(14)] + [_log(rng, 1.0)]
    forecast = IntervalForecast(_estimate(rng, logs), logs)
    heavy, bare = (forecast.log(_log(rng, mass)) for mass in (1.0, 0.0))
    now = forecast.half_widths(bare, 0)
    same, others = forecast.half_widths(heavy, 2), forecast.half_widths(bare, 13)
    assert (same < 0.5 * now).all()
    assert (others > 0.8 * now).all()


def test_without_more_logs_intervals_are_those_that_are_shown():
    rng = np.random.default_rng(2)
    logs = [_log(rng, mass) for mass in (0.0, 0.0, 1.0, 0.0, 1.0)]
    found = _estimate(rng, logs)
    forecast = IntervalForecast(found, logs)
    np.testing.assert_allclose(forecast.half_widths(forecast.log(logs[0]), 0), found.farther)


def test_a_known_value_keeps_its_uncertainty_however_many_logs_say_nothing_of_it():
    """The gain is known to 1 %, and logs show its ratio to the inertia only."""
    rng = np.random.default_rng(3)
    motions = [rng.standard_normal((40, 1)) for _ in range(5)]
    logs = [np.hstack([each, -each]) for each in motions]
    error = 0.01
    known = Prior.of({"p4": {"value": 1.0, "uncertainty": error}})
    covariance = error**2 * np.ones((2, 2)) + np.diag([1e-12, 0.0])
    found = estimate_of(np.ones(2), covariance, known, names=NAMES)
    forecast = IntervalForecast(found, logs)
    after = forecast.half_widths(forecast.log(logs[0]), 50)
    np.testing.assert_allclose(after, found.farther, rtol=1e-3)
