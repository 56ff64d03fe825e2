"""Files as MATLAB and ROS 2 write them."""

import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from io import BytesIO
from pathlib import Path
from typing import Any
from unittest import mock

import h5py
import numpy as np
import openpyxl
import pytest
from numpy.typing import NDArray

JOINT_STATE = """\
std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
MARK73 = b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM"


@contextmanager
def mat73(file: Path | BytesIO) -> Iterator[Any]:
    """Open a new file of v7.3: HDF5 behind a block of MATLAB's."""
    with h5py.File(file, "w", userblock_size=512) as root:
        yield root
    with file.open("r+b") if isinstance(file, Path) else nullcontext(file) as raw:
        raw.seek(0)
        raw.write(MARK73)


def put73(group: Any, variables: Mapping[str, Any], **how: Any) -> None:
    """Write structs, texts and numbers, whose arrays HDF5 holds turned; ``how`` of the numbers."""
    for name, value in variables.items():
        if isinstance(value, Mapping):
            group.create_group(name).attrs["MATLAB_class"] = np.bytes_("struct")
            put73(group[name], value, **how)
        elif isinstance(value, str):
            group[name] = np.array([[ord(each)] for each in value], np.uint16)
            group[name].attrs["MATLAB_class"] = np.bytes_("char")
        else:
            data = group.create_dataset(name, data=np.atleast_2d(value).T, **how)
            data.attrs["MATLAB_class"] = np.bytes_("double")


def write_bag(
    file: Any,
    stamps: Sequence[int],
    parts: Mapping[str, NDArray[np.float64]],
    *,
    joints: Sequence[str] = ("hand",),
    topics: Sequence[str] = ("/joint_states",),
    kind: str = "sensor_msgs/msg/JointState",
    stamped: bool = True,
    **how: Any,
) -> None:
    """Write a bag of joints: stamps in ns, and (n, joints) positions, velocities and efforts."""
    from mcap_ros2.writer import Writer  # noqa: PLC0415 - an extra

    writer = Writer(file, **how)
    schema = writer.register_msgdef(kind, JOINT_STATE)
    other = writer.register_msgdef("std_msgs/msg/Float64", "float64 data")
    for k, stamp in enumerate(map(int, stamps)):
        seconds = divmod(stamp, 10**9) if stamped else (0, 0)
        header = {"stamp": dict(zip(("sec", "nanosec"), seconds, strict=True)), "frame_id": ""}
        state = {name: each[k].tolist() for name, each in parts.items()}
        for topic in topics:
            message = {"header": header, "name": [*joints], **state}
            writer.write_message(topic, schema, message, log_time=stamp + 5000 * (k % 3))
        writer.write_message("/bus", other, {"data": 24.0}, log_time=stamp)
    writer.finish()


def write_sheets(path: Path, sheets: Mapping[str, Sequence[Sequence[Any]]]) -> None:
    """Write rows of cells as Excel's sheets."""
    book = openpyxl.Workbook(write_only=True)
    for name, rows in sheets.items():
        sheet = book.create_sheet(name)
        for row in rows:
            sheet.append(row)
    book.save(path)


def write_objects(
    path: Path, variables: Mapping[str, Any], version: str, units: Any = (), *, packed: bool = True
) -> None:
    """Write frames as tables with units, and (data, unit, times or (0, step)) as timeseries."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        matio = pytest.importorskip(
            "matio", reason="mat-io is not installed: no wheel for this Python?"
        )
        from matio.utils import MatlabOpaque  # noqa: PLC0415
        from matio.utils.converters import mattables  # noqa: PLC0415

        def series(data: Any, unit: str, times: Any) -> Any:
            own = {"Start_": 0.0, "Increment_": times[1], "Length": float(len(data))}
            own |= {"Time_": times[:, None] if len(times) > 2 else np.empty((0, 0))}
            about = MatlabOpaque(own | {"Units": "seconds"}, "tsdata.timemetadata")
            info = MatlabOpaque({"Units": unit}, "tsdata.datametadata")
            parts = {"Data_": data[:, None], "TimeInfo": about, "DataInfo": info}
            return MatlabOpaque(parts, "timeseries")

        props = mattables.make_table_props()
        props["VariableUnits"][0, 0] = np.array([[*units]], dtype=object)
        told = {k: series(*v) if isinstance(v, tuple) else v for k, v in variables.items()}
        with mock.patch.object(mattables, "make_table_props", return_value=props):
            matio.save_to_mat(str(path), told, version=version, do_compression=packed)
