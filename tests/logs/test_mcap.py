"""ROS 2 bags in MCAP, written by the library that others write them with."""

from types import SimpleNamespace

import numpy as np
import pytest

from butterfly.errors import InputError
from butterfly.logs.formats import read_log
from butterfly.logs.log import InputKind
from butterfly.logs.mcap import _columns
from tests.logs.written import write_bag

pytest.importorskip("mcap_ros2")

KIND = {"input_kind": InputKind.TORQUE}
BEGIN = 1_700_000_000 * 10**9
STEP = 2_000_000  # ns
COUNT = 50
_FACTORS = {"position": 1.0, "velocity": 10.0, "effort": -1.0}
ANGLE = np.cos(np.arange(COUNT) / 7)


def _write(path, *, joints=("hand",), keys="pve", **how):
    parts = {
        name: factor * ANGLE[:, None] + np.arange(len(joints)) for name, factor in _FACTORS.items()
    }
    parts = {name: each if name[0] in keys else each[:, :0] for name, each in parts.items()}
    with path.open("wb") as file:
        write_bag(file, BEGIN + STEP * np.arange(COUNT), parts, joints=joints, **how)
    return path


def test_the_only_joint_of_a_bag_is_read_with_its_own_stamps(tmp_path):
    log = read_log(_write(tmp_path / "bag.mcap"), **KIND)
    np.testing.assert_array_equal(log.time, np.arange(COUNT) * STEP / 1e9)
    np.testing.assert_array_equal(log.angle, ANGLE)
    np.testing.assert_array_equal(log.input, -ANGLE)
    np.testing.assert_array_equal(log.velocity, 10 * ANGLE)


def test_of_several_joints_or_topics_one_is_named(tmp_path):
    path = _write(tmp_path / "bag.mcap", joints=("hand", "arm"))
    columns = {"time": "log_time", "input": "hand.effort", "angle": "arm.position"}
    log = read_log(path, columns, **KIND)
    np.testing.assert_array_equal(log.angle, ANGLE + 1)
    np.testing.assert_allclose(log.time[:4], [0, 0.002005, 0.00401, 0.006])
    with pytest.raises(
        InputError, match=r"joints: got hand, arm; expected one, or --columns time="
    ):
        read_log(path, **KIND)
    _write(path, topics=("/a", "/b"))
    columns = {"time": "/a:time", "input": "/a:hand.effort", "angle": "/b:hand.position"}
    np.testing.assert_array_equal(read_log(path, columns, **KIND).angle, ANGLE)


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ({"keys": "pv"}, r"hand\.effort: got no such column; .*'hand\.position'"),
        ({"stamped": False}, "time: got 0 throughout; expected timestamps .* time=log_time"),
        ({"kind": "my_msgs/msg/JointState"}, "got my_msgs/msg/JointState, std_msgs/msg/Float64"),
        ({"joints": ()}, "joints: got none; expected one"),
    ],
)
def test_what_a_bag_lacks_is_named(tmp_path, how, said):
    with pytest.raises(InputError, match=said):
        read_log(_write(tmp_path / "bag.mcap", **how), **KIND)


def test_a_joint_that_some_messages_leave_out_is_missing_there():
    states = [
        SimpleNamespace(name=["a"], position=[1.0], velocity=[], effort=[]),
        SimpleNamespace(name=["b"], position=[2.0], velocity=[], effort=[]),
    ]
    stamp = SimpleNamespace(stamp=SimpleNamespace(sec=0, nanosec=0))
    messages = [(0, 0, SimpleNamespace(log_time=0), each) for each in states]
    for each in states:
        each.header = stamp
    found = _columns(messages)
    np.testing.assert_array_equal(found["a.position"], [1.0, np.nan])
    np.testing.assert_array_equal(found["b.position"], [np.nan, 2.0])


def test_a_bag_cut_or_damaged_anywhere_is_one_line(tmp_path):
    whole = _write(tmp_path / "bag.mcap").read_bytes()
    rng = np.random.default_rng(0)
    for number in range(150):
        damaged = bytearray(whole)
        place = int(rng.integers(len(whole)))
        if number % 2:
            damaged = damaged[:place]
        else:
            damaged[place] ^= 1 << int(rng.integers(8))
        (tmp_path / "bag.mcap").write_bytes(damaged)
        try:
            log = read_log(tmp_path / "bag.mcap", **KIND)
        except InputError:
            continue
        np.testing.assert_array_equal(log.angle, ANGLE)
