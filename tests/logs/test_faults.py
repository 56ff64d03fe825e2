"""What clocks, amplifiers and encoders do wrong, told from all that is none of it."""

import math
from dataclasses import replace
from functools import cache
from itertools import combinations, pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter

from butterfly.campaigns.bench import STILL, Relay
from butterfly.logs import faults
from butterfly.model.greybox import simulate
from butterfly.model.parameters import LumpedParameters
from butterfly.plant.motor import Reading

REGULAR = np.arange(10_000) * 1e-3


def _dropped(stamps):
    return np.flatnonzero(~faults.increasing(np.asarray(stamps, dtype=np.float64))).tolist()


def _most(stamps):
    """Length of the longest strictly increasing subsequence, by trying all."""
    subsets = (rows for size in range(len(stamps), 0, -1) for rows in combinations(stamps, size))
    return next(len(rows) for rows in subsets if all(a < b for a, b in pairwise(rows)))


@given(st.lists(st.integers(0, 6), min_size=1, max_size=7))
def test_as_few_samples_are_dropped_as_can_be(stamps):
    time = np.array(stamps, dtype=np.float64)
    kept = faults.increasing(time)
    assert np.all(np.diff(time[kept]) > 0)
    assert np.count_nonzero(kept) == _most(stamps)
    assert not np.any(kept & faults.repeated(time, kept))


@given(st.lists(st.integers(1, 1_998), min_size=1, max_size=8, unique=True), st.booleans())
def test_glitches_cost_no_more_samples_than_themselves(rows, forward):
    time = REGULAR[:2_000].copy()
    time[rows] += 1e6 if forward else -1e6
    assert len(_dropped(time)) <= len(rows)


def test_of_two_that_changed_places_the_one_that_falls_behind_goes_and_of_equal_ones_the_later():
    assert _dropped([0, 1, 2, 4, 3, 5, 6]) == [4]
    time = np.array([0.0, 1.0, 1.0, 1.0, 2.0, 1.0, 3.0])
    kept = faults.increasing(time)
    assert _dropped(time) == [2, 3, 5]
    assert np.flatnonzero(faults.repeated(time, kept)).tolist() == [2, 3]


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("before", "after"), [(800, 1200), (1200, 800), (1000, 1001), (30, 900)])
def test_a_clock_that_starts_again_leaves_its_longer_side_whole(before, after, seed):
    rng = np.random.default_rng(seed)
    sides = [np.cumsum(1e-3 + 1e-4 * rng.standard_normal(n)) for n in (before, after)]
    kept = faults.increasing(np.concatenate(sides))
    assert np.all(kept[before:] == (after > before))
    assert np.all(kept[:before] == (before > after))


def test_of_a_clock_that_starts_again_and_again_the_longest_part_stays_but_for_its_glitches():
    parts = [REGULAR[:3000], REGULAR[:4000].copy(), REGULAR[:2000]]
    parts[1][500] += 1e3
    assert _dropped(np.concatenate(parts)) == [*range(3000), 3500, *range(7000, 9000)]
    time = np.tile(np.arange(20.0), 500)
    assert 20 <= np.count_nonzero(faults.increasing(time)) < 40


def test_a_clock_set_back_a_little_keeps_what_goes_on_increasing():
    time = np.concatenate([REGULAR, REGULAR + 9.0])
    assert np.count_nonzero(faults.increasing(time)) == 19_000


def test_a_stamp_that_is_late_by_itself_is_no_restart():
    late = REGULAR[:400].copy()
    late[100] += 0.05
    assert faults.restarts(late) == []
    assert faults.restarts(np.concatenate([late, REGULAR])) == [400]


TIME = np.arange(20_000) * 1e-3
HAND = LumpedParameters(p1=0.00325, p2=0.00145, p3=0.04905, p4=0.025, coulomb=3e-4)
STEPS = [0.0, 6e-6, 1.9e-4, 2e-3]
"""Encoder steps in rad; 0 reads exact angles."""


