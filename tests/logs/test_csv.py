"""Text files as people write them."""

import tracemalloc

import numpy as np
import pyarrow
import pytest

from butterfly.errors import InputError
from butterfly.logs.csv import holds_table
from butterfly.logs.formats import read_log
from butterfly.logs.log import InputKind
from butterfly.logs.text_table import read_text_table
from butterfly.logs.units import Units

KIND = {"input_kind": InputKind.VOLTAGE}
NAMES = ("time", "input", "angle")
HEAD = ",".join(NAMES)
FIRST_THREE = {"time": 0, "input": 1, "angle": 2}
TABLE = np.column_stack(
    [np.arange(24) * 0.01, np.sin(np.arange(24.0)), 1e-7 * np.cos(np.arange(24.0))]
)


def _lines(separator=",", decimal="."):
    return [separator.join(repr(v).replace(".", decimal) for v in row) for row in TABLE.tolist()]


ROWS = _lines(";")


def _read(folder, lines, columns=None, encoding="utf-8"):
    path = folder / "log.txt"
    path.write_bytes("\n".join([*lines, ""]).encode(encoding, "surrogateescape"))
    return read_log(path, columns, **KIND)


def _same(log):
    for name, column in zip(NAMES, TABLE.T, strict=True):
        np.testing.assert_array_equal(getattr(log, name), column[: log.time.size])


@pytest.mark.parametrize(
    "ending", ["0.23", "0.23,1.0", "0.23,1.0,-", "0.23,1.0,1.5e-", "0.", "0.23,1.0,1", "0.23,1,1.5"]
)
def test_a_last_line_that_was_cut_off_is_dropped_and_counted_and_no_whole_one(tmp_path, ending):
    path = tmp_path / "log.csv"
    path.write_text("\n".join([HEAD, *_lines()[:-1], ending]))
    log = read_log(path, **KIND)
    assert (log.time.size, log.reading.cut_lines) == (23, 1)
    _same(log)
    path.write_text(path.read_text().replace(",", ";"))
    assert read_log(path, **KIND).time.size == 23
    for end in ("\n", "\r\n", "\n# stopped by hand"):
        path.write_bytes("\n".join([HEAD, *_lines()]).encode() + end.encode())
        log = read_log(path, **KIND)
        assert (log.time.size, log.reading.cut_lines) == (24, 0)


T_U = {"time": "t", "input": "u"}


@pytest.mark.parametrize(
    ("lines", "message", "columns"),
    [
        (_lines(","), r"header: got no line above rows of 3 numbers; .*--columns time=0", None),
        (["t,u,q", *_lines(",", ",")[1:]], r"header: got 't,u,q' above rows of 6 numbers", None),
        (["t,u,q", *_lines(",", ",")], r"line 3: got 6 values; .*decimal commas need", None),
        ([HEAD, *(f"{line},7.5" for line in _lines())], "header: got .* above rows of 4", None),
        ([HEAD, *(f"1,2,{line}" for line in _lines())], "header: got .* above rows of 5", None),
        ([f"{HEAD},x", *_lines()], "header: got 'time,input,angle,x' above rows of 3", None),
        (["time;input;angle", *ROWS[:9], "1;2", *ROWS], r"line 11: got 2 values", None),
        (["time;input;angle", *ROWS, "0.3;oops;1"], r"input: got 'oops' in line 26", None),
        (["time;input;angle", *ROWS, "1.234,5;0;1"], r"time: got '1\.234,5' in line 26", None),
        (["time;time;input;angle", *(f"0;{line}" for line in ROWS)], "2 columns with this", None),
        (["time;input;phi", *ROWS], r"angle: got no such column.*'phi'.*--columns", None),
        (["time;input;angle", "s;V;bar", *ROWS], r"the unit 'bar' of angle.*--units angle=", None),
        (["no numbers", "at all"], "content: got no row of numbers", None),
        (["\0\udcff"], "content: got", None),
        ([], "content: got no row of numbers", None),
        (["times,u,q", *_lines()], "time: got no such column; expected 'times'", None),
        ([HEAD, *_lines(), "1,oops,2"], "input: got 'oops' in line 26", None),
        (["t,u,q", *_lines()], "columns.angle: got nothing", T_U),
        (["t,u,q", *_lines()], "columns.speed: got an unknown", T_U | {"angle": "q", "speed": "x"}),
        (_lines(), "got number 7; expected a number from 0 to 2", FIRST_THREE | {"angle": 7}),
    ],
)
def test_what_cannot_be_read_is_named_with_its_place(tmp_path, lines, message, columns):
    with pytest.raises(InputError, match=message):
        _read(tmp_path, lines, columns)


