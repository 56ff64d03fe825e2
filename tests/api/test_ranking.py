"""Estimators beside each other: who is named the best, and who is not."""

from dataclasses import replace

import numpy as np
import pytest

from butterfly.api.validation import ranking_answer
from butterfly.comparison.answers import leaderboard
from butterfly.identification.estimators import Linear, WeakForm
from tests.cli.one_line import assert_one_block
from tests.comparison.bench import bench, ranked


@pytest.fixture(scope="module")
def data():
    return bench()


@pytest.fixture(scope="module")
def entries():
    return ranked()


def test_data_sets_of_one_name_are_ranked_each_for_itself(data):
    ranked = leaderboard([data, data.take(range(3)), data], [Linear(), WeakForm(terms=())])
    assert [*ranking_answer(ranked).content["winners"]] == ["bench", "bench (2)", "bench (3)"]


def test_the_page_names_the_best_and_what_went_wrong(entries):
    page = ranking_answer(entries).page()
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
    page = ranking_answer([best, other]).page()
    clear = named == 1
    assert ("no clear winner" in page.summary[0]) == (not clear)
    assert ("other" in page.summary[0]) == (not clear)
    fact = page.facts[0]
    assert fact.label == ("predicts best" if clear else "predict best, no clear winner")
    assert fact.value == ", ".join([best.method, "other"][:named])


@pytest.mark.parametrize("sets", [1, 2])
def test_who_predicts_best_is_one_table_within_80_columns_and_the_fits_are_detail(entries, sets):
    some = [entry for entry in entries if sets > 1 or entry.data == "bench"]
    best, fits = ranking_answer(some).tables()
    assert_one_block(best)
    assert ("data" in best.headers) == (sets > 1)
    assert {"estimator", "verdict", "FIT held out, median in %"} < {*best.headers}
    for entry, row, of_fit in zip(some, best.rows, fits.rows, strict=True):
        assert ("no estimate" in row) == (entry.estimate is None)
        assert of_fit[-1] == entry.error
    assert fits.detail
    assert {"time in s", "p1", "coulomb"} < {*fits.headers}
