"""What the names of columns say, as a draft takes them."""

import pytest

from butterfly.logs.headers import columns_of_joint
from butterfly.logs.reading import draft, open_questions, with_columns
from tests.logs.columns import GOAL

DUTY = {"time": "t_s", "input": "pwm_percent", "angle": "theta"}


@pytest.mark.parametrize(
    ("head", "columns"),
    [
        *(("a,b,c", {}), (",a,b,c", {}), ("Unnamed: 0,a,b,c", {}), ("", {})),
        ("t,u,q", {"time": "t", "input": "u", "angle": "q"}),
        ("secs,counts,note,volts", {"time": "secs", "input": "volts", "angle": "counts"}),
        ("timestamp,position,speed,goal_position", GOAL),
        ("timestamp,position,goal_position,target_position", {**GOAL, "input": None}),
        ("t,q,present_current,goal_current", {"time": "t", "input": "goal_current", "angle": "q"}),
        ("t,v,F,x", {"time": "t"}),
        ("t_s,theta,supply_V,torque_enable,pwm_percent", DUTY),
    ],
)
def test_columns_are_known_by_usual_words_or_are_left_out(tmp_path, head, columns):
    width = max(3, 1 + head.count(","))
    rows = [
        ",".join([str(k), f"{0.1 * k}", *(f"{k % p}.5" for p in (7, 5, 3))][:width])
        for k in range(40)
    ]
    (tmp_path / "a.csv").write_text("\n".join([*([head] if head else []), *rows, ""]))
    drafted = with_columns(draft(tmp_path, {}))
    assert drafted.columns == {field: name for field, name in columns.items() if name}


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        *(("pwm_percent", "duty"), ("duty", "duty"), ("PWM %", "duty"), ("u_volts", "voltage")),
        *(("torque_cmd", "torque"), ("goal_current", "current"), ("effort", "torque")),
        *(("setpoint", "setpoint"), ("target_velocity", "setpoint"), ("goal_rad", "setpoint")),
    ],
)
def test_the_name_of_a_column_says_what_the_input_commands(tmp_path, name, kind):
    rows = [f"{0.1 * k},{k % 7},{k % 5}" for k in range(40)]
    (tmp_path / "a.csv").write_text("\n".join([f"time,{name},angle", *rows, ""]))
    drafted = with_columns(draft(tmp_path, {}))
    assert (drafted.columns["input"], drafted.input) == (name, kind)
    asked = open_questions(drafted, (), named=False)
    assert f"{kind} by the name of {name!r}." in asked["input"]
    assert ("loop" in asked) is (kind == "setpoint")


JOINTS = ("shoulder_pan", "elbow", "wrist", "wrist_roll")


@pytest.mark.parametrize(
    ("joint", "expected"),
    [
        ("elbow", {"time": "time", "input": "effort.elbow", "angle": "position.elbow"}),
        ("wrist", {"time": "time", "input": "tau_wrist", "angle": "wrist_pos"}),
        ("wrist_roll", {"time": "time", "angle": "observation.state.wrist_roll.pos"}),
        ("shoulder_pan", {"time": "time", "input": "action.shoulder_pan.pos"}),
        ("knee", {"time": "time"}),
    ],
)
def test_a_joints_columns_are_those_that_bear_its_name_and_no_longer_one(joint, expected):
    names = ["time", "position.elbow", "effort.elbow", "velocity.elbow", "wrist_pos", "tau_wrist"]
    names += ["observation.state.wrist_roll.pos", "action.shoulder_pan.pos"]
    assert columns_of_joint(names, joint, JOINTS) == expected


def test_a_column_called_as_the_joint_is_its_angle():
    assert columns_of_joint(["t", "elbow"], "elbow", JOINTS) == {"time": "t", "angle": "elbow"}
