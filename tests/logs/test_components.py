"""Lists within the columns of every format: a component by its number, or by the joint's name."""

import json
from importlib.util import find_spec

import h5py
import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from pyarrow import parquet
from scipy.io import savemat

from butterfly.errors import InputError
from butterfly.logs.formats import NoColumnError, log_of_table, read_log
from tests.logs.written import mat73, put73, write_bag

COUNT = 40
JOINTS = ("shoulder", "elbow", "wrist")
TIME = 0.01 * np.arange(COUNT)
RANDOM = np.random.default_rng(3)
ACTION, POSITION = RANDOM.normal(size=(2, COUNT, len(JOINTS)))
TURNED = [slice(None, None, -1 if k % 3 else 1) for k in range(COUNT)]  # joints in any sequence


def _states():
    return [
        {"name": list(JOINTS[turn]), "position": POSITION[k][turn].tolist()}
        for k, turn in enumerate(TURNED)
    ]


def _records():
    rows = zip(TIME.tolist(), ACTION.tolist(), _states(), strict=True)
    return [{"time": t, "action": action, "arm": state} for t, action, state in rows]


def _parquet(path, kind=None):
    columns = {"action": pa.array(ACTION.tolist(), kind), "arm": _states(), "time": TIME}
    parquet.write_table(pa.table(columns), path)


def _json(path):
    text = json.dumps(_records()) if path.suffix == ".json" else None
    path.write_text(text or "".join(f"{json.dumps(each)}\n" for each in _records()))


def _level5(path):
    arm = {"name": np.array(JOINTS, object), "position": POSITION}
    savemat(path, {"time": TIME, "action": ACTION, "arm": arm})


def _level73(path):
    with mat73(path) as file:
        put73(file, {"time": TIME, "action": ACTION})
        group = file.create_group("arm")
        group.create_dataset("name", data=list(JOINTS), dtype=h5py.string_dtype())
        rows = group.create_dataset("position", (COUNT,), h5py.vlen_dtype(np.float64))
        for k, row in enumerate(POSITION):
            rows[k] = row


def _npz(path):
    np.savez(path, **{"time": TIME, "action": ACTION, "arm.position": POSITION, "arm.name": JOINTS})


WRITERS = {".parquet": _parquet, ".json": _json, ".jsonl": _json, ".npz": _npz, ".mat": _level5}
FORMS = [*WRITERS.items(), (".mat", _level73)]


@pytest.mark.parametrize("angle", ["arm.position.elbow", "arm.elbow.position"])
@pytest.mark.parametrize(("ending", "write"), FORMS)
def test_a_component_is_read_by_its_number_and_by_its_joint(tmp_path, ending, write, angle):
    path = tmp_path / f"log{ending}"
    write(path)
    log = read_log(path, {"time": "time", "input": "action.2", "angle": angle})
    np.testing.assert_array_equal(log.input, ACTION[:, 2])
    np.testing.assert_array_equal(log.angle, POSITION[:, 1])


@pytest.mark.parametrize("kind", [pa.list_(pa.float32(), 3), pa.large_list(pa.float64())])
def test_lists_of_any_type_of_parquet_have_components(tmp_path, kind):
    _parquet(tmp_path / "a.parquet", kind)
    columns = {"time": "time", "input": "action.0", "angle": "action.1"}
    log = read_log(tmp_path / "a.parquet", columns)
    np.testing.assert_allclose(log.angle, ACTION[:, 1], rtol=1e-6)


@pytest.mark.parametrize("state", [POSITION, POSITION.tolist()])
def test_columns_of_a_table_may_be_matrices_or_lists(state):
    columns = {"time": "time", "input": "action.2", "angle": "state.elbow"}
    named = {"time": TIME, "action": ACTION, "state": state, "name": JOINTS}
    np.testing.assert_array_equal(log_of_table(named, columns).angle, POSITION[:, 1])
    frame = pd.DataFrame({"time": TIME, "action": list(ACTION), "state": list(state)})
    log = log_of_table(frame, columns | {"angle": "state.1"})
    np.testing.assert_array_equal(log.angle, POSITION[:, 1])
    assert log.reading.columns["angle"].number is None


@pytest.mark.skipif(find_spec("mcap_ros2") is None, reason="of an extra")
@pytest.mark.parametrize("angle", ["position.elbow", "position.1", "elbow.position"])
def test_joints_of_a_bag_are_named_as_those_of_other_files(tmp_path, angle):
    parts = {"position": POSITION, "velocity": ACTION, "effort": ACTION}
    with (tmp_path / "a.mcap").open("wb") as file:
        write_bag(file, 10**18 + 10**7 * np.arange(COUNT), parts, joints=JOINTS)
    columns = {"time": "time", "input": "effort.wrist", "angle": angle}
    log = read_log(tmp_path / "a.mcap", columns, input_kind="torque")
    np.testing.assert_array_equal(log.angle, POSITION[:, 1])
    np.testing.assert_array_equal(log.input, ACTION[:, 2])


def test_a_row_that_lacks_a_component_has_no_number_there(tmp_path):
    records = _records()
    records[5]["arm"] = {"name": ["wrist"], "position": [1.0]}
    (tmp_path / "a.json").write_text(json.dumps(records))
    columns = {"time": "time", "input": "action.0", "angle": "arm.position.elbow"}
    angle = read_log(tmp_path / "a.json", columns).angle
    assert np.flatnonzero(np.isnan(angle)).tolist() == [5]


def test_of_a_list_its_components_are_named_to_choose_from(tmp_path):
    _parquet(tmp_path / "a.parquet")
    columns = {"time": "time", "input": "action", "angle": "arm.position.0"}
    with pytest.raises(InputError, match=r"action: got a column of list.*its parts: action\.0"):
        read_log(tmp_path / "a.parquet", columns)
    with pytest.raises(NoColumnError, match=r"'action\.2'.*'arm\.position\.wrist'"):
        read_log(tmp_path / "a.parquet", columns | {"input": "action.3"})
