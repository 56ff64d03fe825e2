"""Files that are read: what they are when sound, and what escapes of damaged ones."""

import io
import json
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as pa
from pyarrow import parquet
from scipy.io import savemat

from butterfly.experiment.source import Source
from butterfly.experiment.sweep import plan_sweep
from butterfly.files import shipped
from butterfly.identification.data import read_data_set
from butterfly.logs.csv import read_csv
from butterfly.logs.json import read_json
from butterfly.logs.log import InputKind
from butterfly.logs.manifest import read_manifest
from butterfly.logs.mat import read_mat
from butterfly.logs.mcap import read_mcap
from butterfly.logs.parquet import read_parquet
from butterfly.model.parameters import AddedMass
from tests.fuzz.escape import escape_of
from tests.logs.written import JOINT_STATE

_TIME = np.arange(40) * 0.01
MATRIX = np.column_stack([_TIME, np.sin(_TIME), np.cos(_TIME), np.sin(2 * _TIME)])
CONTENTS: dict[str, dict[str, Any]] = {
    "matrix": {"D": MATRIX},
    "single": {"D": MATRIX.astype(np.float32)},
    "integers": {"D": (1000 * MATRIX).astype(np.int16)},
    "complex": {"D": MATRIX + 1j},
    "three dimensions": {"D": np.zeros((2, 2, 2))},
    "vectors": {"t": _TIME, "u": np.sin(_TIME), "q": np.cos(_TIME), "c": np.array(["a"], "O")},
    "struct": {"data": {"t": _TIME, "u": np.sin(_TIME), "q": np.cos(_TIME), "x": {"y": "z"}}},
}
_COLUMNS = (
    None,
    {"time": "t", "input": "u", "angle": "q"},
    {"time": "data.t", "input": "data.u", "angle": "data.q"},
)
_KIND: dict[str, Any] = {"input_kind": InputKind.VOLTAGE, "added_mass": AddedMass()}
_ROWS = "".join(f"{t:.2f},{np.sin(t):.6f},{np.cos(t):.6f}\n" for t in _TIME[:30])
CSV = [
    ("time,input,angle\n" + _ROWS).encode(),
    ("# a log\ntime;input;angle\n" + _ROWS.replace(",", ";").replace(".", ",")).encode("utf-16"),
    ("time [s]\tinput [V]\tangle [rad]\n" + _ROWS.replace(",", "\t")).encode("latin-1"),
]
_SWEEP = b"""\
extends: quickstart
name: sweep
keep_signals: true
sweep:
  grid: {duration: [20, 3e1], plant.hand.mass: [0.1, 0.12]}
  list: [{method: linear}, {method: auto, terms: [coulomb]}]
  random: {count: 2, fields: {plant.friction.coulomb: {log_uniform: [1e-5, 1e-3]}}}
  latin_hypercube: {count: 2, fields: {seed: {choice: [1, 2]}}}
  repetitions: 2
"""
EXPERIMENTS = [
    _SWEEP,
    *(
        shipped(f"experiments/{name}.yaml").read_bytes()
        for name in ("quickstart", "friction-zoo", "orbit-recalibration", "mjcf-vs-greybox")
    ),
]
_MANIFEST = b"""\
name: bench
input: torque
arm: 0.104
known: {p4: 1, p3: {value: 0.3, uncertainty: 0.01}, resistance: 2.3}
units: {time: ms, angle: counts/4096}
columns: {time: t, input: u, angle: q}
repair: [backward]
zeros: [{added_mass: 0, zero: 0.1}]
holdout: [b.csv]
logs:
  - {file: a.csv, added_mass: 0, omega: 4, amplitude: 0.1, from: 1.0, to: 20}
  - {file: b.csv, added_mass: 0.05, split: restarts}
"""
MANIFESTS = [shipped("experiments/real-logs.yaml").read_bytes(), _MANIFEST]


_VALUES = dict(zip(("time", "input", "angle [deg]"), MATRIX.T.tolist(), strict=False))
_RECORDS = [dict(zip(_VALUES, row, strict=True)) for row in MATRIX[:, :3].tolist()]
JSON = [
    json.dumps(_RECORDS).encode(),
    "".join(f"{json.dumps(each)}\n" for each in _RECORDS).encode(),
    json.dumps({"units": {"time": "s"}, "a": [[1.0]], **_VALUES}).encode(),
    json.dumps({k: dict(enumerate(each)) for k, each in _VALUES.items()}).encode(),
]


