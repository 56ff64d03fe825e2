"""Tables with a row per topic, as of recorded messages: the last command is held in between."""

import json
from importlib.util import find_spec

import numpy as np
import pandas as pd
import pytest

from butterfly.errors import InputError
from butterfly.logs.formats import read_log
from butterfly.logs.health import Repair, examine
from butterfly.logs.log import Log
from butterfly.verdict import Level
from tests.logs.written import JOINT_STATE

COUNT = 300
CLOCK = 0.01 * np.arange(COUNT)
LATE = CLOCK + 0.003
COMMAND, ANGLE = np.sin(3 * CLOCK), np.sin(3 * LATE - 0.5)
COMMANDS = pd.DataFrame({"time": CLOCK[::3], "input": COMMAND[::3]})
ANGLES = pd.DataFrame({"time": LATE, "angle": ANGLE})
SPARSE = pd.concat([COMMANDS, ANGLES]).sort_values("time")
HELD = COMMAND[::3][np.arange(COUNT) // 3]


def _json(frame, path):
    rows = [{k: v for k, v in row.items() if np.isfinite(v)} for row in frame.to_dict("records")]
    path.write_text("".join(f"{json.dumps(row)}\n" for row in rows))


WRITERS = {
    "csv": lambda frame, path: frame.to_csv(path, index=False),
    "parquet": pd.DataFrame.to_parquet,
    "jsonl": _json,
}


@pytest.mark.parametrize("form", WRITERS)
def test_the_last_command_is_held_and_that_is_said(tmp_path, form):
    path = tmp_path / f"log.{form}"
    WRITERS[form](SPARSE, path)
    clean, health = examine(read_log(path))
    np.testing.assert_array_equal(clean.time, LATE)
    np.testing.assert_array_equal(clean.input, HELD)
    np.testing.assert_array_equal(clean.angle, ANGLE)
    (remark,) = [each for each in health.remarks if each.condition is not Level.GOOD]
    assert remark.condition is Level.NOTE
    assert "held between its rows: input in 300 samples" in remark.text
    assert "delay" in remark.hint


def _log(frame=SPARSE, **more):
    columns = {name: frame[name].to_numpy() for name in frame}
    return Log(**columns, **more)


def test_topics_may_follow_one_another_and_a_sampled_input_is_interpolated():
    clean, _ = examine(_log(pd.concat([COMMANDS, ANGLES])))
    np.testing.assert_array_equal(clean.input, HELD)
    clean, health = examine(_log(intersample="first_order_hold"))
    np.testing.assert_allclose(clean.input, np.interp(LATE, CLOCK[::3], COMMAND[::3]))
    assert "interpolated" in health.findings[0]


def test_rows_before_the_first_command_are_left_out_and_a_slow_supply_is_held():
    supply = pd.DataFrame({"time": CLOCK[::100], "supply": [12.0, 11.0, 10.0]})
    late = COMMANDS[COMMANDS["time"] >= 0.6]
    clean, health = examine(_log(pd.concat([late, ANGLES, supply]).sort_values("time")))
    np.testing.assert_array_equal(clean.time, LATE[60:])
    np.testing.assert_array_equal(clean.supply, [12.0] * 40 + [11.0] * 100 + [10.0] * 100)
    assert "supply in 300 samples" in health.findings[0]


def test_a_clock_that_falls_is_refused_and_so_is_what_no_repair_would_leave(tmp_path):
    falling = pd.concat([SPARSE, SPARSE])
    with pytest.raises(InputError, match=r"input: got nothing in 600 of 600 rows .*ascending"):
        examine(_log(falling))
    ANGLES.assign(input=np.nan).to_csv(tmp_path / "none.csv", index=False)
    for repairs in ((), Repair):
        with pytest.raises(InputError, match=r"0 rows with a number in every column .*0 of input"):
            examine(read_log(tmp_path / "none.csv"), repairs)


def test_a_log_that_lacks_some_inputs_is_refused_as_before():
    gaps = pd.DataFrame({"time": CLOCK, "input": COMMAND, "angle": ANGLE})
    gaps.loc[10:20, "input"] = np.nan
    with pytest.raises(InputError, match=r"nan at sample 10 \(11 such.*--repair non_finite"):
        examine(_log(gaps))
    assert examine(_log(gaps), {Repair.NON_FINITE})[1].dropped == 11


@pytest.mark.skipif(find_spec("mcap_ros2") is None, reason="of an extra")
def test_command_and_angle_of_two_topics_of_a_bag_are_joined_by_their_stamps(tmp_path):
    from mcap_ros2.writer import Writer  # noqa: PLC0415 - of an extra

    begin, rows = 10**18, {"/command": COMMANDS, "/joint_states": ANGLES}
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = Writer(file)
        schema = writer.register_msgdef("sensor_msgs/msg/JointState", JOINT_STATE)
        for topic, frame in rows.items():
            for time, value in frame.to_numpy():
                stamp = begin + round(time * 1e9)
                seconds = dict(zip(("sec", "nanosec"), divmod(stamp, 10**9), strict=True))
                parts = {"position": [value], "velocity": [], "effort": [value]}
                header = {"stamp": seconds, "frame_id": ""}
                message = {"header": header, "name": ["hand"], **parts}
                writer.write_message(topic, schema, message, log_time=stamp)
        writer.finish()
    columns = {"time": "/joint_states:time", "angle": "/joint_states:hand.position"}
    log = read_log(tmp_path / "a.mcap", columns | {"input": "/command:hand.effort"})
    clean, _ = examine(log)
    np.testing.assert_allclose(clean.time, LATE, atol=1e-9)
    np.testing.assert_array_equal(clean.input, HELD)
    np.testing.assert_array_equal(clean.angle, ANGLE)
