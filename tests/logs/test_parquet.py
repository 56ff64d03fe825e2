import json

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from pyarrow import parquet

from butterfly.errors import InputError
from butterfly.logs.formats import read_log
from butterfly.logs.log import InputKind

KIND = {"input_kind": InputKind.TORQUE}
RAMP = np.arange(20.0)


def _write(path, **columns):
    parquet.write_table(pa.table(columns), path)
    return path


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"time": RAMP, "input": RAMP}, "angle: got no such column; .* one of 'time', 'input'"),
        ({"time": RAMP, "input": RAMP, "angle": ["a"] * 20}, "angle: got a column of string"),
        ({"time": RAMP[:3], "input": RAMP[:3], "angle": RAMP[:3]}, "time: got 3 samples"),
    ],
)
def test_a_wrong_content_is_named(tmp_path, columns, message):
    with pytest.raises(InputError, match=message):
        read_log(_write(tmp_path / "a.parquet", **columns), **KIND)


@pytest.mark.parametrize("content", [b"", b"PAR1 and so on PAR1", b"time,input,angle\n"])
def test_what_is_no_parquet_is_one_typed_error(tmp_path, content):
    (tmp_path / "a.parquet").write_bytes(content)
    with pytest.raises(InputError, match="a whole Parquet file"):
        read_log(tmp_path / "a.parquet", **KIND)


def test_a_file_that_tells_of_more_rows_than_it_can_hold_is_refused(tmp_path, monkeypatch):
    columns = {name: np.zeros(5000) for name in ("time", "input", "angle")}
    path = _write(tmp_path / "constant.parquet", **columns)
    assert read_log(path).time.size == 5000
    monkeypatch.setattr("butterfly.files._FREE", 0)
    monkeypatch.setattr("butterfly.files._PACKED", 1)
    with pytest.raises(InputError, match=r"5000 rows in .* kB; expected a whole"):
        read_log(path)


def test_columns_of_one_name_are_told_apart_by_number_and_one_of_none_is_passed_over(tmp_path):
    path = tmp_path / "twice.parquet"
    arrays = [pa.array(RAMP + k) for k in range(5)]
    parquet.write_table(pa.Table.from_arrays(arrays, names=["t", "u", "x", "x", ""]), path)
    log = read_log(path, {"time": "t", "input": "u", "angle": 3})
    assert (log.angle[0], log.velocity) == (3.0, None)


@pytest.mark.parametrize("name", ["time", None])
def test_pandas_index_is_a_column(tmp_path, name):
    path = tmp_path / "a.parquet"
    frame = pd.DataFrame({"angle": RAMP, "input": 2 * RAMP}, index=pd.Index(0.5 * RAMP, name=name))
    frame.to_parquet(path)
    own = {"time": "__index_level_0__", "input": "input", "angle": "angle"}
    log = read_log(path, None if name else own, **KIND)
    np.testing.assert_array_equal(log.time, 0.5 * RAMP)
    np.testing.assert_array_equal(log.angle, RAMP)
    frame.reset_index(names="time").to_parquet(path, index=True)
    np.testing.assert_array_equal(read_log(path, **KIND).time, 0.5 * RAMP)


@pytest.mark.parametrize("names", [["pan.pos", "elbow.pos"], {"motors": ["pan.pos", "elbow.pos"]}])
def test_a_lerobot_data_set_names_the_parts_of_its_lists(tmp_path, names):
    folder = tmp_path / "data/chunk-000"
    folder.mkdir(parents=True)
    features = {name: {"names": names} for name in ("observation.state", "action")}
    (tmp_path / "meta").mkdir()
    (tmp_path / "meta/info.json").write_text(json.dumps({"features": features}))
    lists = {name: [[k, 2 * k] for k in RAMP] for name in features}
    path = _write(folder / "episode_000000.parquet", timestamp=RAMP, **lists)
    columns = {
        "time": "timestamp",
        "input": "action.pan.pos",
        "angle": "observation.state.elbow.pos",
    }
    log = read_log(path, columns, **KIND)
    assert np.array_equal(log.angle, 2 * RAMP)
    assert np.array_equal(log.input, RAMP)


@pytest.mark.parametrize(
    "content", ["", "[]", '{"features": []}', '{"features": {"a": {"names": 1}}}']
)
def test_another_file_of_that_name_names_nothing(tmp_path, content):
    (tmp_path / "meta").mkdir()
    (tmp_path / "meta/info.json").write_text(content)
    path = _write(tmp_path / "a.parquet", time=RAMP, input=RAMP, angle=[[k, k] for k in RAMP])
    log = read_log(path, {"time": "time", "input": "input", "angle": "angle.1"}, **KIND)
    assert np.array_equal(log.angle, RAMP)
