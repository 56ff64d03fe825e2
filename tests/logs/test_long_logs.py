"""Long logs are read and checked in little more than their own arrays."""

import tracemalloc

import numpy as np
import pytest

from butterfly.logs.formats import read_log
from butterfly.logs.health import examine
from butterfly.logs.log import Log
from butterfly.logs.thinning import thinned
from tests.logs.test_formats import write_log

SAMPLES = 1_000_000
PER_SAMPLE = 1.35e9 / 36e6
"""Bytes: of an hour at 10 kHz 1.5 GB, of which the program itself takes some."""


@pytest.fixture(scope="module")
def long_log():
    time = np.arange(SAMPLES) * 1e-3
    return Log(time, np.sin(time), np.round(np.sin(time - 1) / 1e-3) * 1e-3)


@pytest.mark.parametrize("ending", ["mat", "csv", "parquet"])
def test_a_long_log_takes_little_more_than_its_arrays(ending, long_log, tmp_path):
    path = tmp_path / f"long.{ending}"
    write_log(long_log, path)
    read_log(path)  # what it imports is no log
    tracemalloc.start()
    try:
        log, _ = examine(read_log(path))
        few = thinned(log, SAMPLES // 10)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert few.time.size == SAMPLES // 10
    own = sum(column.nbytes for column in log.columns().values())
    assert peak - own < PER_SAMPLE * SAMPLES
