"""What a log tells of itself: its columns, and the command before a piece of it."""

from dataclasses import replace

import numpy as np
import pytest

from butterfly.errors import InputError
from butterfly.logs.formats import log_of_table
from butterfly.logs.log import Lead, Log
from tests.independent.integrator import Joint, motion


def test_columns_of_different_lengths_are_refused(sine_log):
    with pytest.raises(InputError, match=r"sine: angle: got shape \(3,\)"):
        replace(sine_log, angle=np.zeros(3))


JOINT = Joint(inertia=0.004, viscous=0.002, gravity=0.1, gain=1.0, coulomb=0.002, delay=0.02)
TIME = np.arange(0, 4, 0.004)


def test_a_piece_begins_in_motion_however_slow_and_knows_what_was_commanded_before():
    inputs = 0.02 * np.sin(4 * TIME)
    log = Log(TIME, inputs, motion(JOINT, TIME, inputs, 0.2, 0.0)[0])
    piece = log.piece(300, 800)
    assert isinstance(piece.lead, Lead)
    np.testing.assert_array_equal(piece.command[0], TIME[:800])
    np.testing.assert_array_equal(piece.command[1], log.input[:800])
    later = piece.piece(400, 500)
    assert later.command[0][0] == pytest.approx(TIME[700] - 2.0, abs=0.005)
    slope = (log.angle[301] - log.angle[299]) / 0.008
    assert piece.initial_state.velocity == pytest.approx(slope, rel=0.02)
    assert log.piece(0, 300).lead is None
    still = replace(log, angle=np.full(TIME.size, 0.1))
    assert still.initial_state == (0.1, 0.0)


@pytest.mark.parametrize("kind", [float, int])
def test_what_is_masked_is_missing_not_what_lies_below_the_mask(kind):
    hidden = np.arange(20) == 7
    angle = np.ma.array(np.where(hidden, 999, np.arange(20)).astype(kind), mask=hidden)
    frame = {"time": np.arange(20.0), "input": np.zeros(20), "angle": angle}
    for log in (Log(**frame), Log.from_frame(frame), log_of_table(frame)):
        np.testing.assert_array_equal(np.isnan(log.angle), hidden)
        np.testing.assert_array_equal(log.angle[~hidden], np.arange(20.0)[~hidden])
    table = np.ma.array(np.column_stack([*frame.values()]), mask=np.outer(hidden, [0, 0, 1]))
    assert np.isnan(log_of_table(table).angle[7])
