"""A verdict in words: one sentence, paragraphs, JSON and back."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from butterfly.identification.diagnostics.verdict import Standing
from butterfly.report.verdict import SaidVerdict


def test_a_good_verdict_is_one_sentence_and_one_paragraph():
    good = SaidVerdict(Standing.GOOD)
    assert good.sentence == "Good: nothing was found that speaks against these values."
    assert good.paragraphs == ["Nothing was found that speaks against these values."]


def test_reasons_stand_in_the_sentence_and_each_alone():
    said = SaidVerdict(Standing.NOT, ("One reason.", "Another."))
    assert said.sentence == "Do not use: One reason. Another."
    assert said.paragraphs == ["One reason.", "Another."]


@given(st.sampled_from(Standing), st.lists(st.text()))
def test_a_verdict_comes_back_from_json(standing, reasons):
    said = SaidVerdict(standing, tuple(reasons))
    assert SaidVerdict.of_numbers(json.loads(json.dumps(said.numbers()))) == said


def test_there_is_none_in_what_an_older_program_wrote():
    assert SaidVerdict.of_numbers({}) is None
    assert SaidVerdict.of_numbers({"verdict": None}) is None


@pytest.mark.parametrize(
    "content",
    [
        {"verdict": "fine", "reasons": []},
        {"verdict": "good"},
        {"verdict": "good", "reasons": "text"},
        {"verdict": "good", "reasons": [1]},
    ],
)
def test_damage_is_refused(content):
    with pytest.raises((KeyError, TypeError, ValueError)):
        SaidVerdict.of_numbers(content)
