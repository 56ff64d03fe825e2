"""The descent against certified figures and SciPy's, and which of several ends is kept."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares

from butterfly.errors import IdentifiabilityError
from butterfly.identification.fit import Box, minimise
from butterfly.identification.loss import Loss, outlying
from butterfly.progress import budget
from tests.identification.simulated import equations_about

RAT_42 = np.array(
    [
        *(9, 8.93, 14, 10.8, 21, 18.59, 28, 22.33, 42, 39.35, 57, 56.11, 63, 61.73, 70, 64.62),
        *(79, 67.08),
    ]
).reshape(-1, 2)


def _ratkowsky(b, x):
    e = np.exp(b[1] - b[2] * x)
    slope = b[0] * e / (1 + e) ** 2
    return b[0] / (1 + e), np.column_stack([1 / (1 + e), -slope, slope * x])


START = (100, 1, 0.1)
CERTIFIED, SQUARES = (7.2462237576e1, 2.6180768402, 6.7359200066e-2), 8.0565229338
"""NIST Statistical Reference Datasets, nonlinear regression, Rat42: first start and values."""


def _minimised(expand, start, lower=None):
    start = np.array(start, dtype=float)
    lower = np.full(start.size, -np.inf) if lower is None else lower
    return minimise(expand, expand(np.maximum(start, lower), np.inf), Box(lower))


def _rat_42(values, _):
    fitted, slopes = _ratkowsky(values, RAT_42[:, 0])
    return equations_about(values, fitted - RAT_42[:, 1], slopes)


@pytest.mark.parametrize("unit", [(1, 1, 1), (1e-6, 1e3, 1e9)])
def test_a_certified_fit_is_found_from_its_far_start_in_any_units(unit):
    def expand(values, _):
        at = _rat_42(values * unit, _)
        return equations_about(values, at.residuals, at.rows * unit)

    found = _minimised(expand, np.divide(START, unit))
    assert found.converged
    np.testing.assert_allclose(found.values * unit, CERTIFIED, rtol=1e-5)
    assert 2 * found.cost == pytest.approx(SQUARES, rel=1e-6)


def _line(seed, outliers):
    """Residuals of points about a line, some of them far off, and their slopes."""
    rng = np.random.default_rng(seed)
    x = np.linspace(-1, 1, 200)
    y = 0.7 - 1.3 * x + 0.01 * rng.standard_normal(x.size)
    y[:outliers] += rng.uniform(0.5, 2.0)
    return lambda b: b[0] + b[1] * x - y, np.column_stack([np.ones_like(x), x])


@pytest.mark.parametrize("loss", list(Loss)[1:])
@settings(max_examples=15)
@given(seed=st.integers(0, 10**6), outliers=st.integers(0, 40))
def test_robust_fits_end_where_scipy_s_do(loss, seed, outliers):
    residuals, slopes = _line(seed, outliers)
    first = _minimised(lambda b, _: equations_about(b, residuals(b), slopes), np.zeros(2))
    scale = outlying(residuals(first.values))

    def robust(b, _=np.inf):
        return replace(equations_about(b, residuals(b), slopes), loss=loss, scale=scale)

    found = _minimised(robust, first.values)
    options = {"loss": loss.value, "f_scale": scale, "xtol": 1e-12, "ftol": 1e-12}
    expected = least_squares(residuals, first.values, lambda _: slopes, **options)
    assert found.cost == pytest.approx(expected.cost, rel=1e-3)
    at = robust(expected.x)
    assert at.cost == pytest.approx(expected.cost, rel=1e-9)
    np.testing.assert_allclose(at.gradient, expected.grad, rtol=1e-6, atol=1e-9)


@settings(max_examples=20)
@given(seed=st.integers(0, 10**6), floor=st.floats(-2.0, 2.0))
def test_bounds_hold_as_scipy_s_do(seed, floor):
    (residuals, slopes), lower = _line(seed, 0), np.array([-np.inf, floor])
    start = np.array([0.0, floor + 0.5])
    found = _minimised(lambda b, _: equations_about(b, residuals(b), slopes), start, lower)
    exactly = {"xtol": 1e-14, "ftol": 1e-14, "gtol": 1e-14}
    expected = least_squares(residuals, start, lambda _: slopes, (lower, np.inf), **exactly)
    assert np.all(found.values >= lower)
    np.testing.assert_allclose(found.values, expected.x, atol=1e-5)


def test_a_step_holds_what_a_box_has_no_width_for_and_the_rest_is_best_beside_it():
    slopes = np.random.default_rng(0).standard_normal((9, 3))
    at = equations_about(np.zeros(3), slopes @ [1.0, 2.0, 3.0], slopes)
    step = at.step(np.array([-9.0, -1.0, -9.0]), np.array([9.0, -1.0, 9.0]))
    beside = np.linalg.lstsq(slopes[:, [0, 2]], -slopes @ [1.0, 1.0, 3.0], rcond=None)[0]
    np.testing.assert_allclose(step, [beside[0], -1.0, beside[1]], rtol=1e-9)


def test_a_valley_that_bends_is_followed_to_its_end_or_said_not_to_be():
    """Rosenbrock's, on a floor that makes each step promise little of the cost."""

    def expand(b, _):
        residuals = [10 * (b[1] - b[0] ** 2), 1 - b[0], 30.0]
        return equations_about(b, residuals, [[-20 * b[0], 10.0], [-1.0, 0.0], [0.0, 0.0]])

    found = _minimised(expand, [-1.2, 1.0])
    assert found.converged
    np.testing.assert_allclose(found.values, [1, 1], atol=1e-3)