@cache
def _swing(omega, amplitude, coulomb, stribeck, *, switched=False):
    """Angles in rad of a hand that sticks at its turning points for a while."""
    hand = replace(HAND, coulomb=coulomb, stribeck=stribeck * coulomb, stribeck_velocity=0.05)
    stiffness = abs(complex(hand.p3 - hand.p1 * omega**2, hand.p2 * omega))
    torque = stiffness * amplitude + 1.3 * (1 + stribeck) * coulomb
    wave = np.sin(omega * TIME)
    inputs = torque / hand.p4 * (0.7 * np.sign(wave) if switched else wave)
    angle, _ = simulate(hand, TIME, np.column_stack([inputs] * 3), 0.0)
    return angle


def _read(angle, step, noise, seed=0):
    noisy = angle + noise * np.random.default_rng(seed).standard_normal(angle.size)
    return noisy if step == 0 else np.round(noisy / step) * step


@pytest.mark.parametrize("switched", [False, True])
@pytest.mark.parametrize("stribeck", [0.0, 1.0])
@pytest.mark.parametrize("coulomb", [3e-4, 8e-3])
@pytest.mark.parametrize("omega", [1.0, 4.0, 16.0])
def test_a_joint_that_sticks_where_it_turns_is_not_clipped(omega, coulomb, stribeck, switched):
    for amplitude in (0.3, 0.8):
        angle = _swing(omega, amplitude, coulomb, stribeck, switched=switched)
        for step in STEPS:
            for noise in (0.0, 2e-4):
                read = _read(angle, step, noise)
                assert np.ptp(read) == 0 or faults.clipped(read) == 0, (amplitude, step, noise)


@pytest.mark.parametrize("coulomb", [0.0, 3e-3])
@pytest.mark.parametrize("omega", [1.0, 4.0, 16.0])
def test_a_swing_cut_off_is_counted(omega, coulomb):
    angle = _swing(omega, 0.5, coulomb, 0.0)
    top = 0.7 * np.abs(angle[10_000:]).max()
    for step in STEPS:
        level = top if step == 0 else np.round(top / step) * step
        for noise in (0.0, 2e-4):
            read = np.clip(_read(angle, step, noise), -level, level)
            assert faults.clipped(read) > 0.85 * np.count_nonzero(np.abs(read) == level), (
                step,
                noise,
            )


@given(
    omega=st.floats(0.5, 20),
    amplitude=st.floats(0.02, 1.5),
    phase=st.floats(0, 6.3),
    step=st.floats(1e-6, 1e-3),
    noise=st.sampled_from([0.0, 1e-5, 3e-4]),
)
def test_a_smooth_swing_is_not_clipped_however_coarse_its_encoder(
    omega, amplitude, phase, step, noise
):
    assert faults.clipped(_read(amplitude * np.sin(omega * TIME + phase), step, noise)) == 0


def test_a_joint_that_leaves_its_stop_abruptly_is_judged_by_how_it_came():
    """It comes to rest like a ball thrown up, holds, and falls off in a straight line."""
    rise = 0.1 - 2.0 * (TIME[:300][::-1]) ** 2
    angle = np.concatenate([rise, np.full(500, 0.1), 0.1 - 1.5 * TIME[1:120]])
    angle = np.round(np.tile(angle, 5) / 1.9e-4) * 1.9e-4
    assert faults.clipped(angle) == 0
    assert faults.clipped(angle[::-1]) == 0


def test_a_triangle_cut_off_on_one_side_is_counted_there():
    triangle = np.abs((3 * TIME) % 2 - 1)
    cut = np.maximum(triangle, 0.2)
    inside = (cut == 0.2) & (TIME > 0.5) & (TIME < 19.5)
    assert faults.clipped(cut) >= np.count_nonzero(inside)


def _saturated(values, time=None):
    return faults.saturated(values, TIME[: values.size] if time is None else time)


def test_an_input_on_its_limit_is_saturated_and_a_constant_or_switched_one_is_not():
    assert _saturated(np.zeros(100)) == 0
    assert _saturated(np.sign(np.sin(TIME + 0.1))) == 0
    for low, high in ((-2.0, 0.9), (-0.75, 0.75)):
        values = np.clip(np.sin(3 * TIME), low, high)
        assert _saturated(values) == np.count_nonzero((values == low) | (values == high))


