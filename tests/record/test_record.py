"""A record shows a digit that moved."""

import copy

import numpy as np
import pytest

from tests.record.__main__ import plain
from tests.record.comparing import compare

FACTS = {
    "numbers": {
        "value": {"p1": 0.1, "p2": 0.0},
        "standard_error": {"p1": 0.01, "p2": 0.02},
        "fit": {"a.csv": 99.5},
    },
    "texts": {"verdict": "good", "findings": ["on-bound p2"]},
    "words": ["Good: p1 within 1 %."],
}
RECORD = {"one": FACTS, "two": copy.deepcopy(FACTS)}


def _changed(*place, to):
    record = copy.deepcopy(RECORD)
    *way, last = place
    part = record
    for key in way:
        part = part[key]
    part[last] = to
    return record


def test_a_record_is_like_itself():
    lines, differs = compare(RECORD, copy.deepcopy(RECORD), 0.0)
    assert not differs
    assert lines == ["2 cases: 2 to the last digit, 0 within 0, 0 beyond it or otherwise; largest "
                     "difference 0"]  # fmt: skip


def test_a_digit_that_moved_is_found_and_measured():
    new = _changed("two", "numbers", "value", "p1", to=0.1 + 1e-9)
    lines, differs = compare(RECORD, new, 1e-9)
    assert differs
    assert lines[0] == "two:"
    assert "value: 1e-08 relative, 1e-07 standard errors (p1" in lines[1]
    assert not compare(RECORD, new, 1e-7)[1]


def test_a_number_near_zero_is_measured_by_its_error():
    new = _changed("one", "numbers", "value", "p2", to=1e-12)
    assert not compare(RECORD, new, 1e-9)[1]
    assert compare(RECORD, new, 1e-11)[1]


@pytest.mark.parametrize(
    ("new", "shown"),
    [
        (_changed("one", "numbers", "fit", "a.csv", to="nan"), "fit: a.csv 99.5 -> nan"),
        (_changed("one", "texts", "verdict", to="do not use"), "verdict"),
        (_changed("one", "texts", "findings", to=[]), "findings"),
        ({"one": FACTS}, "two: missing in the new record"),
    ],
)
def test_what_changed_or_is_missing_is_found(new, shown):
    lines, differs = compare(RECORD, new, 1.0)
    assert differs
    assert shown in "\n".join(lines)


def test_other_words_are_told_where_they_are_asked_for_and_fail_nothing():
    new = _changed("one", "words", to=["Good: p1 within 2 %."])
    assert len(compare(RECORD, new, 0.0)[0]) == 1
    lines, differs = compare(RECORD, new, 0.0, words=True)
    assert not differs
    assert lines[1:3] == ["  - Good: p1 within 1 %.", "  + Good: p1 within 2 %."]


def test_what_is_written_says_no_place_and_has_only_numbers_of_json():
    said = plain({"a": np.float64(np.nan), "b": ["/tmp/x/1.csv: no", None, True]}, ["/tmp/x"])  # noqa: S108
    assert said == {"a": "nan", "b": ["/1.csv: no", None, 1.0]}
