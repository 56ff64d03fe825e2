"""Fits with fewer terms, or to fewer logs, are those made anew."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from butterfly.identification.scatter import Submodels, without_logs
from tests.identification.simulated import cells

PARTS, EACH = 6, 5
COLUMNS = ("p1", "p3", "coulomb", "drag")
UNITS = np.array([1e-3, 1.0, 1e3, 1e-2])
FREE = np.full(4, -np.inf)


def _problem(*, lower=FREE, folds=None, seed=0):
    """A linear problem, and its equations about values that are not its solution."""
    rng = np.random.default_rng(seed)
    rows = rng.standard_normal((PARTS, EACH, 4)) / UNITS
    truth = UNITS * np.array([1.0, 2.0, 0.2, -0.5])
    target = rows @ truth + 0.3 * rng.standard_normal((PARTS, EACH))
    about = np.maximum(truth + UNITS * rng.standard_normal(4), lower)
    nested = Submodels(
        equations=cells(COLUMNS, rows, rows @ about - target, values=about, lower=lower),
        folds=np.arange(PARTS) if folds is None else folds,
    )
    return rows, target, nested


def _anew(rows, target, kept, lower=FREE):
    """Fit some columns to some logs by another solver; the other values are 0."""
    values = np.zeros(4)
    scaled = rows[..., kept] * UNITS[kept]
    found = lsq_linear(
        scaled.reshape(-1, kept.sum()), target.ravel(), (lower[kept] / UNITS[kept], np.inf)
    )
    values[kept] = found.x * UNITS[kept]
    return values


SUBSETS = np.array([[1, 1, 1, 1], [1, 1, 0, 0], [1, 0, 1, 1], [0, 1, 0, 1]], dtype=bool)
EVERYTHING = SUBSETS[:1]
BOUNDED = np.array([-np.inf, -np.inf, 0.0, 0.0])


@pytest.mark.parametrize(("lower", "atol"), [(FREE, 1e-9), (BOUNDED, 1e-7)])
def test_fits_with_fewer_terms_are_those_of_the_remaining_columns_within_their_bounds(lower, atol):
    rows, target, nested = _problem(lower=lower)
    found = nested.fitted(SUBSETS)
    assert (found[0, 3] == 0.0) == (lower is not FREE)  # which the data would have below 0
    for kept, values, costs in zip(SUBSETS, found, nested.costs(found), strict=True):
        expected = _anew(rows, target, kept, lower)
        np.testing.assert_allclose(values / UNITS, expected / UNITS, atol=atol)
        np.testing.assert_allclose(costs, np.sum((rows @ values - target) ** 2, axis=1), rtol=1e-9)


@pytest.mark.parametrize("folds", [np.arange(PARTS), np.array([0, 0, 1, 1, 2, 2])])
def test_errors_of_what_was_left_out_are_those_of_fits_to_the_rest(folds):
    rows, target, nested = _problem(folds=folds)
    expected = np.empty((len(SUBSETS), PARTS))
    for kept, errors in zip(SUBSETS, expected, strict=True):
        for part in np.unique(folds):
            mine = folds == part
            values = _anew(rows[~mine], target[~mine], kept)
            errors[mine] = np.sum((rows[mine] @ values - target[mine]) ** 2, axis=1)
    np.testing.assert_allclose(nested.held_out(SUBSETS), expected, rtol=1e-9)


def test_what_the_data_do_not_determine_has_no_fit():
    rows, target, _ = _problem()
    rows[..., 3] = rows[..., 2]
    equations = cells(COLUMNS, rows, -target)
    nested = Submodels(equations=equations, folds=np.arange(PARTS))
    sets = np.array([[True, True, True, True], [True, True, True, False]])
    for found in (nested.fitted(sets), nested.held_out(sets)):
        assert np.isnan(found[0]).any()
        assert np.isfinite(found[1]).all()


def test_where_the_rest_of_the_parts_does_not_determine_a_fit_single_cells_are_left_out():
    _, _, nested = _problem(folds=np.zeros(PARTS, dtype=int))
    alone = replace(nested, folds=np.arange(PARTS))
    np.testing.assert_array_equal(nested.held_out(EVERYTHING), alone.held_out(EVERYTHING))


def test_what_ran_away_is_no_lack_of_data():
    _, _, nested = _problem()
    equations = nested.equations
    rows, residuals = (each.copy() for each in equations.stack)
    rows[:, -1], residuals[:, -1] = 0.0, 1e200
    flat = {"rows": rows.reshape(-1, rows.shape[2]), "residuals": residuals.ravel()}
    away = replace(nested, equations=replace(equations, **flat))
    with np.errstate(over="ignore"):
        assert np.isposinf(away.held_out(EVERYTHING)).all()


def test_a_companion_that_is_absent_keeps_its_value_and_other_terms_are_nothing():
    _, _, nested = _problem()
    names = ("p1", "p3", "stribeck", "stribeck_velocity")
    nested = replace(nested, equations=replace(nested.equations, names=names))
    (found,) = nested.fitted(np.array([[True, True, False, False]]))
    assert found[2] == 0.0
    assert found[3] == nested.equations.values[3]


@pytest.mark.parametrize("lost", [[0], [1, 4]])
def test_the_estimate_without_some_logs_is_that_of_the_rest(lost):
    rows, target, nested = _problem()
    kept = [k for k in range(PARTS) if k not in lost]
    expected = _anew(rows[kept], target[kept], np.ones(4, dtype=bool))
    found = without_logs(nested.equations, lost)
    np.testing.assert_allclose(found / UNITS, expected / UNITS, atol=1e-9)


def test_what_only_the_lost_logs_move_keeps_its_value():
    """The gain, where all driven logs carry the mass that is left out."""
    rows, target, nested = _problem()
    rows[2:, :, 3] *= 1e-12
    values = nested.equations.values
    found = without_logs(cells(COLUMNS, rows, rows @ values - target, values=values), [0, 1])
    assert found[3] == values[3]
    kept = np.array([True, True, True, False])
    expected = _anew(rows[2:], target[2:] - rows[2:, :, 3] * values[3], kept)
    np.testing.assert_allclose(found[:3] / UNITS[:3], expected[:3] / UNITS[:3], atol=1e-9)


def test_a_parameter_on_its_bound_that_moves_nothing_stays_there():
    """Coulomb friction of a joint without any: its derivative is 0 where it is 0."""
    rows, target, _ = _problem(lower=BOUNDED)
    rows[..., 2] = 0.0
    equations = cells(COLUMNS, rows, -target, lower=BOUNDED)
    (found,) = Submodels(equations=equations, folds=np.arange(PARTS)).fitted(EVERYTHING)
    assert found[2] == 0.0
    expected = _anew(rows, target, np.array([True, True, False, True]), BOUNDED)
    np.testing.assert_allclose(found / UNITS, expected / UNITS, atol=1e-7)
