from itertools import combinations, pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from butterfly.logs.faults import increasing, repeated

REGULAR = np.arange(10_000) * 1e-3


def _most(stamps):
    """Length of the longest strictly increasing subsequence, by trying all."""
    subsets = (rows for size in range(len(stamps), 0, -1) for rows in combinations(stamps, size))
    return next(len(rows) for rows in subsets if all(a < b for a, b in pairwise(rows)))


@given(st.lists(st.integers(0, 6), min_size=1, max_size=9))
def test_as_few_samples_are_dropped_as_can_be(stamps):
    time = np.array(stamps, dtype=np.float64)
    kept = increasing(time)
    assert np.all(np.diff(time[kept]) > 0)
    assert np.count_nonzero(kept) == _most(stamps)
    assert not np.any(kept & repeated(time, kept))


@given(st.lists(st.integers(1, 9_998), min_size=1, max_size=8, unique=True), st.booleans())
def test_glitches_cost_no_more_samples_than_themselves(rows, forward):
    time = REGULAR.copy()
    time[rows] += 1e6 if forward else -1e6
    assert np.count_nonzero(~increasing(time)) <= len(rows)


@pytest.mark.parametrize(("row", "ahead"), [(100, 1e6), (9_000, 5.0), (1, 1e-2)])
def test_a_single_stamp_far_ahead_is_the_one_that_goes(row, ahead):
    time = REGULAR.copy()
    time[row] += ahead
    assert np.flatnonzero(~increasing(time)).tolist() == [row]


def test_of_two_that_changed_places_the_one_that_falls_behind_goes():
    time = np.arange(20.0)
    time[[7, 8]] = time[[8, 7]]
    assert np.flatnonzero(~increasing(time)).tolist() == [8]


def test_of_equal_stamps_the_first_stays_and_the_others_repeat_it():
    time = np.array([0.0, 1.0, 1.0, 1.0, 2.0, 1.0, 3.0])
    kept = increasing(time)
    assert np.flatnonzero(kept).tolist() == [0, 1, 4, 6]
    assert np.flatnonzero(repeated(time, kept)).tolist() == [2, 3]


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("before", "after"), [(800, 1200), (1200, 800), (1000, 1001), (30, 900)])
def test_a_clock_that_starts_again_leaves_its_longer_side_whole(before, after, seed):
    rng = np.random.default_rng(seed)
    sides = [np.cumsum(1e-3 + 1e-4 * rng.standard_normal(n)) for n in (before, after)]
    kept = increasing(np.concatenate(sides))
    assert np.all(kept[before:] == (after > before))
    assert np.all(kept[:before] == (before > after))


def test_a_clock_that_starts_again_twice_leaves_the_longest_part_but_for_its_glitches():
    parts = [REGULAR[:3000], REGULAR[:4000].copy(), REGULAR[:2000]]
    parts[1][500] += 1e3
    kept = increasing(np.concatenate(parts))
    assert np.flatnonzero(~kept[3000:7000]).tolist() == [500]
    assert not kept[:3000].any()
    assert not kept[7000:].any()


def test_a_clock_set_back_a_little_keeps_what_goes_on_increasing():
    time = np.concatenate([REGULAR, REGULAR + 9.0])
    assert np.count_nonzero(increasing(time)) == 19_000


def test_a_clock_that_only_starts_again_ends():
    time = np.tile(np.arange(20.0), 500)
    assert 20 <= np.count_nonzero(increasing(time)) < 40
