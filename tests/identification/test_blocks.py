"""Logs are divided alike for whatever takes a part of them."""

from dataclasses import replace

import numpy as np
import pytest

from butterfly.identification.blocks import (
    CELLS,
    cells_of,
    edges_of,
    independent_cells_of,
    length_of,
)


def test_a_log_has_ten_cells_and_few_logs_two_for_each_parameter():
    assert [cells_of(logs, 9) for logs in (1, 2, 5)] == [18, CELLS, CELLS]
    assert [independent_cells_of(logs, 9) for logs in (1, 3, 4)] == [18, CELLS, 1]


def test_blocks_are_as_long_as_each_other_whatever_the_clock():
    time = np.concatenate([np.arange(0, 5, 0.001), np.arange(5, 10, 0.005)])
    edges = edges_of(time, 5)
    np.testing.assert_allclose(time[edges], [0, 2, 4, 6, 8], atol=0.01)
    assert edges_of(time[:3], 5) == []
    assert edges_of(time[:25], 5) == [0]


def test_a_block_of_a_sine_holds_whole_periods(sine_log):
    assert length_of(sine_log) == pytest.approx(4 * 2 * np.pi / 5)
    assert length_of(replace(sine_log, excitation=None)) == pytest.approx(4.0, rel=1e-3)
