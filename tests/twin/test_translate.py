"""What cannot be translated is named."""

import pytest

from butterfly.twin.translate import NUMBER, Translator


def _power(x):
    return x**3


def test_what_cannot_be_translated_is_named():
    with pytest.raises(NotImplementedError, match=r"x \*\* 3"):
        Translator({}).function(_power, NUMBER)
