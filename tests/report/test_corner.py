"""Ellipses are those of a joint covariance, and sentences name what moves together."""

import dataclasses
import math
from itertools import pairwise

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

import butterfly as bf
from butterfly.identification.predict import honest_covariance
from butterfly.model.prior import Prior
from butterfly.report.corner import (
    MOST,
    Corner,
    CornerAxis,
    corner_caption,
    corner_figure,
    corner_of,
    corner_of_draws,
    corner_sentences,
    correlation_text,
    ellipse,
)
from butterfly.report.pictures import draw

CHI_SQUARED = 5.991464547107979  # 95 % of two degrees of freedom, by tables


def _corner(correlation, values=None, shares=0.01, **marks):
    """A corner plot of n parameters with errors of some share of their values."""
    correlation = np.asarray(correlation, dtype=float)
    values = np.ones(len(correlation)) if values is None else np.asarray(values, dtype=float)
    errors = shares * np.abs(values)
    axes = (
        CornerAxis(f"p{k + 1}", "N m", value, value - 2 * error, value + 2 * error, marks)
        for k, (value, error) in enumerate(zip(values, errors, strict=True))
    )
    return Corner(axes=tuple(axes), covariance=correlation * np.outer(errors, errors))


def _pair(correlation):
    return [[1.0, correlation], [correlation, 1.0]]


@pytest.mark.parametrize("correlation", [0.0, 0.6, -0.95, 0.9999])
def test_an_ellipse_is_the_closed_form_whatever_the_units_are(correlation):
    centre, sizes = np.array([3e-3, 50.0]), np.array([1e-6, 0.7])
    covariance = np.array(_pair(correlation)) * np.outer(sizes, sizes)
    points = ellipse(centre, covariance)
    off = points - centre[:, None]
    scaled = off / sizes[:, None]
    distances = np.sum(scaled * np.linalg.solve(_pair(correlation), scaled), axis=0)
    np.testing.assert_allclose(distances, CHI_SQUARED, rtol=1e-9)
    reach = np.abs(scaled).max(axis=1)
    np.testing.assert_allclose(reach, math.sqrt(CHI_SQUARED), rtol=2e-3)
    x, y = scaled
    area = abs(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1])) / 2
    assert area == pytest.approx(math.pi * CHI_SQUARED * math.sqrt(1 - correlation**2), rel=2e-3)
    np.testing.assert_allclose(points[:, 0], points[:, -1])


def _regions(figure):
    return [trace for trace in figure.data if trace.name == "95 % region"]


def _share_within(region, x, y):
    """The share of points inside a polygon, by how often a ray to the right crosses it."""
    inside = np.zeros(x.size, dtype=int)
    ends = list(zip(region.x, region.y, strict=True))
    for (x0, y0), (x1, y1) in pairwise(ends):
        between = (y0 > y) != (y1 > y)
        with np.errstate(divide="ignore", invalid="ignore"):
            inside += between & (x < x0 + (y - y0) * (x1 - x0) / (y1 - y0))
    return float(np.mean(inside % 2))


def test_95_percent_of_draws_are_inside_an_identification_s_ellipses(simulated):
    result, _ = simulated
    names = [axis.name for axis in corner_of(result).chosen().axes]
    drawn = {n: np.array([row[n] for row in bf.draws(result, 4000).rows()]) for n in names}
    free = [name for name in names if drawn[name].min() > 0]  # no bound moved a draw
    regions = _regions(result.plot.corner())
    places = [(a, b) for k, a in enumerate(names) for b in names[k + 1 :]]
    assert len(regions) == len(places)
    shares = [
        _share_within(region, drawn[across], drawn[up])
        for region, (across, up) in zip(regions, places, strict=True)
        if {across, up} <= {*free}
    ]
    assert len(shares) >= 10
    np.testing.assert_allclose(shares, 0.95, atol=0.015)


def test_an_identification_s_corner_has_its_truth_its_intervals_and_its_correlations(simulated):
    result, truth = simulated
    corner = corner_of(result)
    names = [axis.name for axis in corner.axes]
    assert names == [*result.estimate.names]
    expected = honest_covariance(result.estimate)
    np.testing.assert_allclose(corner.covariance, expected)
    rows = {row.name: row for row in result.estimate.table(truth)}
    for axis in corner.axes:
        row = rows[axis.name]
        assert (axis.value, axis.lower, axis.upper) == (row.value, row.lower, row.upper)
        assert axis.marks == {"true value": row.true}
    figure = corner_figure(corner)
    written = {note.text.strip("</b>") for note in figure.layout.annotations}
    p1, p3 = names.index("p1"), names.index("p3")
    assert correlation_text(corner.correlation[p1, p3]) in written
    assert len(figure.layout.annotations) == len(names) * (len(names) - 1) // 2
    (green,) = {(t.marker.color, t.marker.symbol) for t in figure.data if t.name == "true value"}
    assert green == ("#009E73", "diamond")
    unknown = np.full_like(result.estimate.covariance, np.nan)
    without = dataclasses.replace(result.estimate, covariance=unknown)
    assert dataclasses.replace(result, estimate=without).plot.corner() is None


