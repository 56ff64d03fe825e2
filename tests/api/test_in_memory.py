"""Logs that stand in memory."""

import numpy as np
import pandas as pd
import pytest

import butterfly as bf

RAMP = np.arange(40.0)
COLUMNS = {"time": "t", "input": "u", "angle": "q"}
MADE = {"t": 10 * RAMP, "u": np.sin(RAMP), "q": np.cos(RAMP)}
UNITS = {"time": "ms", "angle": "deg"}


FORMS = [MADE, pd.DataFrame(MADE), np.rec.fromarrays(list(MADE.values()), names=list(MADE))]


@pytest.mark.parametrize("table", FORMS, ids=["mapping", "frame", "named columns"])
def test_tables_are_read_by_the_names_of_their_columns(table):
    data = bf.read(table, columns=COLUMNS, units=UNITS, input_kind="torque")
    (log,) = data.logs
    assert data.input_kind == "torque"
    np.testing.assert_allclose(log.time, RAMP / 100)
    np.testing.assert_array_equal(log.input, np.sin(RAMP))
    np.testing.assert_allclose(log.angle, np.radians(np.cos(RAMP)))
    with pytest.raises(bf.InputError, match="table: time: got no such column"):
        bf.read(table)


def test_a_plain_array_has_the_columns_of_a_matrix_or_those_that_are_told():
    array = np.column_stack([RAMP, *list(MADE.values())[1:], RAMP])
    (log,) = bf.read(array).logs
    np.testing.assert_array_equal(log.angle, np.cos(RAMP))
    np.testing.assert_array_equal(log.velocity, RAMP)
    (other,) = bf.read(array, columns={"time": 3, "input": 1, "angle": 2}).logs
    assert other.velocity is None
    with pytest.raises(bf.InputError, match=r"an array of shape \(40,\)"):
        bf.read(RAMP)


def test_what_only_files_have_is_refused_for_a_table():
    with pytest.raises(bf.InputError, match=r"arm: got 0\.1; expected none beside a table"):
        bf.read(MADE, columns=COLUMNS, arm=0.1)


def test_repairs_are_allowed_by_name():
    wrapped = {**MADE, "t": RAMP, "q": (0.3 * RAMP) % (2 * np.pi)}
    with pytest.raises(bf.InputError, match="repair 'unwrap'"):
        bf.read(wrapped, columns=COLUMNS)
    data = bf.read(wrapped, columns=COLUMNS, repair=["unwrap"])
    np.testing.assert_allclose(data.logs[0].angle, 0.3 * RAMP)
    log = data.recorded[0]
    assert bf.read(log, repair=["unwrap"]).health[0].wraps == 1
    assert bf.read([log, log], repair=["unwrap"]).health[1].wraps == 1
    with pytest.raises(bf.InputError, match=r"repair.*got 'turn'; expected 'duplicate'"):
        bf.read(log, repair=["turn"])
    with pytest.raises(bf.InputError, match="repair: got 'unwrap'; expected a list"):
        bf.read(log, repair="unwrap")
    with pytest.raises(bf.InputError, match="none of a repaired data set"):
        bf.read(data, repair=["unwrap"])


@pytest.mark.parametrize("names", [[3], "log"])
def test_logs_are_held_out_by_names_only(names):
    with pytest.raises(bf.InputError, match="holdout: got"):
        bf.identify(bf.read(MADE, columns=COLUMNS, repair=None), holdout=names)
