"""Figures of tables are true to their rows."""

import numpy as np
import pytest

from butterfly.report.answer_page import corner, fits, leaderboard, shares


def _result(rows, **units):
    """The numbers of a result of some rows."""
    return {"rows": rows, "entries": rows, "units": units}


def _method(name, held_out, in_sample):
    """A row of a leaderboard, by its median FITs in %."""
    both = {"held_out": held_out, "in_sample": in_sample}
    medians = {key: None if fit is None else {"median": fit} for key, fit in both.items()}
    return {"data": "d", "method": name} | medians


def test_methods_are_drawn_by_what_their_fit_lacks_and_without_one_not_at_all():
    rows = [_method("a", 99.0, 100.0), _method("b", 80.0, 95.0), _method("c", None, 60.0)]
    figure = leaderboard(_result(rows))
    unseen, seen = figure.data
    assert dict(zip(unseen.y, unseen.x, strict=True)) == pytest.approx({"a": 1.0, "b": 20.0})
    assert [*seen.x[1:]] == pytest.approx([5.0, 40.0])
    assert seen.x[0] > 0  # of a FIT of 100 %, on a logarithmic axis
    assert figure.layout.xaxis.type == "log"
    assert [*figure.layout.yaxis.categoryarray] == ["c", "b", "a"]  # upwards


def test_only_columns_of_fits_and_of_shares_are_drawn_as_such():
    about = {"added mass in kg": 0.0, "frequency in rad/s": 2.0}
    rows = [{"log": f"{k}.csv", **about, "FIT in %": 90.0 + k, "apart in rad": k} for k in range(3)]
    (curve,) = fits(_result(rows)).data
    assert [*curve.x] == [90.0, 91.0, 92.0]
    assert shares(_result(rows)) is None
    assert fits(_result([{"apart in rad": 1.0}])) is None


def test_draws_are_counted_for_each_parameter_that_varies():
    p1, p3 = np.random.default_rng(0).normal([[1.0], [2.0]], 0.1, (2, 500))
    rows = [{"p1": a, "delay": 0.0, "p3": b} for a, b in zip(p1, p3, strict=True)]
    units = {"rows.p1": "kg m²", "rows.p3": "N m", "rows.delay": "s"}
    pair, region, first, second = corner(_result(rows, **units)).data
    for histogram, values in ((first, p1), (second, p3)):
        counts = np.array(histogram.y[1:-1:2])
        shares = np.histogram(values, counts.size)[0]
        np.testing.assert_allclose(counts, shares / shares.max())
        assert (min(histogram.x), max(histogram.x)) == (values.min(), values.max())
    np.testing.assert_array_equal([pair.x, pair.y], [p1, p3])
    assert region.name == "95 % region"
    assert corner(_result([{"delay": 0.0}, {"delay": 0.0}])) is None
