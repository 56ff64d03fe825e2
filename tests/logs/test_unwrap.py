"""Jumps by a turn, told from all that is none."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from butterfly.logs.faults import find_wrapping, unwrapped

TIME = np.arange(3000) * 5e-3
NO_GAPS = np.zeros(TIME.size - 1, dtype=bool)
TURN = 2 * np.pi

MOTIONS = {
    "spin": 12 * TIME,
    "fast spin": 200 * TIME,
    "pendulum about the border": np.pi + 0.3 * np.sin(4 * TIME),
    "several turns": 8 * np.sin(0.7 * TIME) + 0.3 * np.sin(9 * TIME),
    "once over": 3.3 * (1 - np.exp(-np.maximum(TIME - 5, 0))),
}


def _wrapped(angle, turn, low):
    return (angle - low) % turn + low


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("noise", [0.0, 0.02])
@pytest.mark.parametrize("step", [0.0, TURN / 4096, TURN / 100])
@pytest.mark.parametrize(("turn", "low"), [(TURN, -np.pi), (TURN, 0.0), (16 * TURN, -0.5)])
def test_a_wrapped_angle_is_made_whole_again(motion, noise, step, turn, low):
    angle = MOTIONS[motion] + noise * np.random.default_rng(0).standard_normal(TIME.size)
    angle = np.round(angle / step) * step if step else angle
    wrapped = _wrapped(angle, turn, low)
    assert find_wrapping(angle, NO_GAPS) is None
    found = find_wrapping(wrapped, NO_GAPS)
    if np.max(np.abs(wrapped - angle)) < 1e-9:
        assert found is None
        return
    assert (found.turn, found.exact) == (pytest.approx(turn), True)
    whole = unwrapped(wrapped, found)
    np.testing.assert_allclose(whole - whole[0], angle - angle[0], atol=1e-8)


def test_an_encoder_before_a_gear_wraps_at_a_share_of_the_turn():
    angle = 2.5 * np.sin(3 * TIME)
    found = find_wrapping(_wrapped(angle, TURN / 7, 0.0), NO_GAPS)
    assert (found.turn, found.exact) == (pytest.approx(TURN / 7), True)
    odd = find_wrapping(_wrapped(angle, TURN / 7.3, 0.0), NO_GAPS)
    assert odd.turn == pytest.approx(TURN / 7.3, rel=0.01)
    assert not odd.exact


@settings(max_examples=50)
@given(
    size=st.floats(1.0, 300.0),
    omega=st.floats(0.5, 600.0),
    rows=st.lists(st.integers(1, 2998), min_size=0, max_size=4, unique=True),
    spike=st.floats(10.0, 100.0),
)
def test_fast_motion_and_outliers_are_no_wrapping(size, omega, rows, spike):
    angle = size * np.sin(omega * TIME)
    if rows:
        angle = np.sin(3 * TIME)
        angle[rows] += spike
    assert find_wrapping(angle, NO_GAPS) is None


def test_what_happens_in_a_gap_is_no_jump():
    angle = np.where(TIME < 5, 0.0, TURN) + 0.1 * np.sin(3 * TIME)
    gap = np.diff(angle) > 5
    assert find_wrapping(angle, gap) is None
    assert find_wrapping(angle, NO_GAPS) is not None
