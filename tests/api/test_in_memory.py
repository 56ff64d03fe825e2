"""Logs that stand in memory."""

import numpy as np
import pandas as pd
import pytest
import yaml

import butterfly as bf

RAMP = np.arange(40.0)
COLUMNS = {"time": "t", "input": "u", "angle": "q"}
MADE = {"t": 10 * RAMP, "u": np.sin(RAMP), "q": np.cos(RAMP)}
UNITS = {"time": "ms", "angle": "deg"}


@pytest.mark.parametrize(
    "table",
    [
        MADE,
        pd.DataFrame(MADE),
        np.rec.fromarrays(list(MADE.values()), names=list(MADE)),
    ],
    ids=["mapping", "frame", "named columns"],
)
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


def test_several_tables_make_one_data_set():
    data = bf.read([pd.DataFrame(MADE), MADE], columns=COLUMNS, name="both")
    assert (len(data.logs), data.name) == (2, "both")


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


def test_an_experiment_in_memory_is_the_data_set_of_its_folder(quick, tmp_path):
    content = yaml.safe_load(quick.read_text())
    loads = [{"mass": 0.05, "mass_uncertainty": 1e-3}, {"mass": 0.12, "arm_uncertainty": 2e-3}]
    added = [{"mass": 0.0}, *({"arm": 0.104} | each for each in loads)]
    told = {"known": {"p4": {"value": 0.025, "uncertainty": 0.001}}, "holdout": ["run002*"]}
    quick.write_text(yaml.safe_dump(content | told | {"added_masses": added}))
    memory, folder = bf.simulate(quick), bf.simulate(quick, out=tmp_path / "logs")
    for data in (memory, folder):
        assert data.given.to_dict() == told["known"]
        assert [log.name[:6] for log in data.test_logs.logs] == ["run002"]
        carried = [log.added_mass for log in data.logs]
        uncertain = {(added.mass_uncertainty, added.arm_uncertainty) for added in carried}
        assert uncertain == {(0.0, 0.0), (1e-3, 0.0), (0.0, 2e-3)}
    first, second = (bf.identify(data, "linear").estimate for data in (memory, folder))
    np.testing.assert_array_equal(first.values, second.values)
    np.testing.assert_array_equal(first.covariance, second.covariance)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("units", {"angle": ["deg"]}),
        ("piece", (1, 2, 3)),
        ("piece", 3.0),
        ("repair", 3),
        ("zero", "x"),
        ("columns", "time=t"),
    ],
)
def test_a_wrong_word_about_a_table_is_one_typed_error(field, value):
    with pytest.raises(bf.InputError) as caught:
        bf.read(MADE, **{"columns": COLUMNS} | {field: value})
    assert caught.value.field.startswith(field)


@pytest.mark.parametrize("names", [[3], "log"])
def test_logs_are_held_out_by_names_only(names):
    with pytest.raises(bf.InputError, match="holdout: got"):
        bf.identify(bf.read(MADE, columns=COLUMNS, repair=None), holdout=names)
