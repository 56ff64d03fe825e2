"""Words that mean units, against factors that are written anew from the SI brochure."""

import math

import pytest

from butterfly.logs.unit_words import (
    counts_without_turn,
    factor_of,
    plain_text,
    quantity_of,
    units_meant,
)
from tests.logs.said_table import SPELLINGS

SPELT = [
    (quantity, text, factor)
    for quantity, spellings in SPELLINGS.items()
    for text, factor in spellings.items()
    if factor
]


@pytest.mark.parametrize("quantity", SPELLINGS)
def test_a_spelling_means_one_unit_of_its_quantity_with_its_factor(quantity):
    for text, factor in ((text, f) for kind, text, f in SPELT if kind == quantity):
        (unit,) = units_meant(text)
        assert factor_of(unit) == pytest.approx(factor, rel=1e-9), text
        assert quantity_of(unit) == quantity, text


def test_a_number_of_counts_is_a_share_of_a_turn_and_counts_alone_are_none():
    (unit,) = units_meant("counts/4096")
    assert factor_of(unit) == pytest.approx(2 * math.pi / 4096)
    assert counts_without_turn("encoder ticks")
    assert not counts_without_turn("counts/4096")


def test_a_case_that_nobody_uses_may_mean_any_of_the_units_spelt_so():
    assert set(units_meant("Mv")) == {"mV", "MV"}
    assert units_meant("mV") == ("mV",)
    assert units_meant("furlong") == ()


def test_letters_that_look_alike_are_one():
    assert plain_text("µs") == plain_text("μs") == "us"
    assert plain_text("45º") == plain_text("45˚") == "45°"
