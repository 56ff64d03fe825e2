"""Nested fits against fits that are made anew."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from butterfly.identify.judgement.nested import Nested

LOGS, ROWS = 6, 5
NAMES = ("p1", "p3", "coulomb", "drag")
UNITS = np.array([1e-3, 1.0, 1e3, 1e-2])
FREE = np.full(4, -np.inf)


def _problem(*, lower=FREE, folds=None, seed=0):
    """A linear problem, and its equations about values that are not its solution."""
    rng = np.random.default_rng(seed)
    rows = rng.standard_normal((LOGS, ROWS, 4)) / UNITS
    truth = UNITS * np.array([1.0, 2.0, 0.2, -0.5])
    target = rows @ truth + 0.3 * rng.standard_normal((LOGS, ROWS))
    about = np.maximum(truth + UNITS * rng.standard_normal(4), lower)
    nested = Nested.of(
        rows,
        rows @ about - target,
        names=NAMES,
        values=about,
        lower=lower,
        folds=np.arange(LOGS) if folds is None else folds,
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


SUBSETS = [np.array(each) for each in ([1, 1, 1, 1], [1, 1, 0, 0], [1, 0, 1, 1], [0, 1, 0, 1])]


@pytest.mark.parametrize("kept", [each.astype(bool) for each in SUBSETS])
def test_a_fit_with_fewer_terms_is_that_of_the_remaining_columns(kept):
    rows, target, nested = _problem()
    found = nested.fitted(kept)
    np.testing.assert_allclose(found / UNITS, _anew(rows, target, kept) / UNITS, atol=1e-9)
    left = np.sum((rows @ found - target) ** 2, axis=1)
    np.testing.assert_allclose(nested.costs(found), left, rtol=1e-9)


@pytest.mark.parametrize("kept", [each.astype(bool) for each in SUBSETS])
@pytest.mark.parametrize("folds", [np.arange(LOGS), np.array([0, 0, 1, 1, 2, 2])])
def test_errors_of_what_was_left_out_are_those_of_a_fit_to_the_rest(kept, folds):
    rows, target, nested = _problem(folds=folds)
    expected = np.empty(LOGS)
    for part in np.unique(folds):
        mine = folds == part
        values = _anew(rows[~mine], target[~mine], kept)
        expected[mine] = np.sum((rows[mine] @ values - target[mine]) ** 2, axis=1)
    np.testing.assert_allclose(nested.held_out(kept), expected, rtol=1e-9)


def test_a_bound_holds_what_the_data_would_have_beyond_it():
    lower = np.array([-np.inf, -np.inf, 0.0, 0.0])
    rows, target, nested = _problem(lower=lower)
    everything = np.ones(4, dtype=bool)
    found = nested.fitted(everything)
    assert found[3] == 0.0
    np.testing.assert_allclose(
        found / UNITS, _anew(rows, target, everything, lower) / UNITS, atol=1e-7
    )


def test_what_the_data_do_not_determine_has_no_fit():
    rows, target, _ = _problem()
    rows[..., 3] = rows[..., 2]
    nested = Nested.of(
        rows, -target, names=NAMES, values=np.zeros(4), lower=FREE, folds=np.arange(LOGS)
    )
    everything = np.ones(4, dtype=bool)
    assert nested.fitted(everything) is None
    assert nested.held_out(everything) is None
    assert nested.fitted(np.array([True, True, True, False])) is not None


def test_one_part_foretells_nothing():
    _, _, nested = _problem(folds=np.zeros(LOGS, dtype=int))
    assert nested.held_out(np.ones(4, dtype=bool)) is None


def test_a_companion_that_is_absent_keeps_its_value_and_other_terms_are_nothing():
    _, _, nested = _problem()
    nested = replace(nested, names=("p1", "p3", "stribeck", "stribeck_velocity"))
    found = nested.fitted(np.array([True, True, False, False]))
    assert found[2] == 0.0
    assert found[3] == nested.values[3]