def mats() -> list[bytes]:
    contents = CONTENTS.values()
    level5 = [_mat(each, do_compression=packed) for each in contents for packed in (False, True)]
    return [*level5, _mat(CONTENTS["matrix"], format="4"), _level73()]


def _mat(content: dict[str, object], **how: Any) -> bytes:
    file = io.BytesIO()
    savemat(file, content, **how)
    return file.getvalue()


def parquets() -> list[bytes]:
    t, u, q, dq = MATRIX.T
    columns = {"time": t, "input": u, "angle": q}
    tables = [pa.table(columns), pa.table(columns | {"velocity": dq, "note": ["x"] * t.size})]
    return [_parquet(table, how) for table in tables for how in ("zstd", "snappy", "none")]


def _parquet(table: pa.Table, compression: str) -> bytes:
    file = io.BytesIO()
    parquet.write_table(table, file, compression=compression, row_group_size=16)
    return file.getvalue()


def _level73() -> bytes:
    """Return a file of v7.3, which is HDF5, with a block of MATLAB's before it."""
    file = io.BytesIO()
    with h5py.File(file, "w", userblock_size=512) as root:
        root.create_dataset("D", data=MATRIX.T, compression="gzip")
        for name, column in zip("tuq", MATRIX.T, strict=False):
            root.create_dataset(name, data=column[None])
        data = root.create_group("data")
        data.attrs["MATLAB_class"] = np.bytes_("struct")
        for name, column in zip("tuq", MATRIX.T, strict=False):
            data.create_dataset(name, data=column[None])
    head = b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM"
    return head + file.getvalue()[len(head) :]


def bags() -> list[bytes]:
    """Return ROS 2 bags of a joint, packed and not."""
    from mcap.writer import CompressionType  # noqa: PLC0415 - an extra

    return [_bag(packed) for packed in CompressionType]


def _bag(packed: Any) -> bytes:
    from mcap_ros2.writer import Writer  # noqa: PLC0415 - an extra

    file = io.BytesIO()
    writer = Writer(file, compression=packed)
    schema = writer.register_msgdef("sensor_msgs/msg/JointState", JOINT_STATE)
    for k, (time, *state) in enumerate(MATRIX.tolist()):
        stamp = dict(zip(("sec", "nanosec"), divmod(round(time * 1e9), 10**9), strict=True))
        parts = {
            key: [each] for key, each in zip(("effort", "position", "velocity"), state, strict=True)
        }
        message = {"header": {"stamp": stamp, "frame_id": ""}, "name": ["hand"], **parts}
        writer.write_message("/joint_states", schema, message, log_time=k)
    writer.finish()
    return file.getvalue()


def mcap_escapes(content: bytes, path: Path) -> str:
    """Read a bag, and tell what is neither a log nor a line."""
    path = _written(content, path.with_suffix(".mcap"))
    return escape_of(lambda: read_mcap(path, **_KIND))


def mat_escapes(content: bytes, path: Path) -> str:
    """Read a file by every way, and tell what is neither a log nor a line; nothing if all are."""
    path = _written(content, path.with_suffix(".mat"))
    found = (escape_of(lambda c=columns: read_mat(path, c, **_KIND)) for columns in _COLUMNS)
    return next(filter(None, found), "")


def parquet_escapes(content: bytes, path: Path) -> str:
    """Read a table, and tell what is neither a log nor a line."""
    path = _written(content, path.with_suffix(".parquet"))
    return escape_of(lambda: read_parquet(path, **_KIND))


def json_escapes(content: bytes, path: Path) -> str:
    """Read records or columns, and tell what is neither a log nor a line."""
    path = _written(content, path.with_suffix(".json"))
    return escape_of(lambda: read_json(path, **_KIND))


def csv_escapes(content: bytes, path: Path) -> str:
    """Read a table, and tell what is neither a log nor a line."""
    path = _written(content, path.with_suffix(".csv"))
    return escape_of(lambda: read_csv(path, **_KIND))


def experiment_escapes(content: bytes, path: Path) -> str:
    """Read an experiment and plan its runs, and tell what is neither done nor a line."""
    path = _written(content, path.with_suffix(".yaml"))

    def planned() -> object:
        plan = plan_sweep(Source(path))
        return plan.experiment.runs(), plan.tasks

    return escape_of(planned)


def manifest_escapes(content: bytes, path: Path) -> str:
    """Read a manifest and the logs it names, and tell what is neither done nor a line."""
    path = _written(content, path.with_suffix(".yaml"))
    return escape_of(lambda: read_data_set(read_manifest(path, path.parent)))


def _written(content: bytes, path: Path) -> Path:
    path.write_bytes(content)
    return path
