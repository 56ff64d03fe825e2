"""What is said of a robot that was watched."""

from types import SimpleNamespace

import numpy as np
import pytest

from butterfly.orbit.online import Alarm, Cause
from butterfly.report.orbit_page import watch_sentences

ALARM = {"time": 44.0, "since": (39.5, 41.25), "statistic": 9.0}
ALONE = Cause(name="p2", before=2.0, after=2.2, lower=2.1, upper=2.3)
NOT_ALONE = Cause(name="p2", before=2.0, after=2.2, lower=2.1, upper=2.3, probability=0.0)
FELL = Cause(name="p3", before=4.0, after=3.0, lower=2.0, upper=3.5)
STAYED = Cause(name="p4", before=1.0, after=1.01, lower=0.99, upper=1.03)
BEGINS = "The robot changed between 39.5 and 41.2 s, noticed at 44.0 s, 2 periods after it"


def _watched(*alarms):
    """Two minutes of an orbit of 2 s, in which the robot changed at 40 s."""
    parts = {"change": SimpleNamespace(at=40.0), "orbit": SimpleNamespace(period=2.0)}
    log = SimpleNamespace(time=np.linspace(5.0, 125.0, 100))
    return SimpleNamespace(**parts, log=log, detector=SimpleNamespace(alarms=[*alarms]))


@pytest.mark.parametrize(
    ("causes", "ratios", "ends"),
    [
        ((), (), "; more motion is needed to see which parameter changed."),
        ((ALONE,), (FELL,), ": p2 by +10 % (+5 to +15 %), if only one parameter changed."),
        ((NOT_ALONE,), (FELL, STAYED), ": several parameters, p3/p1 by -25 % (-50 to -12.5 %)."),
    ],
)
def test_an_alarm_is_said_with_what_explains_it(causes, ratios, ends):
    alarm = Alarm(**ALARM, causes=causes, ratios=ratios)
    assert watch_sentences(_watched(alarm)) == [BEGINS + ends]


def test_without_an_alarm_it_is_said_for_how_long_the_robot_was_watched():
    assert watch_sentences(_watched()) == ["Watched for 2 min: the robot did not change."]