def test_a_given_value_is_marked_and_what_is_known_exactly_has_no_ellipse(simulated):
    result, _ = simulated
    known = Prior.of({"p4": "0.025 ± 0.001", "back_emf": 0.001})
    estimate = dataclasses.replace(result.estimate, known=known)
    corner = corner_of(dataclasses.replace(result, estimate=estimate))
    marks = {axis.name: axis.marks for axis in corner.axes}
    assert marks["p4"]["given value"] == pytest.approx(0.025)
    assert "given value" not in marks["p1"]
    assert "back_emf" not in marks
    assert "Pink: given value" in corner_caption(corner)


def test_of_many_parameters_those_that_are_most_correlated_are_drawn_in_their_order():
    correlation = np.eye(12)
    for one, other, size in ((11, 2, -0.97), (4, 7, 0.9), (0, 9, 0.5), (1, 3, 0.1)):
        correlation[one, other] = correlation[other, one] = size
    corner = _corner(correlation)
    few = corner.chosen()
    assert [axis.name for axis in few.axes] == ["p1", "p3", "p5", "p8", "p10", "p12"]
    assert len(few.axes) == MOST
    np.testing.assert_allclose(np.sort(few.correlation[few.correlation != 0])[:2], -0.97)
    assert corner_caption(corner).startswith("The 6 most correlated of 12 parameters.")
    assert len(_regions(corner_figure(corner))) == MOST * (MOST - 1) // 2
    small = _corner(np.eye(4))
    assert small.chosen() is small


@pytest.mark.parametrize(
    ("correlation", "values", "shares", "sentence"),
    [
        (
            0.98,
            (1, 4),
            (0.01, 0.01),
            "p1 and p2 move together (correlation 0.98): their ratio is better known than either.",
        ),
        (
            -0.98,
            (1, 4),
            (0.01, 0.01),
            "p1 and p2 trade off (correlation −0.98): their product is better known than either.",
        ),
        (
            0.98,
            (1, 4),
            (0.01, 0.3),
            "p1 and p2 move together (correlation 0.98): a combination of them is better known "
            "than either.",
        ),
        (
            0.3,
            (1, 4),
            (0.01, 0.01),
            "No two parameters move together: the largest correlation is 0.30, of p1 and p2.",
        ),
    ],
)
def test_a_sentence_says_which_parameters_move_together(correlation, values, shares, sentence):
    corner = _corner(_pair(correlation), values, np.array(shares))
    assert corner_sentences(corner)[0] == sentence


def test_what_a_ratio_is_said_to_be_known_by_holds_in_draws():
    corner = _corner(_pair(0.98), (1, 4))
    values = [axis.value for axis in corner.axes]
    drawn = np.random.default_rng(0).multivariate_normal(values, corner.covariance, 4000)
    ratio = drawn[:, 0] / drawn[:, 1]
    assert np.std(ratio) / np.mean(ratio) < 0.5 * 0.01


def test_more_than_two_that_move_together_are_said_once():
    correlation = np.full((4, 4), 0.97)
    correlation[3, :] = correlation[:, 3] = 0.0
    np.fill_diagonal(correlation, 1.0)
    said = corner_sentences(_corner(correlation))
    assert said[0] == (
        "p1, p2 and p3 move together (correlations of ± 0.97 and beyond): their ratios are better "
        "known than any of them."
    )
    assert len(said) == 2
    assert "`butterfly design`" in said[1]


def test_draws_have_the_ellipse_of_their_own_covariance():
    p1, p3 = (
        np.random.default_rng(0).multivariate_normal([1, 2], [[0.01, 0.008], [0.008, 0.01]], 500).T
    )
    rows = [{"p1": a, "delay": 0.0, "p3": b} for a, b in zip(p1, p3, strict=True)]
    corner = corner_of_draws({"rows": rows, "units": {"rows.p1": "kg m²", "rows.p3": "N m"}})
    assert [axis.name for axis in corner.axes] == ["p1", "p3"]
    np.testing.assert_allclose(corner.covariance, np.cov(p1, p3))
    (region,) = _regions(corner_figure(corner))
    assert _share_within(region, p1, p3) == pytest.approx(0.95, abs=0.03)


def test_a_still_has_every_panel_and_every_correlation():
    correlation = np.full((4, 4), 0.5) + 0.5 * np.eye(4)
    still = draw(corner_figure(_corner(correlation, **{"true value": 1.0})))
    FigureCanvasAgg(still).draw()
    assert len(still.axes) == 10
    assert [text.get_text() for text in still.texts] == ["0.50"] * 6
