"""Scaling of arrays, and their division into blocks."""

import math

import numpy as np
import pytest

from butterfly.arrays import (
    BLOCK,
    blocks,
    joined,
    read_only,
    standard_error,
    unit_columns,
    unit_diagonal,
)

RNG = np.random.default_rng(0)


def test_columns_have_length_1_and_those_of_0_stay():
    rows = RNG.normal(size=(7, 3)) * [1e-6, 0.0, 1e6]
    scaled, size = unit_columns(rows)
    assert size[1] == 1.0
    np.testing.assert_allclose((scaled**2).sum(axis=0), [1, 0, 1])
    np.testing.assert_allclose(scaled * size, rows)


def test_of_a_covariance_the_correlations_remain_whatever_the_stack():
    samples = RNG.normal(size=(2, 50, 3)) @ RNG.normal(size=(3, 3)) * [1e-3, 1.0, 1e3]
    matrices = np.array([np.cov(each.T) for each in samples])
    scaled, size = unit_diagonal(matrices)
    np.testing.assert_allclose(scaled, [np.corrcoef(each.T) for each in samples])
    np.testing.assert_allclose(size, samples.std(axis=1, ddof=1))


def test_a_parameter_without_variance_divides_by_1():
    scaled, size = unit_diagonal(np.diag([4.0, 0.0, -1e-20]))
    np.testing.assert_array_equal(size, [2, 1, 1])
    np.testing.assert_array_equal(np.diag(scaled), [1, 0, -1e-20])


def test_the_mean_of_n_values_errs_by_a_root_of_n_less_and_one_value_tells_nothing():
    values = np.array([1.0, 2.0, 3.0, 6.0])
    variance = (4 + 1 + 0 + 9) / 3  # about their mean of 3
    assert standard_error(values) == pytest.approx(math.sqrt(variance / 4))
    assert standard_error(values[:1]) == math.inf


@pytest.mark.parametrize("count", [0, 1, BLOCK - 1, BLOCK, BLOCK + 1, 3 * BLOCK + 5])
def test_blocks_cover_each_row_once_in_their_order(count):
    rows = np.arange(count)
    parts = [rows[part] for part in blocks(count)]
    assert [*map(int, np.concatenate([[], *parts]))] == rows.tolist()
    assert all(0 < part.size <= BLOCK for part in parts)


def test_a_single_part_is_joined_without_a_copy():
    part = np.arange(3)
    assert joined([part]) is part
    np.testing.assert_array_equal(joined([part, part + 3]), np.arange(6))


@pytest.mark.parametrize("numbers", [RNG.normal(size=9), RNG.normal(size=18)[::2], np.arange(9)])
def test_what_is_read_has_one_layout_the_same_values_and_refuses_to_be_written(numbers):
    seen = read_only(numbers)
    np.testing.assert_array_equal(seen, numbers)
    assert seen.flags.c_contiguous
    assert seen.dtype == np.float64
    with pytest.raises(ValueError, match="read-only"):
        seen[0] = 1.0
    assert numbers.flags.writeable