def _rounded(rng, top=np.inf):
    """Return a random sine that a drive cuts off at a share of its amplitude, and rounds."""
    time = np.arange(0, 20, 10 ** rng.uniform(-3, -2))
    amplitude = 10 ** rng.uniform(-2.3, 0.5)
    wave = np.sin(10 ** rng.uniform(0, 1.3) * time + rng.uniform(0, 2 * np.pi))
    step = 1e-3 if np.isinf(top) else rng.choice([1e-3, 1e-4]) * amplitude
    values = step * np.round(amplitude * np.clip(wave, -top, top) / step + rng.uniform(-1, 1))
    return values, time


@pytest.mark.parametrize("seed", range(20))
def test_a_sine_that_is_rounded_is_not_saturated_and_one_that_is_cut_off_is(seed):
    rng = np.random.default_rng(seed)
    assert _saturated(*_rounded(rng)) == 0
    assert _saturated(*_rounded(rng, top=rng.uniform(0.5, 0.9))) > 0


def _noise():
    noise = np.random.default_rng(0).standard_normal(TIME.size)
    smooth = np.convolve(noise, np.hanning(200), "same")
    return smooth / np.abs(smooth).max()


VARYING = {
    "sine": np.sin(5 * TIME + 0.2),
    "chirp": np.sin(TIME * (1 + TIME / 2)),
    "multisine": sum(np.sin(1.3 * k * TIME + k * k) for k in (1, 2, 3, 5, 8)) / 4.2,
    "noise": _noise(),
}


@pytest.mark.parametrize("step", [0.0, 1e-4, 1e-3])
@pytest.mark.parametrize("wave", VARYING)
def test_what_is_cut_off_on_one_side_or_both_is_saturated_there(wave, step):
    for low, high in ((-0.5, 0.5), (-np.inf, 0.4), (-0.6, np.inf)):
        values = np.clip(VARYING[wave], low, high)
        values = np.round(values / step) * step if step else values
        on_limit = np.count_nonzero((values == values.min()) | (values == values.max()))
        assert 0.9 * on_limit < _saturated(values) <= on_limit, (low, high)


@pytest.mark.parametrize("wave", VARYING)
def test_what_stays_within_its_limits_is_not_saturated(wave):
    for step in (0.0, 1e-3, 1e-2):
        values = VARYING[wave]
        assert _saturated(np.round(values / step) * step if step else values) == 0


def _slewed(levels, rate):
    """Return an input that follows levels at a largest rate per sample."""
    followed, value = np.empty(levels.size), 0.0
    for k, level in enumerate(levels):
        value += np.clip(level - value, -rate, rate)
        followed[k] = value
    return followed


def _switched():
    rng = np.random.default_rng(0)
    square = np.sign(np.sin(3 * TIME + 0.1))
    return {
        "square": square,
        "two-level noise": np.repeat(rng.choice([-1.0, 1.0], 100), 200),
        "steps": np.repeat(rng.choice([-1.0, -0.5, 0.0, 0.3, 0.5, 1.0], 50), 400),
        "relay that ends": np.where((TIME > 1) & (TIME < 15), square, 0.0),
        "relay that grows": np.where(TIME < 4, 0.6 * square, square),
    }


@pytest.mark.parametrize("rate", [2.0, 0.7, 0.4, 0.1, 0.02])
@pytest.mark.parametrize("levels", _switched())
def test_levels_that_an_input_is_switched_between_are_not_saturated_however_it_gets_there(
    levels, rate
):
    ramps = _slewed(_switched()[levels], rate)
    stamps = np.cumsum(1e-3 * (1 + 0.05 * np.random.default_rng(1).standard_normal(TIME.size)))
    for step in (0.0, 1e-3, 1e-2):
        values = np.round(ramps / step) * step if step else ramps
        assert _saturated(values) == 0, step
        assert _saturated(values, stamps) == 0, step


@pytest.mark.parametrize("step", [0.0, 1e-4, 1e-3, 1e-2])
def test_a_square_behind_a_lag_is_not_saturated(step):
    square = np.sign(np.sin(3 * TIME + 0.1))
    for share in (0.02, 0.05, 0.2):
        values = lfilter([share], [1, share - 1], square)
        assert _saturated(np.round(values / step) * step if step else values) == 0, share


