"""What an error says: one line with place, value and what would be right."""

import math

import pytest

from butterfly.errors import (
    InputError,
    listed,
    nearest,
    require_names,
    require_number,
    shown,
    size_text,
)


def test_an_input_error_is_one_short_line_whatever_the_value():
    error = InputError("a.csv", "time", "a\nb\x1b[31m" * 500, "a number")
    assert (error.source, error.field, error.expected) == ("a.csv", "time", "a number")
    assert str(error).startswith(r"a.csv: time: got a\nb\x1b[31ma\nb")
    assert str(error).endswith("(4000 characters); expected a number")
    assert str(error).isprintable()
    assert isinstance(error, ValueError)


def test_a_long_text_is_cut_after_so_many_characters_and_counted():
    assert shown("x" * 300) == "x" * 300
    assert shown("x" * 301) == "x" * 300 + "... (301 characters)"
    assert shown("abcdef", 3) == "abc... (6 characters)"


@pytest.mark.parametrize("value", [-1e-300, math.nan, math.inf, -math.inf, "1", None, 1j])
def test_what_is_no_finite_number_from_0_on_is_refused_with_its_unit(value):
    with pytest.raises(InputError, match=r"^Hand: mass: .* a finite non-negative number of kg$"):
        require_number("Hand", mass=value, unit="kg")


def test_only_what_has_to_be_positive_is_refused_at_0():
    require_number("Hand", mass=0.0, arm=-0.0)
    with pytest.raises(InputError, match=r"^Hand: arm: got 0; expected a finite positive number$"):
        require_number("Hand", positive=True, mass=1e-300, arm=0)


def test_the_closest_name_comes_first_and_without_one_all_are_named():
    names = ("torque", "voltage", "current")
    assert nearest("volage", names) == (
        "'voltage' (did you mean that?); valid names: 'torque', 'voltage', 'current'"
    )
    assert nearest("xyz", names) == "one of 'torque', 'voltage', 'current'"


def test_of_a_long_list_four_are_named_and_the_others_counted():
    assert listed(["a", "b", "c", "d"]) == "a, b, c, d"
    assert listed(["a", "b", "c", "d", "e", "f"]) == "a, b, c, d and 2 more"


def test_a_name_that_is_unknown_or_given_twice_is_refused():
    require_names("weak-form", "terms", ("drag", "bias"), ("bias", "drag", "spring"))
    with pytest.raises(InputError, match=r"weak-form: terms: got drg; expected 'drag'"):
        require_names("weak-form", "terms", ("drg",), ("bias", "drag"))
    with pytest.raises(InputError, match="got bias twice; expected each name once"):
        require_names("weak-form", "terms", ("bias", "bias"), ("bias",))


@pytest.mark.parametrize("power", range(7))
def test_sizes_are_told_in_thousands_of_thousands(power):
    unit = ("bytes", "kB", "MB", "GB", "TB", "PB", "EB")[power]
    assert size_text(2 * 1000**power) == (f"2.0 {unit}" if power else "2 bytes")
    assert size_text(999 * 1000**power) == (f"999.0 {unit}" if power else "999 bytes")
