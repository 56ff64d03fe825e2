"""The descent against certified figures and SciPy's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import least_squares

from butterfly.errors import IdentifiabilityError
from butterfly.identification.estimators.gauss_newton import (
    Equations,
    LogEquations,
    Loss,
    minimise,
    outlying,
)

MISRA_1A = np.array(
    [
        *(77.6, 10.07, 114.9, 14.73, 141.1, 17.94, 190.8, 23.93, 239.9, 29.61, 289.0, 35.18),
        *(332.8, 40.02, 378.4, 44.82, 434.8, 50.76, 477.3, 55.05, 536.8, 61.01, 593.1, 66.40),
        *(689.1, 75.47, 760.0, 81.78),
    ]
).reshape(-1, 2)
RAT_42 = np.array(
    [
        *(9, 8.93, 14, 10.8, 21, 18.59, 28, 22.33, 42, 39.35, 57, 56.11, 63, 61.73, 70, 64.62),
        *(79, 67.08),
    ]
).reshape(-1, 2)


def _misra(b, x):
    decay = np.exp(-b[1] * x)
    return b[0] * (1 - decay), np.column_stack([1 - decay, b[0] * x * decay])


def _ratkowsky(b, x):
    e = np.exp(b[1] - b[2] * x)
    slope = b[0] * e / (1 + e) ** 2
    return b[0] / (1 + e), np.column_stack([1 / (1 + e), -slope, slope * x])


CERTIFIED = {  # NIST Statistical Reference Datasets, nonlinear regression: first start and values
    "Misra1a": (_misra, MISRA_1A, (500, 1e-4), (2.3894212918e2, 5.5015643181e-4), 1.2455138894e-1),
    "Rat42": (
        *(_ratkowsky, RAT_42, (100, 1, 0.1)),
        *((7.2462237576e1, 2.6180768402, 6.7359200066e-2), 8.0565229338),
    ),
}


def _expansion(model, data, scale, scaled):
    values, jacobian = model(scaled * scale, data[:, 0])
    residuals = values - data[:, 1]
    return Equations(
        logs=(LogEquations(residuals=residuals, rows=jacobian, mixture=np.diag(scale)),)
    )


@pytest.mark.parametrize("name", CERTIFIED)
def test_certified_fits_are_found_from_their_far_start(name):
    model, data, start, certified, squares = CERTIFIED[name]
    scale = np.array(start, dtype=float)
    lower = np.full(scale.size, -np.inf)
    found = minimise(
        lambda scaled: _expansion(model, data, scale, scaled), np.ones(scale.size), lower
    )
    assert found.converged
    np.testing.assert_allclose(found.point * scale, certified, rtol=1e-5)
    assert 2 * found.at.cost == pytest.approx(squares, rel=1e-6)


@dataclass(frozen=True)
class Line:
    """Points about a line, some of them far off."""

    x: np.ndarray
    y: np.ndarray

    def residuals(self, b):
        return b[0] + b[1] * self.x - self.y

    def jacobian(self, _):
        return np.column_stack([np.ones_like(self.x), self.x])

    def equations(self, b):
        log = LogEquations(residuals=self.residuals(b), rows=self.jacobian(b), mixture=np.eye(2))
        return Equations(logs=(log,))


def _line(seed, outliers):
    rng = np.random.default_rng(seed)
    x = np.linspace(-1, 1, 200)
    y = 0.7 - 1.3 * x + 0.01 * rng.standard_normal(x.size)
    y[:outliers] += rng.uniform(0.5, 2.0)
    return Line(x, y)


@pytest.mark.parametrize("loss", list(Loss)[1:])
@given(seed=st.integers(0, 10**6), outliers=st.integers(0, 40))
def test_robust_fits_end_where_scipy_s_do(loss, seed, outliers):
    line = _line(seed, outliers)
    free = np.full(2, -np.inf)
    first = minimise(line.equations, np.zeros(2), free)
    scale = outlying(line.residuals(first.point))

    def robust(b):
        return Equations(logs=line.equations(b).logs, loss=loss, scale=scale)

    found = minimise(robust, first.point, free, robust(first.point))
    options = {"loss": loss.value, "f_scale": scale, "xtol": 1e-12, "ftol": 1e-12}
    expected = least_squares(line.residuals, first.point, line.jacobian, **options)
    assert found.at.cost == pytest.approx(expected.cost, rel=1e-3)
    assert robust(expected.x).cost == pytest.approx(expected.cost, rel=1e-9)


@given(seed=st.integers(0, 10**6), floor=st.floats(-2.0, 2.0))
def test_bounds_hold_as_scipy_s_do(seed, floor):
    line, lower = _line(seed, 0), np.array([-np.inf, floor])
    found = minimise(line.equations, np.array([0.0, floor + 0.5]), lower)
    expected = least_squares(
        line.residuals,
        [0.0, floor + 0.5],
        line.jacobian,
        (lower, np.inf),
        xtol=1e-14,
        ftol=1e-14,
        gtol=1e-14,
    )
    assert np.all(found.point >= lower)
    np.testing.assert_allclose(found.point, expected.x, atol=1e-5)


def test_a_valley_that_bends_is_followed_to_its_end_or_said_not_to_be():
    """Rosenbrock's, on a floor that makes each step promise little of the cost."""

    def expand(b):
        residuals = np.array([10 * (b[1] - b[0] ** 2), 1 - b[0], 30.0])
        slopes = np.array([[-20 * b[0], 10.0], [-1.0, 0.0], [0.0, 0.0]])
        return Equations(logs=(LogEquations(residuals=residuals, rows=slopes, mixture=np.eye(2)),))

    found = minimise(expand, np.array([-1.2, 1.0]), np.full(2, -np.inf))
    assert found.converged
    np.testing.assert_allclose(found.point, [1, 1], atol=1e-3)


def test_derivatives_that_lead_nowhere_are_not_called_a_minimum():
    def expand(b):
        log = LogEquations(residuals=b - 3.0, rows=-np.eye(2), mixture=np.eye(2))
        return Equations(logs=(log,))

    assert not minimise(expand, np.ones(2), np.full(2, -np.inf)).converged


def test_a_wall_of_numbers_that_are_none_is_stepped_back_from():
    """sqrt(x) - 0.1 from 4: the first step goes below 0."""

    def expand(point):
        x = float(point[0])
        with np.errstate(invalid="ignore", divide="ignore"):
            residuals, slope = np.array([np.sqrt(x) - 0.1]), np.array([[0.5 / np.sqrt(x)]])
        return Equations(logs=(LogEquations(residuals=residuals, rows=slope, mixture=np.eye(1)),))

    found = minimise(expand, np.array([4.0]), np.array([-np.inf]))
    assert found.point[0] == pytest.approx(0.01, rel=1e-3)


def test_a_beginning_that_is_no_number_is_refused():
    nothing = LogEquations(residuals=np.array([np.nan]), rows=np.eye(1), mixture=np.eye(1))
    with pytest.raises(IdentifiabilityError, match="diverges"):
        minimise(lambda _: Equations(logs=(nothing,)), np.ones(1), np.zeros(1))