@pytest.mark.parametrize("cell", ["", "-", "nan"])
def test_a_velocity_without_numbers_that_nobody_asked_for_is_left_out(tmp_path, cell):
    rows = [f"{line},{cell}" for line in _lines()]
    log = _read(tmp_path, [",".join([*NAMES, "velocity"]), *rows])
    assert log.velocity is None
    assert "velocity" in log.reading.layout[-1]
    _same(log)


@pytest.mark.parametrize(
    ("rows", "columns", "holds"), [(16, 3, True), (15, 3, False), (16, 2, False), (0, 3, False)]
)
def test_a_table_that_may_be_a_log_has_samples_of_three_columns(tmp_path, rows, columns, holds):
    path = tmp_path / "table.txt"
    path.write_text("".join(" ".join([f"{k}.5"] * columns) + "\n" for k in range(rows)))
    assert holds_table(path) is holds


def test_a_text_that_no_memory_holds_is_refused_before_it_is_read(tmp_path, monkeypatch):
    path = tmp_path / "table.txt"
    path.write_text("1 2 3\n" * 1000)
    monkeypatch.setattr("butterfly.errors.memory", lambda: 16 * 6000 - 1)
    with pytest.raises(InputError, match=r"6\.0 kB of text; .* it needs 96\.0 kB"):
        read_text_table(path)
    monkeypatch.setattr("butterfly.errors.memory", lambda: 16 * 6000)
    assert len(read_text_table(path).columns) == 3


R_ROWS = [f'"{k + 1}",{line}' for k, line in enumerate(_lines())]
PANDAS_ROWS = [f"{k},{line}" for k, line in enumerate(_lines())]
NAMED_ROWS = ("row names in the first column",)
TURNED = [",".join([*line.split(",")[::-1], "x"]) for line in _lines()]
OTHER_NAMES = {"time": "t_s", "input": "volts", "angle": "angle_rad"}
STATED = [f"2024-01-05 10:00;{line};OK" for line in _lines(";", ",")]
LAID_OUT = {  # lines, what is told of them, the columns that are asked for
    "numpy's commented header": (
        ["# bench 2", "# time input angle", *_lines(" ")],
        ("blanks between columns", "comment lines: 2"),
        None,
    ),
    "lines above the header": (
        ["Bench 2", "by: me", "time;input;angle", *ROWS],
        ("semicolons between columns", "lines above the table: 2"),
        None,
    ),
    "columns by number": (_lines(), None, FIRST_THREE | {"input": "1"}),
    "columns by number below a header": ([HEAD, *_lines()], (), FIRST_THREE | {"input": "1"}),
    "any order": (["angle_rad,volts,t_s,extra", *TURNED], None, OTHER_NAMES),
    "texts in other columns": (["date;time;input;angle;state", *STATED], None, None),
    "R": ([HEAD, *R_ROWS], NAMED_ROWS, None),
    "R, blanks": ([" ".join(NAMES), *(each.replace(",", " ") for each in R_ROWS)], None, None),
    "texts as row names": ([HEAD, *(f"run {each}" for each in PANDAS_ROWS)], NAMED_ROWS, None),
    "pandas": ([",".join(["", *NAMES]), *PANDAS_ROWS], (), None),
    "a comma behind the header": ([",".join([*NAMES, ""]), *_lines()], (), None),
    "two commas behind the header": ([",".join([*NAMES, "", ""]), *_lines()], (), None),
    "a comma behind the rows": ([HEAD, *(f"{line}," for line in _lines())], (), None),
    "R, units": ([HEAD, "s,V,rad", *R_ROWS], None, None),
    "a comma behind the rows, units": (
        [HEAD, "s,V,rad", *(f"{line}," for line in _lines())],
        (),
        None,
    ),
}


@pytest.mark.parametrize("how", LAID_OUT)
def test_however_the_lines_are_laid_out_the_columns_are_found(tmp_path, how):
    lines, layout, columns = LAID_OUT[how]
    log = _read(tmp_path, lines, columns)
    _same(log)
    assert layout is None or log.reading.layout == layout


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be"])
def test_two_bytes_to_a_letter_are_read_in_either_order_with_and_without_a_mark(tmp_path, encoding):
    log = _read(tmp_path, [HEAD, *_lines()], encoding=encoding)
    _same(log)
    assert log.reading.layout == ("UTF-16",)


def test_a_row_with_one_known_unit_is_a_row_of_units(tmp_path):
    lines = [";".join(NAMES), "ms;PWM;ticks", *_lines(";")]
    for columns in (None, FIRST_THREE):
        with pytest.raises(InputError, match="input: got the unit 'PWM'"):
            _read(tmp_path, lines, columns)
    lines[1] = "[PWM];[PWM];[PWM]"
    with pytest.raises(InputError, match="time: got the unit 'PWM'"):
        _read(tmp_path, lines)


