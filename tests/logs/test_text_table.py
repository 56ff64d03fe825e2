"""Tables in texts of any delimiter, encoding and layout."""

import tracemalloc

import numpy as np
import pyarrow
import pytest

from butterfly.errors import InputError
from butterfly.logs.formats import read_log
from butterfly.logs.text_table import read_text_table
from tests.logs.text_lines import (
    FIRST_THREE,
    HEAD,
    KIND,
    NAMES,
    ROWS,
    assert_table,
    read_lines,
    texts,
)


@pytest.mark.parametrize(
    "ending", ["0.23", "0.23,1.0", "0.23,1.0,-", "0.23,1.0,1.5e-", "0.", "0.23,1.0,1", "0.23,1,1.5"]
)
def test_a_last_line_that_was_cut_off_is_dropped_and_counted_and_no_whole_one(tmp_path, ending):
    path = tmp_path / "log.csv"
    path.write_text("\n".join([HEAD, *texts()[:-1], ending]))
    log = read_log(path, **KIND)
    assert (log.time.size, log.reading.cut_lines) == (23, 1)
    assert_table(log)
    path.write_text(path.read_text().replace(",", ";"))
    assert read_log(path, **KIND).time.size == 23
    for end in ("\n", "\r\n", "\n# stopped by hand"):
        path.write_bytes("\n".join([HEAD, *texts()]).encode() + end.encode())
        log = read_log(path, **KIND)
        assert (log.time.size, log.reading.cut_lines) == (24, 0)


def test_a_text_that_no_memory_holds_is_refused_before_it_is_read(tmp_path, monkeypatch):
    path = tmp_path / "table.txt"
    path.write_text("1 2 3\n" * 1000)
    monkeypatch.setattr("butterfly.errors.memory", lambda: 16 * 6000 - 1)
    with pytest.raises(InputError, match=r"6\.0 kB of text; .* it needs 96\.0 kB"):
        read_text_table(path)
    monkeypatch.setattr("butterfly.errors.memory", lambda: 16 * 6000)
    assert len(read_text_table(path).columns) == 3


R_ROWS = [f'"{k + 1}",{line}' for k, line in enumerate(texts())]
PANDAS_ROWS = [f"{k},{line}" for k, line in enumerate(texts())]
NAMED_ROWS = ("row names in the first column",)
TURNED = [",".join([*line.split(",")[::-1], "x"]) for line in texts()]
OTHER_NAMES = {"time": "t_s", "input": "volts", "angle": "angle_rad"}
STATED = [f"2024-01-05 10:00;{line};OK" for line in texts(";", ",")]
LAID_OUT = {  # lines, what is told of them, the columns that are asked for
    "numpy's commented header": (
        ["# bench 2", "# time input angle", *texts(" ")],
        ("blanks between columns", "comment lines: 2"),
        None,
    ),
    "lines above the header": (
        ["Bench 2", "by: me", "time;input;angle", *ROWS],
        ("semicolons between columns", "lines above the table: 2"),
        None,
    ),
    "columns by number": (texts(), None, FIRST_THREE | {"input": "1"}),
    "columns by number below a header": ([HEAD, *texts()], (), FIRST_THREE | {"input": "1"}),
    "any order": (["angle_rad,volts,t_s,extra", *TURNED], None, OTHER_NAMES),
    "texts in other columns": (["date;time;input;angle;state", *STATED], None, None),
    "R": ([HEAD, *R_ROWS], NAMED_ROWS, None),
    "R, blanks": ([" ".join(NAMES), *(each.replace(",", " ") for each in R_ROWS)], None, None),
    "texts as row names": ([HEAD, *(f"run {each}" for each in PANDAS_ROWS)], NAMED_ROWS, None),
    "pandas": ([",".join(["", *NAMES]), *PANDAS_ROWS], (), None),
    "a comma behind the header": ([",".join([*NAMES, ""]), *texts()], (), None),
    "two commas behind the header": ([",".join([*NAMES, "", ""]), *texts()], (), None),
    "a comma behind the rows": ([HEAD, *(f"{line}," for line in texts())], (), None),
    "R, units": ([HEAD, "s,V,rad", *R_ROWS], None, None),
    "a comma behind the rows, units": (
        [HEAD, "s,V,rad", *(f"{line}," for line in texts())],
        (),
        None,
    ),
}


@pytest.mark.parametrize("how", LAID_OUT)
def test_however_the_lines_are_laid_out_the_columns_are_found(tmp_path, how):
    lines, layout, columns = LAID_OUT[how]
    log = read_lines(tmp_path, lines, columns)
    assert_table(log)
    assert layout is None or log.reading.layout == layout


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be"])
def test_two_bytes_to_a_letter_are_read_in_either_order_with_and_without_a_mark(tmp_path, encoding):
    log = read_lines(tmp_path, [HEAD, *texts()], encoding=encoding)
    assert_table(log)
    assert log.reading.layout == ("UTF-16",)


@pytest.mark.parametrize("row", ["nan;nan;nan", "0.0;nan;nan", "NaN;;"])
@pytest.mark.parametrize("header", ["% time;input;angle", "time;input;angle"])
def test_a_first_row_whose_numbers_are_missing_is_no_header(tmp_path, header, row):
    log = read_lines(tmp_path, [header, row, *texts(";")])
    assert log.time.size == 25
    assert np.isnan(log.angle[0])
    with pytest.raises(InputError, match="line 2: got 2 values; expected 3"):
        read_lines(tmp_path, [header, "nan;", *texts(";")], FIRST_THREE)


@pytest.mark.parametrize("delimiter", [",", " "])
@pytest.mark.parametrize("line", [1, 2, 40])
def test_a_line_of_more_columns_than_anybody_logs_is_refused_in_little_memory(
    tmp_path, delimiter, line
):
    lines = [delimiter.join(NAMES), *texts(delimiter), *texts(delimiter)]
    lines[line - 1] = delimiter.join(["1.5"] * 100_000)
    before = pyarrow.default_memory_pool().bytes_allocated()  # of other tests' logs
    tracemalloc.start()
    try:
        with pytest.raises(
            InputError, match=rf"line {line}: got \d+ cells; expected at most 10000"
        ):
            read_lines(tmp_path, lines)
        assert tracemalloc.get_traced_memory()[1] < 15e6
    finally:
        tracemalloc.stop()
    assert pyarrow.default_memory_pool().bytes_allocated() - before < 1e6


def test_a_header_and_a_row_without_its_end_are_no_log(tmp_path):
    path = tmp_path / "log.txt"
    path.write_text("# a\ntime [s]\tinput [V]\tangle [rad]\n0.00\t0.0000")
    with pytest.raises(InputError, match=r"time: got 1 samples|header: got"):
        read_log(path)
