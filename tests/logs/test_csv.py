"""Text files as people write them."""

import numpy as np
import pytest

from butterfly.errors import InputError
from butterfly.logs.csv import holds_table
from butterfly.logs.formats import read_log
from butterfly.logs.units import Units
from tests.logs.text_lines import (
    FIRST_THREE,
    HEAD,
    KIND,
    NAMES,
    ROWS,
    TABLE,
    assert_table,
    read_lines,
    texts,
)

T_U = {"time": "t", "input": "u"}


@pytest.mark.parametrize(
    ("lines", "message", "columns"),
    [
        (texts(","), r"header: got no line above rows of 3 numbers; .*--columns time=0", None),
        (["t,u,q", *texts(",", ",")[1:]], r"header: got 't,u,q' above rows of 6 numbers", None),
        (["t,u,q", *texts(",", ",")], r"line 3: got 6 values; .*decimal commas need", None),
        ([HEAD, *(f"{line},7.5" for line in texts())], "header: got .* above rows of 4", None),
        ([HEAD, *(f"1,2,{line}" for line in texts())], "header: got .* above rows of 5", None),
        ([f"{HEAD},x", *texts()], "header: got 'time,input,angle,x' above rows of 3", None),
        (["time;input;angle", *ROWS[:9], "1;2", *ROWS], r"line 11: got 2 values", None),
        (["time;input;angle", *ROWS, "0.3;oops;1"], r"input: got 'oops' in line 26", None),
        (["time;input;angle", *ROWS, "1.234,5;0;1"], r"time: got '1\.234,5' in line 26", None),
        (["time;time;input;angle", *(f"0;{line}" for line in ROWS)], "2 columns with this", None),
        (["time;input;phi", *ROWS], r"angle: got no such column.*'phi'.*--columns", None),
        (["time;input;angle", "s;V;bar", *ROWS], r"the unit 'bar' of angle.*--units angle=", None),
        (["no numbers", "at all"], "content: got no row of numbers", None),
        (["\0\udcff"], "content: got", None),
        ([], "content: got no row of numbers", None),
        (["times,u,q", *texts()], "time: got no such column; expected 'times'", None),
        ([HEAD, *texts(), "1,oops,2"], "input: got 'oops' in line 26", None),
        (["t,u,q", *texts()], "columns.angle: got nothing", T_U),
        (["t,u,q", *texts()], "columns.input, columns.angle: got nothing", {"time": "t"}),
        (["t,u,q", *texts()], "columns.speed: got an unknown", T_U | {"angle": "q", "speed": "x"}),
        (texts(), "got number 7; expected a number from 0 to 2", FIRST_THREE | {"angle": 7}),
    ],
)
def test_what_cannot_be_read_is_named_with_its_place(tmp_path, lines, message, columns):
    with pytest.raises(InputError, match=message):
        read_lines(tmp_path, lines, columns)


@pytest.mark.parametrize("cell", ["", "-", "nan"])
def test_a_velocity_without_numbers_that_nobody_asked_for_is_left_out(tmp_path, cell):
    rows = [f"{line},{cell}" for line in texts()]
    log = read_lines(tmp_path, [",".join([*NAMES, "velocity"]), *rows])
    assert log.velocity is None
    assert "velocity" in log.reading.layout[-1]
    assert_table(log)


@pytest.mark.parametrize(
    ("rows", "columns", "holds"), [(16, 3, True), (15, 3, False), (16, 2, False), (0, 3, False)]
)
def test_a_table_that_may_be_a_log_has_samples_of_three_columns(tmp_path, rows, columns, holds):
    path = tmp_path / "table.txt"
    path.write_text("".join(" ".join([f"{k}.5"] * columns) + "\n" for k in range(rows)))
    assert holds_table(path) is holds


def test_a_row_with_one_known_unit_is_a_row_of_units(tmp_path):
    lines = [";".join(NAMES), "ms;PWM;ticks", *texts(";")]
    for columns in (None, FIRST_THREE):
        with pytest.raises(InputError, match="input: got the unit 'PWM'"):
            read_lines(tmp_path, lines, columns)
    lines[1] = "[PWM];[PWM];[PWM]"
    with pytest.raises(InputError, match="time: got the unit 'PWM'"):
        read_lines(tmp_path, lines)


def test_a_real_log_of_a_drive_says_its_units_below_its_names(tmp_path):
    head = ["%Date:,29/04/2021", "", "%timestep (8kHz),input,angle,velocity"]
    rows = [f"{k},{line.split(',', 1)[1]},0.5;" for k, line in enumerate(texts())]
    lines = [*head, "%[#],[V],[turns],[turns/s]", "nan,nan,nan,nan;", *rows]
    columns = FIRST_THREE
    with pytest.raises(InputError, match="the unit '8kHz' of time"):
        read_lines(tmp_path, lines, columns)
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
        log = read_lines(tmp_path, [*head, *texts("  ")], columns)
        np.testing.assert_allclose(log.time, TABLE[:, 0] / 1000)
        np.testing.assert_allclose(log.angle, np.radians(TABLE[:, 2]))


@pytest.mark.parametrize("head", ["time [ms],angle [deg]", "# t (ms) angle (deg)"])
def test_units_of_a_line_that_is_no_header_are_not_passed_over(tmp_path, head):
    columns = FIRST_THREE
    rows = [f"{line},1,2" for line in texts()]
    log = read_lines(tmp_path, [head, *rows], columns)
    np.testing.assert_allclose(log.time, TABLE[:, 0] / 1000)
    np.testing.assert_allclose(log.angle, np.radians(TABLE[:, 2]))
    with pytest.raises(InputError, match="column 0: got the unit 'ms, column unclear' of time"):
        read_lines(tmp_path, ["# a (ms) b (deg)", *rows], columns)
    log = read_log(tmp_path / "log.txt", columns, Units.of({"time": "ms", "angle": "deg"}), **KIND)
    np.testing.assert_allclose(log.angle, np.radians(TABLE[:, 2]))
    assert_table(read_lines(tmp_path, ["Bench 2 (Tuesday), run (3)", *rows], columns))
