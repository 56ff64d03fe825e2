"""What a servo's loop is told, and how often it is simulated."""

import pytest

from butterfly.errors import InputError
from butterfly.logs.log import Log
from butterfly.model.servo import ServoLoop
from tests.model.loops import GOAL, TIME


@pytest.mark.parametrize(
    ("told", "field"),
    [
        ({"kp": 1}, "loop.law"),
        ({}, "loop.law"),
        ({"law": "pid-duty", "kp": -1}, "loop.kp"),
        ({"law": "dynamixel", "kp": 1}, "loop.law"),
        ({"law": "pid-duty", "gain": 1}, "loop.gain"),
        ({"law": "pid-duty"}, "loop.kp"),
        ({"law": "odrive", "kp": 20}, "loop.kd"),
        ({"law": "pid-duty", "kp": 1, "clock": 0}, "loop.clock"),
        ({"law": "pid-duty", "kp": 1, "limit": -1}, "loop.limit"),
        ({"law": "pid-duty", "kp": 1, "current_limit": 1}, "loop.current_limit"),
    ],
)
def test_a_slip_in_a_loop_is_named(told, field):
    with pytest.raises(InputError) as refusal:
        ServoLoop.of(told)
    assert refusal.value.field == field
    with pytest.raises(InputError, match="loop"):
        Log(TIME, input=GOAL, angle=GOAL, input_kind="setpoint")


def test_a_loop_is_simulated_at_its_clock_or_at_a_multiple_below_half_a_millisecond():
    for clock, updates in ((4e-4, (4e-4, 1)), (2e-4, (4e-4, 1)), (4e-3, (1e-3, 4))):
        assert ServoLoop.of({"law": "pid-duty", "kp": 1, "clock": clock}).updates(1e-3) == updates
