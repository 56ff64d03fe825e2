"""Changes noticed in rows whose truth is known, against Monte Carlo and plain least squares."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from butterfly.errors import InputError
from butterfly.orbit.online import ChangeDetector, false_alarms
from butterfly.orbit.recalibration import SEGMENT

NAMES = ("p2", "p3", "p4", "coulomb")
RATIOS = np.array([0.3, 15.0, 3000.0, 0.12])
SPACING = 0.125  # s between rows
NOISE = 0.01  # of each sample, before it is differenced
LENGTH = SEGMENT * SPACING  # s of a stretch
BEGUN = 90.0  # s, when the robot changes


def rows(rng, duration, *, after=RATIOS, scale=1.0):
    """A swing with a dither, its noise differenced twice, as that of averaged angles."""
    time = SPACING * np.arange(round(duration / SPACING))
    phase = 3.7 * time
    dither = np.sin(np.outer(time, rng.uniform(2, 15, 12)) + rng.uniform(0, 6, 12)).sum(axis=1)
    x = np.column_stack(
        [np.cos(phase), 0.8 * np.sin(phase), -1e-3 * dither, np.tanh(9 * np.cos(phase))]
    )
    x[:, 2] -= 1e-4 * x[:, 0]
    noise = NOISE * np.diff(rng.standard_normal(time.size + 2), 2)
    ratios = np.where(time[:, None] < BEGUN, RATIOS, np.asarray(after) / scale)
    return time, x, np.sum(x * ratios, axis=1) + noise


def watched(time, x, y, **options):
    detector = ChangeDetector(**options)
    for instant, row, left in zip(time.tolist(), x, y, strict=True):
        detector.add(instant, {"p1": -left} | dict(zip(NAMES, row, strict=True)))
    return detector


def changed(name, factor):
    after = np.where(np.array(NAMES) == name, factor * RATIOS, RATIOS)
    return {"after": after, "scale": factor if name == "p1" else 1.0}


@pytest.mark.parametrize(("limit", "window"), [(3.0, 24), (3.0, 8), (3.5, 12)])
def test_the_rate_of_false_alarms_is_that_of_white_noise(limit, window):
    """Largest standardised sum of the latest numbers, from its last alarm on, counted."""
    rng = np.random.default_rng(0)
    walks = np.cumsum(rng.standard_normal((400, 1200)), axis=1)
    walks = np.column_stack([np.zeros(400), walks])
    begun, alarms = np.zeros(400, dtype=int), 0
    for now in range(1, walks.shape[1]):
        largest = np.zeros(400)
        for back in range(1, min(window, now) + 1):
            steps = np.abs(walks[:, now] - walks[:, now - back]) / math.sqrt(back)
            largest = np.where(now - back >= begun, np.maximum(largest, steps), largest)
        begun[largest > limit] = now
        alarms += int(np.count_nonzero(largest > limit))
    assert false_alarms(limit, window) == pytest.approx(alarms / (400 * 1200), rel=0.15)


@pytest.mark.parametrize(
    ("name", "factor"), [("p1", 1.02), ("p2", 1.1), ("p3", 0.98), ("p4", 0.95), ("coulomb", 1.2)]
)
def test_a_change_is_noticed_named_and_sized(name, factor):
    rng = np.random.default_rng(3)
    time, x, y = rows(rng, BEGUN + 45.0, **changed(name, factor))
    (alarm,) = watched(time, x, y).alarms
    assert 0 <= alarm.time - BEGUN <= 4 * LENGTH
    assert alarm.since[0] <= BEGUN <= alarm.since[1]
    found = alarm.causes[0]
    assert [each.name for each in alarm.possible] == [found.name] == [name]
    assert found.after / found.before - 1 == pytest.approx(factor - 1, rel=0.1)


def test_several_ratios_that_change_are_no_parameter_s_and_are_those_of_least_squares():
    rng = np.random.default_rng(4)
    time, x, y = rows(rng, BEGUN + 40.0, after=RATIOS * [0.9, 1.0, 0.95, 1.0])
    (alarm,) = watched(time, x, y).alarms
    assert alarm.possible == ()
    late = time > alarm.since[1] + SPACING / 2
    late &= np.cumsum(late) <= SEGMENT * (np.count_nonzero(late) // SEGMENT)
    expected = np.linalg.lstsq(x[late], y[late], rcond=None)[0]
    np.testing.assert_allclose([each.after for each in alarm.ratios], expected, rtol=1e-6)
    relative = [each.after / each.before - 1 for each in alarm.ratios]
    np.testing.assert_allclose(relative, [-0.1, 0.0, -0.05, 0.0], atol=0.02)


def test_intervals_hold_and_the_true_parameter_is_possible():
    """Of 40 robots; 95 % is 38."""
    inside = possible = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        time, x, y = rows(rng, BEGUN + 30.0, **changed("coulomb", 1.3))
        alarm = watched(time, x, y).alarms[0]
        (found,) = [each for each in alarm.causes if each.name == "coulomb"]
        inside += found.lower <= 1.3 * found.before <= found.upper
        possible += found.possible
    assert inside >= 34
    assert possible >= 34


def test_a_sound_robot_raises_no_more_false_alarms_than_stated():
    """In an hour of a statistic that may alarm every 5 minutes: 12, or fewer (Bonferroni)."""
    alarms = hours = 0
    for seed in range(2):
        detector = watched(*rows(np.random.default_rng(seed), 1900.0), false_alarms_every=300.0)
        alarms += len(detector.alarms)
        hours += len(detector.history) * LENGTH / 3600
    assert 0.85 < hours < 1.05
    assert 1 <= alarms <= 12 + 2 * math.sqrt(12)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.01, 100.0))
def test_units_do_not_matter(seed, unit):
    time, x, y = rows(np.random.default_rng(seed), 100.0)
    plain, other = watched(time, x, y), watched(time, x * [1, unit, 1, 1], y)
    np.testing.assert_allclose(plain.history, other.history, rtol=1e-6)


def test_after_a_change_comes_another_reference_and_another_change():
    rng = np.random.default_rng(5)
    time, x, y = rows(rng, 300.0, **changed("p2", 1.2))
    again = time > 200.0
    y[again] += 0.2 * RATIOS[3] * x[again, 3]
    first, second = watched(time, x, y).alarms
    assert (first.causes[0].name, second.causes[0].name) == ("p2", "coulomb")
    assert second.causes[0].before == pytest.approx(RATIOS[3], rel=0.05)


def test_without_excitation_there_is_no_alarm_and_no_error():
    time, x, _ = rows(np.random.default_rng(6), 120.0)
    x[:, 2] = 0.0
    assert not watched(time, x, x @ RATIOS + 0.01 * np.sin(time)).alarms


@pytest.mark.parametrize(
    ("options", "field"),
    [
        ({"reference": (10.0, 300.0)}, "reference"),
        ({"reference": (90.0, 60.0)}, "reference"),
        ({"window": 0.0}, "window"),
        ({"false_alarms_every": math.inf}, "false_alarms_every"),
    ],
)
def test_options_that_make_no_sense_are_refused(options, field):
    with pytest.raises(InputError, match=field):
        ChangeDetector(**options)
