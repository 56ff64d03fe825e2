"""Files as MATLAB and ROS 2 write them."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from io import BytesIO
from pathlib import Path
from typing import Any

import h5py
import numpy as np
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
