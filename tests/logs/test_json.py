"""Logs in JSON, as programs write them."""

import json

import numpy as np
import pandas as pd
import pytest

import butterfly as bf
from butterfly.errors import InputError
from butterfly.logs.formats import read_log

RAMP = np.arange(24.0)
FRAME = pd.DataFrame({"time": 0.01 * RAMP, "input": np.sin(RAMP), "angle": np.cos(RAMP)})
RECORDS = FRAME.to_dict("records")
NESTED = [
    {"t": each["time"], "motor": {"u": each["input"]}, "joint": {"position": [0.0, each["angle"]]}}
    for each in RECORDS
]
MAP = {"time": "t", "input": "motor.u", "angle": "joint.position.1"}
SHUFFLED = json.loads(FRAME.to_json(double_precision=15))
SHUFFLED["angle"] = dict(sorted(SHUFFLED["angle"].items()))  # "1", "10", "11"
FORMS = {
    "columns": (json.dumps({"robot": "b", **FRAME.to_dict("list")}), None),
    "pandas": (FRAME.to_json(double_precision=15), None),
    "pandas, an index sorted as texts": (json.dumps(SHUFFLED), None),
    "a record a line": (FRAME.to_json(orient="records", lines=True, double_precision=15), None),
    "rows": (json.dumps(FRAME.to_numpy().tolist()), {"time": 0, "input": 1, "angle": 2}),
    "nested records": (json.dumps(NESTED), MAP),
    "nested columns": (
        json.dumps({"t": [*FRAME["time"]], "a": FRAME[["input", "angle"]].to_dict("list")}),
        {"time": "t", "input": "a.input", "angle": "a.angle"},
    ),
    "samples beside a head": (
        json.dumps({"head": {"rate": 100}, "samples": RECORDS}),
        {name: f"samples.{name}" for name in FRAME},
    ),
}


def _written(folder, text, ending=".json"):
    path = folder / f"log{ending}"
    path.write_text(text)
    return path


@pytest.mark.parametrize("form", FORMS)
def test_records_and_columns_are_read(tmp_path, form):
    text, columns = FORMS[form]
    log = read_log(_written(tmp_path, text), columns)
    for name in FRAME:
        np.testing.assert_allclose(getattr(log, name), FRAME[name], rtol=0, atol=1e-15)
    assert log.name == "log.json"


def test_whether_a_servo_is_on_may_be_true_or_false(tmp_path):
    records = [{**row, "on": number < 20} for number, row in enumerate(RECORDS)]
    names = {name: name for name in FRAME} | {"enabled": "on"}
    log = read_log(_written(tmp_path, json.dumps(records)), names)
    np.testing.assert_array_equal(log.enabled, np.arange(24) < 20)


@pytest.mark.parametrize("ending", [".jsonl", ".ndjson"])
def test_a_last_record_that_was_cut_off_is_dropped_and_counted(tmp_path, ending):
    lines = FRAME.to_json(orient="records", lines=True)
    log = read_log(_written(tmp_path, lines[:-9], ending))
    assert (log.time.size, log.reading.cut_lines) == (23, 1)
    whole = read_log(_written(tmp_path, lines, ending))
    assert (whole.time.size, whole.reading.cut_lines) == (24, 0)


def _changed(row, **values):
    return json.dumps([{**each, **(values if k == row else {})} for k, each in enumerate(RECORDS)])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (_changed(5, angle="0.1"), "angle: got '0.1' in record 5; expected a number"),
        (_changed(5, angle=True), "angle: got True in record 5"),
        (json.dumps([*RECORDS, {"time": 1.0, "input": 0.0}]), "angle: got nothing in record 24"),
        (json.dumps([*RECORDS, 7]), "time: got nothing in record 24"),
        (json.dumps({**FRAME.to_dict("list"), "angle": [1, 2]}), "expected shape"),
        (_changed(5, angle=0)[:-9], "content: got unreadable"),
        ('[{"time": 0, "time": 1}]', "an object with the same key twice"),
        ("[" * 100_000, "content: got unreadable"),
        (json.dumps(RECORDS).replace("input", "u"), "input: got no such column.*'u'"),
        ("[]", "time: got no such column"),
    ],
)
def test_what_is_no_log_is_one_typed_error(tmp_path, text, message):
    with pytest.raises(InputError, match=message):
        read_log(_written(tmp_path, text))


def test_a_unit_beside_the_number_of_each_record_is_read(tmp_path):
    units = {"time": "s", "input": "mV", "angle": "deg"}
    records = [{k: {"unit": units[k], "values": x} for k, x in row.items()} for row in RECORDS]
    names = {name: f"{name}.values" for name in FRAME}
    log = read_log(_written(tmp_path, json.dumps(records)), names)
    np.testing.assert_allclose(log.input, FRAME["input"] / 1000)
    np.testing.assert_allclose(log.angle, np.radians(FRAME["angle"]))
    records[3]["angle"]["unit"] = "rad"
    with pytest.raises(InputError, match=r"deg \(angle.unit\) and rad \(angle.unit\) of angle"):
        read_log(_written(tmp_path, json.dumps(records)), names)


def test_null_and_numbers_beyond_all_are_not_finite(tmp_path):
    assert np.isnan(read_log(_written(tmp_path, _changed(5, angle=None))).angle[5])
    assert np.isinf(read_log(_written(tmp_path, _changed(5, angle=10**4000))).angle[5])


def test_results_and_logs_in_json_are_told_apart(tmp_path, quick_data):
    frames = [bf.read(quick_data).logs[k] for k in (0, 1)]
    for k, log in enumerate(frames):
        table = pd.DataFrame(log.columns())
        (tmp_path / f"{k}.json").write_text(table.to_json(double_precision=15))
    (tmp_path / "notes.json").write_text('{"operator": "me"}')
    (tmp_path / "result.json").write_text('{"schema": "butterfly.identification"}')
    assert [log.name for log in bf.read(tmp_path).logs] == ["0.json", "1.json"]
    with pytest.raises(InputError, match="a saved identification"):
        bf.read(tmp_path / "result.json")
