"""Held-out logs: what is predicted of them, and by which terms."""

from dataclasses import replace

import numpy as np
import pytest

import butterfly as bf
from butterfly.api.validation import validation_answer
from butterfly.identification.estimators import OutputError
from butterfly.identification.validate import Bootstrap, Split, cross_validate


@pytest.fixture(scope="module")
def held(data):
    """Logs, an estimator, what it predicts of held-out data, and its estimate from all logs."""
    some, estimator = data.take([0, 2, 3, 5]), OutputError(terms=())
    return some, estimator, cross_validate(some, estimator), estimator(some)


def test_a_log_without_a_fit_is_left_out_of_tiles_and_tables(held):
    some, estimator, predicted, estimate = held
    fits = np.where(np.arange(4) == np.argmin(predicted.fits), np.nan, predicted.fits)
    whole = validation_answer(some, estimator, predicted, estimate)
    lacking = validation_answer(some, estimator, replace(predicted, fits=fits), estimate)
    assert lacking.facts()[1].value != whole.facts()[1].value
    assert [row[-1] for row in lacking.tables()[1].rows] == ["4 of 4", "3 of 3"]
    assert lacking.page().figures


def test_a_narrow_interval_by_bootstrap_is_not_rounded_away(held):
    *before, estimate = held
    values, half = estimate.values, 1e-6 * abs(estimate.values)
    drawn = Bootstrap(values=values[np.newaxis], lower=values - half, upper=values + half)
    for row in validation_answer(*before, estimate, drawn).tables()[-1].rows:
        assert len({*row[1:4]}) == 3


def test_what_the_table_holds_is_what_is_predicted_of_held_out_masses(data):
    held = cross_validate(data, OutputError(terms=()), Split.MASS)
    left_out = bf.validate(data, terms=()).to_dataframe()["FIT held out in %"]
    np.testing.assert_allclose(left_out, held.fits)


def test_the_rows_of_a_choice_are_sets_of_terms(results):
    chosen = results["selection"]
    assert "in turn, what was left out is predicted with a mean FIT of 9" in chosen.notes[-1]
    (table,), first = chosen.tables(), chosen.rows()[0]
    shown = dict(zip(table.headers, table.rows[0], strict=True))
    assert (first["terms"], shown["terms"]) == ([], "none")
    assert float(shown["FIT in sample in %"]) == pytest.approx(first["in_sample"]["median"], 0.01)
