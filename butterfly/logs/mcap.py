"""Logs in MCAP files (ROS 2 bags): the sensor_msgs/JointState messages of its topics."""

from __future__ import annotations

from array import array
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import Samples
from butterfly.errors import InputError, size_text
from butterfly.files import most_in, require_file, whole
from butterfly.logs.formats import ColumnMap, chosen_columns, components
from butterfly.logs.log import InputKind, Log
from butterfly.logs.unit_hints import UnitHints
from butterfly.logs.units import Units

_TYPES = {"sensor_msgs/msg/JointState", "sensor_msgs/JointState"}
_FIELDS = {"angle": "position", "input": "effort", "velocity": "velocity"}
_TIMES = ("time", "log_time")
_EXTRA = "the extra mcap (pip install 'butterfly-testbed[mcap]')"
_WHOLE = "a whole MCAP file (`mcap recover` repairs a truncated one)"


def read_mcap(path: Path, columns: ColumnMap | None, units: Units, about: dict[str, Any]) -> Log:
    """Read a log (see `read_log`) from a bag.

    Its columns: ``time``, the timestamps of the messages; ``log_time``, when the bag received them;
    ``JOINT.position`` (also ``position.JOINT`` and, by its number, ``position.0``),
    ``JOINT.velocity``, ``JOINT.effort``. With several topics each name has a
    prefix (``/joint_states:time``); columns of several are joined by their stamps, each topic's in
    rows of its own. Both times begin at 0. Without a map the only joint is read.
    """
    topics = _topics(path)
    named = {
        f"{topic}:" * (len(topics) > 1) + name: (topic, name)
        for topic, columns in topics.items()
        for name in columns
    }
    names = list(named)
    if columns is None:
        columns = _only_joint(path, names)
        if about.get("input_kind") == InputKind.NONE:
            del columns["input"]
    places, _ = chosen_columns(path, names, columns, about)
    arrays = _rows(path, topics, {field: named[names[k]] for field, k in places.items()})
    if "time" in arrays and not np.any(arrays["time"]):
        expected = "timestamps in the message headers, or --columns time=log_time,..."
        raise InputError(path, names[places["time"]], "0 throughout", expected)
    headings = UnitHints(path, names).headings(places)
    return Log.of_columns(arrays, headings, units, **about | {"source": str(path)})


def _rows(
    path: Path,
    topics: Mapping[str, Mapping[str, Samples]],
    chosen: Mapping[str, tuple[str, str]],
) -> dict[str, Samples]:
    """Return columns by field: of one topic as they are, of several a row for each stamp."""
    clock = chosen["time"][1] if "time" in chosen else "log_time"
    stamps = {topic: topics[topic][clock] for topic, _ in chosen.values()}
    if len(stamps) == 1:
        columns = {field: topics[topic][name] for field, (topic, name) in chosen.items()}
        times = {field for field, (_, name) in chosen.items() if name in _TIMES}
        return columns | {f: (columns[f] - columns[f][:1].sum()) / 1e9 for f in times}
    for topic, instants in stamps.items():
        if not instants.any() or np.any(np.diff(instants) < 0) or "time" not in chosen:
            expected = f"messages in order of time, or time={topic}:log_time"
            raise InputError(path, f"{topic}:{clock}", "stamps that fall, or none", expected)
    keys = [_distinct(series) for series in stamps.values()]
    every, places = np.unique(np.concatenate(keys), axis=0, return_inverse=True)
    ends = np.cumsum([len(key) for key in keys])
    rows = dict(zip(stamps, np.split(places.ravel(), ends[:-1]), strict=True))
    columns = {}
    for field, (topic, name) in chosen.items():
        columns[field] = np.full(len(every), np.nan)
        columns[field][rows[topic]] = topics[topic][name]
    return columns | {"time": (every[:, 0] - every[:1, 0].sum()) / 1e9}


def _distinct(stamps: NDArray[Any]) -> NDArray[Any]:
    """Return (n, 2) ascending stamps, those that repeat one numbered."""
    return np.column_stack([stamps, np.arange(stamps.size) - np.searchsorted(stamps, stamps)])


def _only_joint(path: Path, names: list[str]) -> dict[str, str | int]:
    """Return the columns of a bag with one joint."""
    joints = [name.removesuffix(".position") for name in names if name.endswith(".position")]
    if len(joints) != 1 or ":" in joints[0]:
        expected = "--columns time=time,input=JOINT.effort,angle=JOINT.position"
        raise InputError(path, "joints", ", ".join(joints) or "none", f"one, or {expected}")
    columns: dict[str, str | int] = {f: f"{joints[0]}.{key}" for f, key in _FIELDS.items()}
    if columns["velocity"] not in names:
        del columns["velocity"]
    return {"time": "time"} | columns


def _topics(path: Path) -> dict[str, Mapping[str, Samples]]:
    """Return the columns of all topics with joint states, by topic."""
    size = require_file(path, "an existing MCAP file")
    try:
        from mcap.reader import make_reader  # noqa: PLC0415 - an extra
        from mcap_ros2.decoder import DecoderFactory  # noqa: PLC0415
    except ImportError:
        raise InputError(path, "content", "MCAP", _EXTRA) from None
    with whole(path, _WHOLE, trusting=True), path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        if summary is None:
            raise InputError(path, "content", "no summary at its end", _WHOLE)
        unpacked = sum(chunk.uncompressed_size for chunk in summary.chunk_indexes)
        if unpacked > most_in(size):
            raise InputError(path, "content", f"chunks of {size_text(unpacked)}", _WHOLE)
        kinds = {number: schema.name for number, schema in summary.schemas.items()}
        channels = summary.channels.values()
        topics = sorted({c.topic for c in channels if kinds.get(c.schema_id) in _TYPES})
        if not topics:
            listing = ", ".join(sorted({*kinds.values()})) or "no messages"
            raise InputError(path, "content", listing, "sensor_msgs/msg/JointState messages")
        return {topic: _columns(reader.iter_decoded_messages(topics=[topic])) for topic in topics}


def _columns(messages: Any) -> Mapping[str, Samples]:  # noqa: ANN401 - mcap's
    """Return stamps in ns, and the values of each joint, by its name or number; NaN if missing."""
    stamps, received = array("q"), array("q")
    rows: dict[str, Any] = {key: [] for key in ("name", *_FIELDS.values())}
    for _, _, message, state in messages:
        stamps.append(state.header.stamp.sec * 10**9 + state.header.stamp.nanosec)
        received.append(message.log_time)
        rows["name"].append(tuple(state.name))
        for key in _FIELDS.values():
            rows[key].append(array("d", getattr(state, key)))
    if len({*rows["name"]}) == 1:
        rows["name"] = rows["name"][0]
    for key in _FIELDS.values():
        if len({*map(len, rows[key])}) == 1:
            rows[key] = np.array(rows[key])
    times = {"time": stamps, "log_time": received}
    exact = {name: np.array(column, dtype=np.int64) for name, column in times.items()}
    return exact | {name: part.of(rows) for name, part in components(rows).items()}
