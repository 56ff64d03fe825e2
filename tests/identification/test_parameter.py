"""One scale of trust: the row of a value, its claim and badge, and the verdict on it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

import butterfly as bf
from butterfly.arrays import ROUNDING
from butterfly.identification import trust as parameter
from butterfly.identification.derived_quantities import WAYS
from butterfly.identification.trust import (
    ACCUSED,
    CLEARLY,
    DRAWS,
    GOOD_WITHIN,
    Finding,
    FindingKind,
    Parameter,
    Trust,
    trust_of,
)
from butterfly.report.parameter_table import badge_of
from butterfly.verdict import CONFIDENCE, SPREADS, Level
from tests.identification.simulated import estimate_of

WIDTHS = {
    Trust.PRECISE: 0.99 * GOOD_WITHIN / CLEARLY,
    Trust.GOOD: 0.99 * GOOD_WITHIN,
    Trust.CARE: 0.99 / CLEARLY,
    Trust.POOR: 0.99,
    Trust.ZERO: 1.01,
    Trust.UNSURE: np.inf,
}
"""Half-widths over a value, just within what each row holds for."""


@pytest.mark.parametrize(("row", "width"), WIDTHS.items(), ids=str)
@pytest.mark.parametrize("value", [2.0, -2.0])
def test_a_row_is_that_of_the_half_width_and_all_views_say_it(row, width, value):
    reach = width * abs(value)
    assert trust_of(value, value - reach, value + reach) is row
    shown = Parameter(
        name="p2", meaning="", unit="", value=value, claim=row.claim,
        lower=None if row is Trust.UNSURE else value - reach,
        upper=None if row is Trust.UNSURE else value + reach,
    )  # fmt: skip
    assert badge_of(shown)[:3:2] == (row.badge, row.level)
    estimate = estimate_of([1.0, value], np.eye(2), names=("p1", "p2"))
    limits = {"lower": np.array([0.99, value - reach]), "upper": np.array([1.01, value + reach])}
    (_, told) = replace(estimate, **limits).table()
    assert told.claim == row.claim


def test_a_value_of_the_scale_that_might_be_0_is_open_and_what_is_given_is_known():
    estimate = estimate_of([1.0, 2.0], np.diag([0.5, 1e-6]), names=("p1", "p2"))
    assert estimate.trust == {"p1": Trust.OPEN, "p2": Trust.PRECISE}
    assert [row.trust for row in estimate.table()] == [Trust.OPEN, Trust.PRECISE]
    assert trust_of(1.0, 1.0, 1.0, known=True) is Trust.KNOWN
    assert trust_of(0.0, 0.0, 0.1, on_bound=True) is Trust.AT_BOUND


@pytest.mark.parametrize(
    ("width", "level"),
    [(0.99 * GOOD_WITHIN, Level.GOOD), (1.01 * GOOD_WITHIN, Level.CARE), (0.99, Level.CARE)],
)
def test_the_verdict_is_good_as_far_as_the_badges_of_the_scale_are(width, level):
    values = np.array([1.0, 2.0])
    estimate = estimate_of(values, np.eye(2), names=("p1", "p4"))
    estimate = replace(estimate, lower=values * (1 - width), upper=values * (1 + width))
    assert estimate.level is level
    assert (badge_of(estimate.table()[0]).level is Level.GOOD) == (level is Level.GOOD)


@pytest.mark.parametrize(("error", "trust"), [(1e-4, Trust.PRECISE), (0.04, Trust.GOOD)])
def test_a_good_value_of_a_doubted_unit_is_not_claimed(error, trust):
    estimate = estimate_of([1.0, 2.0], error**2 * np.eye(2), names=("p1", "p4"))
    unread = Finding(FindingKind.UNIT_UNREAD, ("p4", "N m", "Nm?", "the manifest"))
    row = estimate.with_findings(unread).table()[1]
    assert (row.trust, row.claim) == (Trust.UNREAD, "unit-unread")
    assert estimate.table()[1].trust is trust


def _numbers(part):
    """Return a saved document without its verdict, and without the claims of its values."""
    if not isinstance(part, dict):
        return part
    return {key: _numbers(part[key]) for key in part if key not in _OF_VERDICT}


_OF_VERDICT = {"claim", "verdict", "reasons", "summary"}


def test_good_within_less_changes_the_verdict_and_its_texts_and_nothing_else(
    quick_data, monkeypatch
):
    """Combinations are told besides, as where none of their parts is good."""
    found = bf.identify(quick_data)
    before, numbers = found.judged.level, _numbers(found.to_dict())
    widths = [(row.upper - row.value) / row.value for row in found.estimate.table()[:4:3]]
    monkeypatch.setattr(parameter, "GOOD_WITHIN", 0.5 * max(widths))
    found = bf.identify(quick_data)
    assert (before, found.judged.level) == (Level.GOOD, Level.CARE)
    after = _numbers(found.to_dict())
    more = after["physical"].keys() - numbers["physical"].keys()
    assert more <= {way.name for way in WAYS if way.combined}
    after["physical"] = {name: after["physical"][name] for name in numbers["physical"]}
    assert after == numbers


def test_spreads_hold_a_value_at_the_confidence_and_clear_contradictions_are_as_rare_as_said():
    assert norm.cdf(SPREADS) - norm.cdf(-SPREADS) == pytest.approx(CONFIDENCE)
    assert 2 * norm.sf(CLEARLY) == pytest.approx(ACCUSED)


def test_of_its_draws_one_is_outside_an_interval():
    assert pytest.approx(1.0) == DRAWS * (1 - CONFIDENCE)
    assert np.finfo(float).eps == ROUNDING**2
