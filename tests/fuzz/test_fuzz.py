"""A fixed sample of what `make fuzz` tries without end."""

import random

import pytest

from tests.fuzz.answers import KINDS as ANSWERED
from tests.fuzz.answers import is_escape
from tests.fuzz.damage import damaged
from tests.fuzz.kinds import KINDS, sounds_of

WORKED = {"results", "saved", "values", *ANSWERED}
"""Kinds that commands work with, and do not only read."""

CASES = dict.fromkeys(KINDS, 80) | {"experiment": 40, "manifest": 50}
CASES |= {"results": 20, "saved": 20, "values": 10, **dict.fromkeys(ANSWERED, 15)}


@pytest.mark.parametrize(
    "kind", [pytest.param(kind, marks=[pytest.mark.slow] * (kind in WORKED)) for kind in KINDS]
)
def test_damaged_files_end_in_an_answer_or_in_a_line(kind, tmp_path):
    rng = random.Random(15)  # noqa: S311 - no secret
    for number in range(CASES[kind]):
        sound, escapes = rng.choice(sounds_of(kind))
        outcome = escapes(damaged(sound, rng), tmp_path / "damaged")
        assert not is_escape(outcome), (number, outcome)