@pytest.mark.parametrize("row", ["nan;nan;nan", "0.0;nan;nan", "NaN;;"])
@pytest.mark.parametrize("header", ["% time;input;angle", "time;input;angle"])
def test_a_first_row_whose_numbers_are_missing_is_no_header(tmp_path, header, row):
    log = _read(tmp_path, [header, row, *_lines(";")])
    assert log.time.size == 25
    assert np.isnan(log.angle[0])
    with pytest.raises(InputError, match="line 2: got 2 values; expected 3"):
        _read(tmp_path, [header, "nan;", *_lines(";")], FIRST_THREE)


@pytest.mark.parametrize("delimiter", [",", " "])
@pytest.mark.parametrize("line", [1, 2, 40])
def test_a_line_of_more_columns_than_anybody_logs_is_refused_in_little_memory(
    tmp_path, delimiter, line
):
    lines = [delimiter.join(NAMES), *_lines(delimiter), *_lines(delimiter)]
    lines[line - 1] = delimiter.join(["1.5"] * 100_000)
    before = pyarrow.default_memory_pool().bytes_allocated()  # of other tests' logs
    tracemalloc.start()
    try:
        with pytest.raises(
            InputError, match=rf"line {line}: got \d+ cells; expected at most 10000"
        ):
            _read(tmp_path, lines)
        assert tracemalloc.get_traced_memory()[1] < 15e6
    finally:
        tracemalloc.stop()
    assert pyarrow.default_memory_pool().bytes_allocated() - before < 1e6


def test_a_real_log_of_a_drive_says_its_units_below_its_names(tmp_path):
    head = ["%Date:,29/04/2021", "", "%timestep (8kHz),input,angle,velocity"]
    rows = [f"{k},{line.split(',', 1)[1]},0.5;" for k, line in enumerate(_lines())]
    lines = [*head, "%[#],[V],[turns],[turns/s]", "nan,nan,nan,nan;", *rows]
    columns = FIRST_THREE
    with pytest.raises(InputError, match="the unit '8kHz' of time"):
        _read(tmp_path, lines, columns)
    log = read_log(tmp_path / "log.txt", columns, Units.of({"time": 1.25e-4}), **KIND)
    assert np.isnan(log.time[0])
    np.testing.assert_allclose(log.time[1:], 1.25e-4 * np.arange(24))
    np.testing.assert_allclose(log.angle[1:], 2 * np.pi * TABLE[:, 2])
    assert log.reading.columns["angle"].unit_source == "row of units"


BETWEEN_BLANKS = [["time input angle", "[ms] [V] [deg]"], ["ms V deg", "time input angle"]]
BETWEEN_BLANKS += [["time [ms] input [V] angle [deg]"], ["time[ms] input angle (deg)"]]


@pytest.mark.parametrize("head", [*BETWEEN_BLANKS, ["# time input angle", "# [ms] (V) [deg]"]])
def test_units_between_blanks_are_those_of_their_columns(tmp_path, head):
    for columns in (None, FIRST_THREE):
        log = _read(tmp_path, [*head, *_lines("  ")], columns)
        np.testing.assert_allclose(log.time, TABLE[:, 0] / 1000)
        np.testing.assert_allclose(log.angle, np.radians(TABLE[:, 2]))


@pytest.mark.parametrize("head", ["time [ms],angle [deg]", "# t (ms) angle (deg)"])
def test_units_of_a_line_that_is_no_header_are_not_passed_over(tmp_path, head):
    columns = FIRST_THREE
    rows = [f"{line},1,2" for line in _lines()]
    log = _read(tmp_path, [head, *rows], columns)
    np.testing.assert_allclose(log.time, TABLE[:, 0] / 1000)
    np.testing.assert_allclose(log.angle, np.radians(TABLE[:, 2]))
    with pytest.raises(InputError, match="column 0: got the unit 'ms, column unclear' of time"):
        _read(tmp_path, ["# a (ms) b (deg)", *rows], columns)
    log = read_log(tmp_path / "log.txt", columns, Units.of({"time": "ms", "angle": "deg"}), **KIND)
    np.testing.assert_allclose(log.angle, np.radians(TABLE[:, 2]))
    _same(_read(tmp_path, ["Bench 2 (Tuesday), run (3)", *rows], columns))


def test_a_header_and_a_row_without_its_end_are_no_log(tmp_path):
    path = tmp_path / "log.txt"
    path.write_text("# a\ntime [s]\tinput [V]\tangle [rad]\n0.00\t0.0000")
    with pytest.raises(InputError, match=r"time: got 1 samples|header: got"):
        read_log(path)
