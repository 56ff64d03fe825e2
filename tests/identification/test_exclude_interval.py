"""Pieces of a log of which a stretch is cut out."""

import numpy as np
import pytest

from butterfly.identification.splits import excluding_interval
from butterfly.logs.log import Log, Sine


def _swinging(**properties):
    time = np.arange(2000) * 0.01
    return Log(time, np.cos(time), 0.3 * np.sin(2 * time), name="swing", **properties)


def test_the_piece_after_a_stretch_begins_in_motion_with_what_was_commanded():
    before, after = excluding_interval(_swinging(), slice(500, 1000))
    assert (before.time[0], before.time[-1]) == (0.0, 4.99)
    assert after.time[0] == 10.0
    assert after.time.size == 1000
    assert after.initial_state.velocity == pytest.approx(0.6 * np.cos(20), abs=0.01)
    np.testing.assert_allclose(after.lead.input, np.cos(after.lead.time))
    assert (before.name, after.name) == ("swing, before", "swing, after")


def test_a_piece_that_cannot_be_used_is_left_out():
    (after,) = excluding_interval(_swinging(), slice(0, 1000))
    assert after.name == "swing, after"
    (before,) = excluding_interval(_swinging(), slice(1990, 2000))
    assert before.name == "swing, before"
    sine = _swinging(excitation=Sine(omega=2.0, amplitude=1.0))
    assert len(excluding_interval(sine, slice(1400, 1500))) == 1
