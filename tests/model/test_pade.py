import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from butterfly.errors import InputError
from butterfly.model.linear import HIGHEST_ORDER, DelayStates


def _response(late, omega):
    size = late.b.size
    return late.c @ np.linalg.solve(1j * omega * np.eye(size) - late.a, late.b) + late.feedthrough


@given(
    delay=st.floats(1e-5, 10),
    order=st.integers(1, HIGHEST_ORDER),
    turn=st.floats(1e-3, 2 * math.pi),
)
def test_the_error_is_within_its_bound_and_no_frequency_is_damped(delay, order, turn):
    found = _response(DelayStates.of(delay, order), turn / delay)
    factorial = math.factorial
    bound = factorial(order) ** 2 / factorial(2 * order) / factorial(2 * order + 1)
    assert abs(found - np.exp(-1j * turn)) <= bound * turn ** (2 * order + 1) + 1e-12
    assert abs(found) == pytest.approx(1, rel=1e-12)


@pytest.mark.parametrize("order", [1, 4, 8, HIGHEST_ORDER])
def test_the_states_decay(order):
    assert max(np.linalg.eigvals(DelayStates.of(0.01, order).a).real) < 0


def test_what_makes_no_sense_is_refused():
    with pytest.raises(InputError, match="delay"):
        DelayStates.of(-0.01, 4)
    with pytest.raises(InputError, match="between 1 and 10"):
        DelayStates.of(0.01, 11)
