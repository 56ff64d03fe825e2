"""What a misfit may have made of values."""

import numpy as np
import pytest

from butterfly.identification.equations import compressed
from butterfly.identification.inference.infer import misfit_over_value, outweighed
from tests.identification.cells import cells

NAMES, TRUTH = ("p1", "p2"), np.array([2.0, -1.0])
LOGS, ROWS = 8, 200


def _regression(rng, drift):
    """Rows, and what a fit to them leaves: noise, and a drift of each log."""
    time = np.tile(np.arange(ROWS), LOGS)
    rows = np.column_stack([np.sin(0.9 * time) + time / ROWS, rng.standard_normal(time.size)])
    errors = 0.1 * rng.standard_normal(time.size) + drift * time / ROWS
    target = rows @ TRUTH + errors
    values = np.linalg.lstsq(rows, target, rcond=None)[0]
    return rows, rows @ values - target, values


def _equations(rows, residuals, values):
    parts = zip(np.split(rows, LOGS), np.split(residuals, LOGS), strict=True)
    return cells(NAMES, *compressed(parts), values=values)


def test_a_misfit_is_weighed_beside_what_each_parameter_does_alone():
    rows, residuals, values = _regression(np.random.default_rng(0), 0.5)
    found = misfit_over_value(_equations(rows, residuals, values))
    for k in range(2):
        other = rows[:, 1 - k]
        alone = rows[:, k] - other * (other @ rows[:, k]) / (other @ other)
        expected = np.linalg.norm(residuals) / (abs(values[k]) * np.linalg.norm(alone))
        assert found[k] == pytest.approx(expected)


def test_the_scale_and_values_that_look_precise_are_widened_by_a_misfit():
    values, narrow = np.full(4, 2.0), np.array([0.5, 0.01, 0.01, 0.5])
    limits = (values - narrow, values + narrow)
    misfit = np.array([0.7, 0.4, 0.7, 0.7])
    lower, upper = outweighed(misfit, values, limits, ("p1", "p2", "p3", "coulomb"))
    np.testing.assert_allclose(lower, [0.6, 1.99, 0.6, 1.5])
    np.testing.assert_allclose(upper, [3.4, 2.01, 3.4, 2.5])
