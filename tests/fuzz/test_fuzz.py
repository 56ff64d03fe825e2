"""A fixed sample of what `make fuzz` tries without end."""

import random

import pytest

from tests.fuzz.damage import damaged
from tests.fuzz.kinds import KINDS


@pytest.mark.parametrize("kind", KINDS)
def test_damaged_files_end_in_an_answer_or_in_a_line(kind, tmp_path):
    sound, escapes = KINDS[kind]
    rng = random.Random(15)  # noqa: S311 - no secret
    for number in range(250):
        assert not escapes(damaged(rng.choice(sound), rng), tmp_path / "damaged"), number
