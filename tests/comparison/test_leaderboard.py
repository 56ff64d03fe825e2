"""Estimators are ranked by what they predict unseen."""

from dataclasses import replace

import numpy as np
import pytest

from butterfly.api.compared import Leaderboard
from butterfly.comparison.leaderboard import leaderboard
from butterfly.identification.data import DataSet
from butterfly.identification.estimators import HarmonicBalance, Linear, WeakForm
from butterfly.identification.validate import Split, cross_validate
from tests.identification.simulated import ROBOT, SWINGS, steady


@pytest.fixture(scope="module")
def data():
    logs = steady(replace(ROBOT, drag=8e-4), dict(list(SWINGS.items())[::2]), duration=12.0)
    return DataSet.of([log.take(np.arange(0, log.time.size, 2)) for log in logs], name="bench")


@pytest.fixture(scope="module")
def entries(data):
    alone = replace(data.take(range(3)), name="alone")
    estimators = (Linear(), HarmonicBalance(terms=("drag",)), WeakForm(terms=("drag",)))
    return leaderboard([data, alone], estimators)


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


def test_data_sets_of_one_name_are_ranked_each_for_itself(data):
    ranked = leaderboard([data, data.take(range(3)), data], [Linear(), WeakForm(terms=())])
    assert [*Leaderboard.of(ranked).content["winners"]] == ["bench", "bench (2)", "bench (3)"]


def test_the_page_names_the_best_and_what_went_wrong(entries):
    page = Leaderboard.of(entries).page()
    best = entries[0]
    assert best.method in page.summary[0]
    assert f"{best.held_out.median:.1f} %" in page.summary[0]
    assert "no method could" in page.summary[1]
    assert len(page.numbers["entries"]) == len(entries)


@pytest.mark.parametrize(("behind", "named"), [(0.0, 2), (0.05, 2), (1.0, 1)])
def test_no_winner_is_named_within_noise(entries, behind, named):
    best = entries[0]
    scatter = np.random.default_rng(0).normal(0, 0.3, best.fits.size)
    summary = replace(best.held_out, median=best.held_out.median - behind)
    other = replace(best, method="other", fits=best.fits - behind + scatter, held_out=summary)
    page = Leaderboard.of([best, other]).page()
    clear = named == 1
    assert ("no clear winner" in page.summary[0]) == (not clear)
    assert ("other" in page.summary[0]) == (not clear)
    fact = page.facts[0]
    assert fact.label == ("predicts best" if clear else "predict best, no clear winner")
    assert fact.value == ", ".join([best.method, "other"][:named])