def test_a_wall_of_numbers_that_are_none_is_stepped_back_from():
    """sqrt(x) - 0.1 from 4: the first step goes below 0."""

    def expand(point, _):
        with np.errstate(invalid="ignore", divide="ignore"):
            return equations_about(point, np.sqrt(point) - 0.1, [0.5 / np.sqrt(point)])

    found = _minimised(expand, [4.0])
    assert found.values[0] == pytest.approx(0.01, rel=1e-3)


def test_derivatives_that_lead_nowhere_make_no_minimum_and_no_number_is_a_beginning():
    found = _minimised(lambda b, _: equations_about(b, b - 3.0, -np.eye(2)), np.ones(2))
    assert not found.converged
    with pytest.raises(IdentifiabilityError, match="diverges"):
        _minimised(lambda b, _: equations_about(b, [np.nan], [[1.0]]), np.ones(1))


@pytest.mark.parametrize("seconds", [1e9, 0.0])
def test_a_descent_ends_where_it_is_when_its_time_is_over(seconds):
    with budget(seconds) as search:
        found = _minimised(_rat_42, START)
    assert found.converged is (seconds > 0)
    assert np.allclose(found.values, CERTIFIED, rtol=1e-5) is (seconds > 0)
    assert (found.evaluations, search.simulations) == (0, 0) or seconds


def test_the_best_step_of_some_unknowns_leaves_what_a_regression_does_even_if_two_act_alike():
    rows = np.random.default_rng(0).standard_normal((50, 3)) * (1, 1e3, 1e-3)
    rows[:, 1], errors = 1e3 * rows[:, 0], np.sin(np.arange(50))
    at = equations_about(np.ones(3), errors, rows)
    directions = at.directions(2)
    np.testing.assert_allclose(np.linalg.norm(rows @ directions, axis=0), [1.0])
    left = at.moved(-directions @ (directions.T @ at.gradient)).residuals
    slope = rows[:, 0] @ errors / (rows[:, 0] @ rows[:, 0])
    np.testing.assert_allclose(left, errors - slope * rows[:, 0])
    cells = at.along(directions, ("step",)).cells(5)
    assert cells.squares.sum() == pytest.approx(errors @ errors)
    np.testing.assert_allclose(directions @ cells.next_step, [-slope / 2, -slope / 2e3, 0.0])