def test_the_relay_of_a_campaign_is_not_saturated():
    relay, readings = Relay(0.0, 0.18, 1.2, 5.0, 7.0), []
    for time in TIME[:10_000:2]:
        angle = 0.2 * math.sin(6 * (time - STILL)) if time > STILL else 0.0
        readings.append(relay(Reading(time, angle, 0.0)))
    values = np.round(readings, 2)
    assert np.count_nonzero(np.abs(values) == values.max()) > 1_000
    assert _saturated(values, TIME[:10_000:2]) == 0


def test_levels_held_in_turn_are_not_saturated():
    rng = np.random.default_rng(0)
    for count in range(3, 30):
        levels = rng.choice([-1.0, -0.5, 0.0, 0.3, 0.5, 1.0], size=count)
        assert _saturated(np.repeat(levels, 200)) == 0


LONG = np.arange(3000) * 5e-3
NO_GAPS = np.zeros(LONG.size - 1, dtype=bool)
TURN = 2 * np.pi
MOTIONS = {
    "spin": 12 * LONG,
    "fast spin": 200 * LONG,
    "pendulum about the border": np.pi + 0.3 * np.sin(4 * LONG),
    "several turns": 8 * np.sin(0.7 * LONG) + 0.3 * np.sin(9 * LONG),
    "once over": 3.3 * (1 - np.exp(-np.maximum(LONG - 5, 0))),
}


def _wrapped(angle, turn, low):
    return (angle - low) % turn + low


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("noise", [0.0, 0.02])
@pytest.mark.parametrize("step", [0.0, TURN / 100])
@pytest.mark.parametrize(("turn", "low"), [(TURN, -np.pi), (TURN, 0.0), (16 * TURN, -0.5)])
def test_a_wrapped_angle_is_made_whole_again(motion, noise, step, turn, low):
    angle = _read(MOTIONS[motion], step, noise)
    wrapped = _wrapped(angle, turn, low)
    assert faults.find_wrapping(angle, NO_GAPS) is None
    found = faults.find_wrapping(wrapped, NO_GAPS)
    if np.max(np.abs(wrapped - angle)) < 1e-9:
        assert found is None
        return
    assert (found.turn, found.exact) == (pytest.approx(turn), True)
    whole = faults.unwrapped(wrapped, found)
    np.testing.assert_allclose(whole - whole[0], angle - angle[0], atol=1e-8)


def test_an_encoder_before_a_gear_wraps_at_a_share_of_the_turn():
    angle = 2.5 * np.sin(3 * LONG)
    found = faults.find_wrapping(_wrapped(angle, TURN / 7, 0.0), NO_GAPS)
    assert (found.turn, found.exact) == (pytest.approx(TURN / 7), True)
    odd = faults.find_wrapping(_wrapped(angle, TURN / 7.3, 0.0), NO_GAPS)
    assert (odd.turn, odd.exact) == (pytest.approx(TURN / 7.3, rel=0.01), False)


@settings(max_examples=50)
@given(
    size=st.floats(1.0, 300.0),
    omega=st.floats(0.5, 600.0),
    rows=st.lists(st.integers(1, 2998), min_size=0, max_size=4, unique=True),
    spike=st.floats(10.0, 100.0),
)
def test_fast_motion_and_outliers_are_no_wrapping(size, omega, rows, spike):
    angle = size * np.sin(omega * LONG)
    if rows:
        angle = np.sin(3 * LONG)
        angle[rows] += spike
    assert faults.find_wrapping(angle, NO_GAPS) is None


def test_what_happens_in_a_gap_is_no_jump():
    angle = np.where(LONG < 5, 0.0, TURN) + 0.1 * np.sin(3 * LONG)
    assert faults.find_wrapping(angle, np.diff(angle) > 5) is None
    assert faults.find_wrapping(angle, NO_GAPS) is not None


@pytest.mark.parametrize("scale", [1e-300, 1.0, 1e305])
def test_stamps_of_any_size_are_looked_at_for_lost_separators(scale):
    time = np.concatenate([np.arange(990.0, 1000.0), 1 + np.arange(10.0) / 1000])
    assert faults.cut_by_thousand(time / 1000 * scale) == 10
    assert faults.cut_by_thousand(1.7e308 * np.array([-1, 0.5, 1.0, 0.9, 0.95, -1.0, 1.0])) is None
