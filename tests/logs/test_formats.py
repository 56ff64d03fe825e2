"""Logs in files of every format: what was written is read, in little more than its own memory."""

import itertools
import threading
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from butterfly.errors import InputError
from butterfly.files import write_file
from butterfly.logs.csv import write_csv
from butterfly.logs.formats import ENDINGS, FORMATS, log_of_table, read_log
from butterfly.logs.health import examine, thinned
from butterfly.logs.log import InputKind, Log
from butterfly.logs.mat import write_mat
from butterfly.logs.parquet import parquet_bytes
from tests.logs.said_table import written

KIND = {"input_kind": InputKind.TORQUE}
WRITERS = {
    "mat": write_mat,
    "csv": write_csv,
    "parquet": lambda log, path: path.write_bytes(parquet_bytes(log)),
}


def write_log(log, path):
    """Write a file in the format of its ending."""
    WRITERS[FORMATS[path.suffix.lower()]](log, path)


KINDS = [".mat", ".csv", ".parquet", ".tsv"]  # that tests write; .txt and .dat are read as .csv is


@pytest.mark.parametrize("ending", KINDS)
@settings(max_examples=25)
@given(
    columns=arrays(np.float64, st.tuples(st.sampled_from([3, 4]), st.integers(16, 40))),
    whole=st.booleans(),
)
def test_any_numbers_are_read_back_bit_for_bit(tmp_path_factory, ending, columns, whole):
    columns = np.where(np.isnan(columns), 0.0, columns)  # the bits of a NaN are nobody's promise
    columns[:, 0] = np.where(np.isfinite(columns[:, 0]), columns[:, 0], 0.0)  # a text has numbers
    columns = np.round(columns) if whole else columns
    log = Log(**dict(zip(("time", "input", "angle", "velocity"), columns, strict=False)), **KIND)
    path = tmp_path_factory.mktemp("formats") / f"log{ending}"
    write_log(log, path)
    read = read_log(path, **KIND)
    assert read.columns().keys() == log.columns().keys()
    for name, column in log.columns().items():
        assert getattr(read, name).tobytes() == column.tobytes()
    assert [each.name for each in path.parent.iterdir()] == [path.name]


@pytest.mark.parametrize("ending", KINDS)
def test_a_log_is_named_by_its_file_whatever_the_case_and_what_is_missing_stays_so(
    tmp_path, sine_log, ending
):
    log, path = sine_log.take(np.arange(100)), tmp_path / f"log{ending.upper()}"
    log.angle[[3, 7]] = np.nan
    write_log(log, path)
    read = read_log(path, **KIND)
    assert (read.name, read.source) == (path.name, str(path))
    np.testing.assert_array_equal(read.angle, log.angle)
    assert read_log(path, name="mine", **KIND).name == "mine"


@pytest.mark.parametrize("form", ["mat", "json", "parquet", "csv", "tsv"])
@pytest.mark.parametrize("lacking", ["angle", "input", "angle and input"])
def test_a_velocity_stands_for_the_angle_and_none_for_the_input(tmp_path, sine_log, form, lacking):
    log = sine_log.take(np.arange(100))
    log = replace(log, velocity=log.input + 1.0)
    columns = {name: each for name, each in log.columns().items() if name not in lacking}
    about = KIND | ({"input_kind": "none"} if "input" in lacking else {})
    path, names = written(tmp_path, (form, "no unit"), columns, {})
    read = read_log(path, names if form == "mat" else None, **about)
    assert read.integrated is ("angle" in lacking)
    assert read.input_kind == about["input_kind"]
    for name, values in columns.items():
        np.testing.assert_array_equal(getattr(read, name), values)
    np.testing.assert_array_equal(read.input, columns.get("input", 0 * log.time))
    assert log_of_table(columns, **about).measured.tobytes() == read.measured.tobytes()


def test_a_map_says_where_input_and_angle_stand(sine_log):
    for name, said in (("input", "nothing; .*input: none in"), ("angle", "nothing")):
        columns = {each: each for each in ("time", "input", "angle") if each != name}
        with pytest.raises(InputError, match=f"columns.{name}: got {said}"):
            log_of_table(sine_log.columns(), columns)


def test_a_velocity_is_not_taken_for_what_another_column_may_be(sine_log):
    table = {"time": sine_log.time, "input": sine_log.input, "velocity": sine_log.angle}
    assert log_of_table(table).integrated
    with pytest.raises(InputError, match=r"angle: got no such column; .* velocity=W instead"):
        log_of_table(table | {"position": sine_log.angle})
    assert log_of_table(table | {"position": sine_log.angle}, {k: k for k in table}).integrated


def test_a_velocity_alone_is_not_written_where_it_would_be_read_as_an_angle(tmp_path, sine_log):
    speed = Log(sine_log.time, sine_log.input, velocity=sine_log.angle)
    with pytest.raises(InputError, match="angle: got only a velocity"):
        write_log(speed, tmp_path / "log.mat")


@pytest.mark.parametrize(("name", "value"), [("log.xls", ".xls"), ("log", "no ending")])
def test_another_ending_is_refused_with_those_that_are_known(tmp_path, name, value):
    own = ".mat, .csv, .parquet, .tsv, .txt, .dat, .json, .jsonl, .ndjson, .mcap"
    assert f"{own}, .npz, .npy, .xlsx or .xlsm" == ENDINGS
    with pytest.raises(InputError, match=f"got {value}; expected {ENDINGS}"):
        read_log(tmp_path / name, **KIND)


SAMPLES = 200_000
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


@pytest.mark.parametrize("how", ["replaced", "written over"])
@pytest.mark.parametrize("ending", [".csv", ".mat", ".parquet"])
def test_a_file_that_changes_while_it_is_read_is_one_of_both_or_a_line(tmp_path, ending, how):
    contents = []
    path, over = tmp_path / f"log{ending}", threading.Event()
    for size in (400, 20_000):
        write_log(Log(np.arange(size) * 1e-3, np.full(size, size), np.full(size, size)), path)
        contents.append(path.read_bytes())
        path.unlink()
    path.write_bytes(contents[0])

    def change():
        for turn, content in enumerate(itertools.cycle(contents)):
            if how == "replaced":
                write_file(path, content, internal=True)
            else:
                path.write_bytes(content)
            if over.wait(0.002 * 1.1**turn):  # slower and slower, so that any machine reads one
                break

    changing = threading.Thread(target=change)
    changing.start()
    refused = 0
    try:
        for _ in range(25):
            try:
                log = read_log(path, **KIND)
            except InputError:
                refused += 1
            else:
                assert log.time.size in {400, 20_000}
                assert set(log.input) == set(log.angle) == {float(log.time.size)}
    finally:
        over.set()
        changing.join()
    assert refused < 25 or how == "written over"
