"""Tables fit the width they are given, and lose nothing by it."""

import re

from hypothesis import given
from hypothesis import strategies as st

from butterfly.cli.table_layout import folded, laid_out

NUMBERS = st.floats(-1e6, 1e6).map(lambda value: f"{value:.6g}")
NAMES = st.text("abcdefgh", min_size=1, max_size=12)


def _lines(layout):
    return [line for block in layout.blocks for line in block.lines]


@given(
    st.lists(st.lists(NUMBERS, min_size=9, max_size=9), min_size=1, max_size=4),
    st.lists(st.lists(NAMES, min_size=1, max_size=4).map(" ".join), min_size=10, max_size=10),
    st.integers(40, 120),
)
def test_no_number_is_folded_cut_or_lost_and_no_line_is_too_long(numbers, headers, width):
    rows = [(f"row{k}", *row) for k, row in enumerate(numbers)]
    lines = _lines(laid_out(headers, rows, width))
    assert all(len(line) <= width for line in lines)
    for row in rows:
        told = [word for line in lines if row[0] in line for word in line.split()]
        assert [word for word in told if word != row[0]] == list(row[1:])


def test_a_table_that_fits_stands_as_it_is():
    (block,) = laid_out(("", "true"), [("p1", "0.00325"), ("p2", "1")], 80).blocks
    assert block.lines == ["         true", "  ───────────", "  p1  0.00325", "  p2        1"]


def test_columns_without_any_text_are_left_out():
    rows = [("a", "", "1", "–"), ("b", "–", "2", "")]
    assert _lines(laid_out(("log", "orbit", "FIT", "warning"), rows, 80))[0] == "  log  FIT"


def test_a_table_too_wide_stands_in_blocks_that_each_name_their_rows():
    headers = ("run", "method", *(f"value{k}" for k in range(12)))
    rows = [(f"{run}", "weak-form", *["0.123456"] * 12) for run in range(3)]
    blocks = laid_out(headers, rows, 80, lead=2).blocks
    assert len(blocks) > 1
    assert all(line.split()[:2] == ["1", "weak-form"] for block in blocks for line in block.rows[1])


def test_blocks_repeat_the_columns_that_tell_rows_apart():
    headers = ("estimator", "parameter", *(f"value{k}" for k in range(9)))
    rows = [("weak-form", name, *["0.123456"] * 9) for name in ("p1", "p2")]
    blocks = laid_out(headers, rows, 80).blocks
    assert len(blocks) > 1
    assert all(
        line.split()[:2] == ["weak-form", "p2"] for block in blocks for line in block.rows[1]
    )


def test_long_remarks_that_do_not_fit_are_told_below_each_once():
    text = "the fit did not settle, since two of the parameters say the same"
    headers = ("log", *(f"a number {k}" for k in range(6)), "remark")
    rows = [
        (name, *["0.1234567"] * 6, remark) for name, remark in (("a", text), ("b", text), ("c", ""))
    ]
    layout = laid_out(headers, rows, 80)
    assert layout.notes == [f"a; b: {text}"]
    assert "remark" not in "".join(_lines(layout))


def test_what_all_rows_say_is_told_once_and_what_most_say_last():
    text, other = "units of the file's own: time ms, angle deg", "swings a turn from the others"
    rows = [(name, "8000", text) for name in "abcdef"]
    layout = laid_out(("log", "samples", "findings"), rows, 80)
    assert layout.notes == [f"all: {text}"]
    assert "findings" not in "".join(_lines(layout))
    rows = [*rows, ("g", "8000", other)]
    notes = laid_out(("log", "samples", "findings"), rows, 36).notes
    assert notes == [f"g: {other}", f"all others: {text}"]
    rows = [*rows[:-1], ("g", "8000", "")]
    notes = laid_out(("log", "samples", "findings"), rows, 36).notes
    assert notes == [f"a; b; c; d; e; f: {text}"]


def test_a_text_is_folded_between_words_and_no_number_leaves_its_unit():
    text = "the harmonic-balance fit has a median FIT of 99.6 % over 24 logs, each from rest"
    for width in range(12, 80):
        lines = folded(text, width)
        assert " ".join(lines) == text
        assert not any(re.search(r"\d$", line) for line in lines[:-1])


def test_a_unit_of_several_factors_stays_in_one_line():
    for width in range(10, 40):
        lines = folded("inertia 0.003 kg m², viscous in N m s/rad", width)
        assert any("kg m²" in line for line in lines)
        assert any("N m s/rad" in line for line in lines)
