"""Estimators are ranked by what they predict unseen."""

import numpy as np
import pytest

from butterfly.comparison.answers import leaderboard
from butterfly.identification.estimators import HarmonicBalance
from butterfly.identification.validate import Split, cross_validate
from tests.comparison.bench import bench, ranked


@pytest.fixture(scope="module")
def data():
    return bench()


@pytest.fixture(scope="module")
def entries():
    return ranked()


def test_the_best_predictor_of_unseen_masses_comes_first(data, entries):
    own = [entry for entry in entries if entry.data == "bench"]
    medians = [entry.held_out.median for entry in own]
    assert medians == sorted(medians, reverse=True)
    assert own[-1].method == "linear"
    assert [entry.data for entry in entries] == ["bench"] * 3 + ["alone"] * 3
    for entry in own:
        assert entry.error == ""
        assert entry.seconds > 0
    told = next(entry for entry in own if entry.method == "harmonic-balance(drag)")
    fits = cross_validate(data, HarmonicBalance(terms=("drag",)), Split.MASS).fits
    assert told.held_out.median == pytest.approx(np.median(fits), rel=1e-9)
    assert told.in_sample.worst == pytest.approx(data.simulations.fits(told.estimate).min())


def test_an_estimator_that_cannot_says_why_and_comes_last(entries):
    for entry in entries[3:]:
        assert entry.estimate is None
        assert entry.held_out is None
        assert "common factor" in entry.error


def test_a_fit_whose_masses_cannot_be_left_out_keeps_its_estimate(data):
    rows = [k for k, log in enumerate(data.logs) if log.added_mass != data.masses[0]]
    (entry,) = leaderboard([data.take(rows)], [HarmonicBalance(terms=("drag",))], split=Split.MASS)
    assert entry.estimate is not None
    assert entry.in_sample.median > 95
    assert entry.held_out is None
    assert "common factor" in entry.error
