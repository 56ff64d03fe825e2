"""What may be the cause of a contrast."""

import pytest

from butterfly.identification.agreement import Condition, Contrast
from butterfly.report.parameter_table import causes


@pytest.mark.parametrize(
    ("name", "condition", "last", "first", "absent"),
    [
        ("p4", Condition.FREQUENCY, 1.1, "an elastic joint", "drive lag"),
        ("p4", Condition.FREQUENCY, 0.9, "drive lag", "backlash"),
        ("delay", Condition.SPEED, 1.1, "backlash", "drive lag"),
        ("delay", Condition.SPEED, 0.9, "a friction term missing in the model", "backlash"),
    ],
)
def test_causes_depend_on_whether_a_parameter_grows(name, condition, last, first, absent):
    ends = {"least": 1.0, "largest": 2.0, "first": 1.0, "last": last}
    named = causes(Contrast(parameter=name, condition=condition, **ends, share=0.5, chance=0.0))
    assert named[0] == first
    assert absent not in named
