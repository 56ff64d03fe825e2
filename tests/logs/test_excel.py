"""Sheets of Excel's are read as texts are."""

import datetime

import pytest

from butterfly.errors import InputError
from butterfly.logs.formats import read_log
from tests.logs.columns import FACTORS, MATRIX, NAMES, TABLE, TIME, UNITS, assert_read
from tests.logs.written import write_sheets


def test_a_sheet_of_excels_is_read_as_a_text_is(tmp_path):
    path = tmp_path / "log.xlsx"
    above = [[None], [None, "Bench 2"], [None, "# input: mV"]]
    write_sheets(path, {"Run 3": above + [[None, *row] for row in UNITS], "Notes": [["hello", 5]]})
    log = assert_read(path, factors=FACTORS)
    assert log.reading.layout == ("sheet Run 3", "comment lines: 1", "lines above the table: 1")
    write_sheets(path, {"a": TABLE, "b": UNITS})
    with pytest.raises(InputError, match=r"got sheets a, b; expected one sheet with these"):
        read_log(path)
    write_sheets(path, {"a": TABLE, "b": [["time", "x", "y"], *TABLE[1:]]})
    assert_read(path)
    bad = {
        "got '2024-05-01T10:00:00' in line 62": [*TABLE, [datetime.datetime(2024, 5, 1, 10), 1, 2]],
        "got '#DIV/0!' in line 62": [*TABLE, [1.0, "#DIV/0!", 2]],
        "16384 cells; expected at most 10000": [*TABLE, [None] * 16_383 + [1.0]],
        "no row of numbers": [["hello"]],
    }
    for said, rows in bad.items():
        write_sheets(path, {"a": rows})
        with pytest.raises(InputError, match=said):
            read_log(path)


def test_dates_times_and_durations_of_excels_are_a_clock(tmp_path):
    spans = [datetime.timedelta(seconds=each) for each in TIME]
    instants = [datetime.datetime(2024, 5, 1, 10) + each for each in spans]
    for clock in (instants, [each.time() for each in instants], spans):
        rows = [NAMES, *zip(clock, *MATRIX.T[1:].tolist(), strict=True)]
        write_sheets(tmp_path / "log.xlsx", {"a": rows})
        assert_read(tmp_path / "log.xlsx")
