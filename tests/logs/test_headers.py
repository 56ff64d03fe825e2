"""Keys and values are found in lines of any of the usual notations, and in what files hold."""

import numpy as np
import pytest

from butterfly.logs.headers import (
    cells_of,
    columns_meant,
    columns_of_drive,
    columns_of_joint,
    halves,
    nested_keys,
    opened,
    record_in,
    segments,
)

WITHOUT_TIME = {"input": "effort", "angle": "position"}
BELOW = {"units": {"time": "s", "input": "mV"}}


@pytest.mark.parametrize(
    "lines",
    [
        ["# units:", "#   time: s", "#   input: mV"],
        ["[units]", "time = s", 'input = "mV"'],
        ['"units": {', '  "time": "s",', '  "input": "mV"', "}"],
    ],
)
def test_keys_below_a_key_are_found_however_they_are_written(lines):
    assert nested_keys(lines) == BELOW


def test_items_of_a_list_are_records_and_what_stands_alone_is_no_key():
    lines = ["columns:", "  - name: time", "    unit: s", "  - name: input", "rate: 500"]
    found = nested_keys(lines)
    assert found == {"columns": {"": [{"name": "time", "unit": "s"}, {"name": "input"}]}}


def test_a_line_is_a_record_if_it_has_a_name_and_a_unit():
    assert record_in("name=input, unit='mV'") == {"name": "input", "unit": "mV"}
    assert record_in("name=input, gain=3") == {}


def test_a_row_is_divided_at_marks_or_blanks_or_slashes_and_a_text_at_its_first_mark():
    for row in ("s, mV, rad", "s mV rad", "s|mV|rad", "s/mV/rad"):
        assert cells_of(row) == ["s", "mV", "rad"]
    assert segments("time in s; input in mV") == ["time in s", "input in mV"]
    assert halves("input = mV: peak") == ("input", "=", "mV: peak")
    assert halves("input") == ("input", "", "")


def test_bytes_arrays_of_texts_and_json_are_opened_and_other_values_stay():
    assert opened(b'{"unit": "mV"}') == {"unit": "mV"}
    assert opened(np.array(["s", "mV"])) == ["s", "mV"]
    assert opened(np.array(["mV"])) == "mV"
    assert opened("{mV}") == "{mV}"
    assert opened(0.5) == 0.5


def test_the_columns_of_a_servos_drive_are_taken_where_one_name_fits():
    names = ["time_s", "goal_rad", "supply_V", "torque_enabled", "load_raw"]
    assert columns_of_drive(names) == {"supply": "supply_V", "enabled": "torque_enabled"}
    assert columns_of_drive(["supply_V", "vin"]) == {}


@pytest.mark.parametrize(
    "names",
    [
        ("stamp.sec", "stamp.nanosec"),
        ("secs", "nsecs"),
        ("sec", "nanosec"),
        ("header.stamp.sec", "header.stamp.nanosec"),
        ("Time_Seconds", "Time_Nanoseconds"),
    ],
)
def test_two_columns_that_are_together_the_time_are_both_taken(names):
    meant = columns_meant([*names, "effort", "position"])
    assert meant == {"time": names[0], "nanoseconds": names[1]} | WITHOUT_TIME
    of_joint = columns_of_joint([*names, "hip.effort", "hip.position"], "hip", ["hip"])
    assert (of_joint["time"], of_joint["nanoseconds"]) == names


@pytest.mark.parametrize(
    "names", [("time_s", "time_ns"), ("sent.sec", "received.nanosec"), ("t", "sec", "nanosec")]
)
def test_columns_that_may_be_several_times_are_left_to_be_chosen(names):
    assert columns_meant([*names, "effort", "position"]) == WITHOUT_TIME
