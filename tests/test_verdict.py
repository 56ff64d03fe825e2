"""One scale of levels, and a verdict in words: its lines, JSON and back."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from butterfly.verdict import VERDICTS, Level, Verdict


@given(st.lists(st.sampled_from(Level)))
def test_the_worst_allows_least(levels):
    worst = Level.worst(levels)
    assert all(each.usable for each in levels) == worst.usable
    assert (worst is Level.GOOD) == (set(levels) <= {Level.GOOD})
    assert worst in {*levels, Level.GOOD}


def test_the_text_of_a_verdict_tells_its_level():
    assert [Level.of_verdict(each.verdict) for each in VERDICTS] == list(VERDICTS)
    assert Level.NOTE.verdict == Level.GOOD.verdict
    with pytest.raises(KeyError, match="fine"):
        Level.of_verdict("fine")


def test_its_lines_begin_with_what_may_be_done():
    verdict = Verdict(Level.CARE, ("p1 within 25 %.", "The model follows."))
    assert verdict.lines == ("Use with care: p1 within 25 %.", "The model follows.")
    assert Verdict(Level.GOOD, ()).lines == ("Good",)


@given(st.sampled_from(VERDICTS), st.lists(st.text()))
def test_a_verdict_comes_back_from_json(level, reasons):
    verdict = Verdict(level, tuple(reasons))
    assert Verdict.of_numbers(json.loads(json.dumps(verdict.numbers()))) == verdict


def test_of_an_older_program_there_is_none_and_damage_is_refused():
    assert Verdict.of_numbers({}) is None
    assert Verdict.of_numbers({"verdict": None}) is None
    for reasons in ({}, {"reasons": "text"}, {"reasons": [1]}):
        with pytest.raises((KeyError, TypeError, ValueError)):
            Verdict.of_numbers({"verdict": "good"} | reasons)
    with pytest.raises(KeyError):
        Verdict.of_numbers({"verdict": "fine", "reasons": []})


def test_of_several_the_worst_counts_and_all_lines_are_said():
    good = Verdict(Level.GOOD, ("p1 ±1 %.", "Model: error 1 % of the motion."))
    care = Verdict(Level.CARE, ("p1 ±20 %.", "Model: error 5 % of the motion."))
    both = Verdict.of_several({"one": good, "other": care, "third": good})
    assert both.level is Level.CARE
    assert both.lines == (
        "Use with care: other: p1 ±20 %.",
        "Model: error 5 % of the motion.",
        "one: Good: p1 ±1 %. Model: error 1 % of the motion.",
        "third: Good: p1 ±1 %. Model: error 1 % of the motion.",
    )


def test_an_answer_is_said_before_the_verdict_it_rests_on_unless_that_forbids_its_use():
    good = Verdict(Level.GOOD, ("p1 ±1 %.", "Model: small error."))
    assert good.after("It holds.") == ("It holds.", "Good: p1 ±1 %.", "Model: small error.")
    bad = Verdict(Level.WARNING, ("It does not follow.",))
    assert bad.after("It holds.") == ("Do not use: It does not follow.", "It holds.")
