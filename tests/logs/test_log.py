"""What a log tells of itself: its columns, its noise, and how it begins."""

from dataclasses import replace

import numpy as np
import pytest

from butterfly.errors import InputError
from butterfly.logs.formats import log_of_table
from butterfly.logs.log import Lead, Log, Sine
from tests.independent.integrator import Joint, motion


def test_columns_of_different_lengths_are_refused(sine_log):
    with pytest.raises(InputError, match=r"sine: angle: got shape \(3,\)"):
        replace(sine_log, angle=np.zeros(3))


JOINT = Joint(inertia=0.004, viscous=0.002, gravity=0.1, gain=1.0, coulomb=0.002, delay=0.02)
TIME = np.arange(0, 4, 0.004)


def _log(angle, velocity, noise, seed=0):
    inputs = 0.02 * np.sin(4 * TIME + seed)
    found, _ = motion(JOINT, TIME, inputs, angle, velocity)
    return Log(TIME, inputs, found + noise * np.random.default_rng(seed).standard_normal(TIME.size))


@pytest.mark.parametrize("noise", [0.0, 1e-3, 5e-3])
def test_from_rest_it_begins_at_rest_where_its_first_samples_are(noise):
    errors = []
    for seed in range(10):
        log = _log(0.3 * seed / 10, 0.0, noise, seed)
        assert log.initial_state.velocity == 0.0
        errors.append(log.initial_state.angle - 0.3 * seed / 10)
    assert np.max(np.abs(errors)) <= 2 * noise + 1e-5
    assert np.std(errors) <= 0.7 * noise + 1e-5


def test_what_rests_for_long_begins_where_it_rests_whatever_one_sample_says():
    log = _log(0.0, 0.0, 1e-3)
    rests = np.full(500, log.angle[0]) + 1e-3 * np.random.default_rng(1).standard_normal(500)
    angle = np.concatenate([rests, log.angle])
    inputs = np.concatenate([np.zeros(500), log.input])
    held = Log(0.004 * np.arange(angle.size), inputs, angle)
    assert held.initial_state == (pytest.approx(log.angle[0], abs=2e-4), 0.0)


@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_a_log_that_clearly_moves_begins_in_motion(noise):
    for seed, speed in enumerate((-3.0, -1.0, 1.0, 3.0)):
        angle, velocity = _log(0.2, speed, noise, seed).initial_state
        assert angle == pytest.approx(0.2, abs=3 * noise + 1e-3)
        assert velocity == pytest.approx(speed, abs=60 * noise + 0.08)


@pytest.mark.parametrize("phase", [0.0, 0.3, 0.8])
@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_a_free_swing_seen_soon_after_its_turn_begins_in_motion(phase, noise):
    """Though its velocity doubles in the first samples, as that of a joint set going does."""
    pace, time = 2 * np.pi / 1.6, 0.005 * np.arange(660)
    swing = Joint(inertia=1.0, viscous=0.04 * pace, gravity=pace**2, gain=1.0)
    start = 0.3 * np.cos(phase), -0.3 * pace * np.sin(phase)
    angle, _ = motion(swing, time, np.zeros_like(time), *start)
    noisy = angle + noise * np.random.default_rng(1).standard_normal(time.size)
    begun = Log(time, np.zeros_like(time), noisy).initial_state
    assert begun.angle == pytest.approx(start[0], abs=2 * noise + 1e-3)
    assert begun.velocity == pytest.approx(start[1], abs=60 * noise + 0.02)
    assert (begun.velocity == 0) is (phase == 0)


@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_a_log_in_the_steady_swing_of_its_sine_begins_where_that_is(noise):
    """Friction included; to a hundredth of the largest speed, or less."""
    omega, time = 4.0, 0.004 * np.arange(10_000)
    angle, velocity = motion(JOINT, time, 0.02 * np.sin(omega * time), 0.0, 0.0)
    noisy = angle + noise * np.random.default_rng(0).standard_normal(time.size)
    for first in (7000, 7100, 7250):  # any phase of the swing
        inputs = 0.02 * np.sin(omega * time[first:])
        sine = Sine(omega=omega, amplitude=0.02)
        log = Log(time[first:], inputs, noisy[first:], excitation=sine)
        begun = log.initial_state
        assert begun.angle == pytest.approx(angle[first], abs=0.005 * np.ptp(angle[first:]))
        assert begun.velocity == pytest.approx(velocity[first], abs=0.01 * np.ptp(velocity[first:]))
    at_rest = Log(time, 0.02 * np.sin(omega * time), noisy, excitation=sine)
    assert at_rest.initial_state == (pytest.approx(angle[0], abs=2 * noise + 1e-5), 0.0)


def test_a_piece_begins_in_motion_however_slow_and_knows_what_was_commanded_before():
    log = _log(0.2, 0.0, 0.0)
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
