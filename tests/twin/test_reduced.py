"""What is left of a function whose arguments are known."""

import math

import pytest

from butterfly.model.kernel.equation import Constants
from butterfly.twin.languages import C
from butterfly.twin.translate import NUMBER, Fields, Translator


def _early(x, on, c):
    total = 0.0
    for _ in range(3):
        total += c.p3 * math.sin(x)
        if on:
            break
        total += c.spring * x
    return total, 0.0


@pytest.mark.parametrize(
    ("on", "left"), [(True, "c->p3"), (False, "for (int i = 0; i < 3; i++)"), (NUMBER, "if (on)")]
)
def test_what_is_known_is_worked_out(on, left):
    kinds = dict.fromkeys(Constants._fields, 0.0) | {"p3": NUMBER}
    function = Translator({}).function(_early, NUMBER, on, Fields(kinds))
    text = C("a", [function]).text()
    assert left in text
    assert "spring" not in text
    assert ("for" in text) == (on is not True)
