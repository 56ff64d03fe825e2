"""The levels are what they say of a normal distribution."""

import numpy as np
import pytest
from scipy.stats import norm

from butterfly.identification import levels


def test_spreads_hold_a_value_at_the_confidence_and_clear_contradictions_are_as_rare_as_said():
    assert norm.cdf(levels.SPREADS) - norm.cdf(-levels.SPREADS) == pytest.approx(levels.CONFIDENCE)
    assert 2 * norm.sf(levels.CLEARLY) == pytest.approx(levels.ACCUSED)


def test_of_its_draws_one_is_outside_an_interval():
    assert pytest.approx(1.0) == levels.DRAWS * (1 - levels.CONFIDENCE)
    assert np.finfo(float).eps == levels.ROUNDING**2
