"""What a campaign says at its end: whether the goal is reached, and what to do next."""

import re
from dataclasses import replace
from pathlib import Path

import pytest

from butterfly.api.campaigns import campaign_answer
from butterfly.campaigns.bench import Limits
from butterfly.identification.design import OF_GOAL
from tests.campaigns.ended import MASS, WISH, ended, step, told

WIDE = dict.fromkeys(OF_GOAL, 0.5) | {"p2": 1.5}
LATE = replace(WISH, limits=Limits(command=1.0, seconds=60.0))
MISSED = {
    "no time": (LATE, WIDE, {}, "`--seconds 120`"),
    "friction": (WISH, WIDE, {"misses": "stribeck"}, "`butterfly residual 'my folder'`"),
    "in vain": (WISH, WIDE, {}, "`--goal 1.5%`"),
}


@pytest.mark.parametrize("case", MISSED)
def test_of_a_goal_that_is_missed_it_says_why_and_what_leads_on(result, case):
    wish, shares, more, action = MISSED[case]
    steps = (step(50.0, shares, MASS, **more),)
    found = told(result, wish, steps=steps, reached=False, ending="p2 is too wide")
    first, second, *_ = found.summary
    assert first == "The goal of 1 % is not reached: 50 s of robot time, 1 run, no change of mass."
    assert second.startswith("P2 is too wide. Next: ")
    assert action in second
    assert any(re.match(r"Too wide: p2 ± \S+ % \(", line) for line in found.summary)


def test_a_campaign_without_an_estimate_sends_to_the_logs_and_shows_its_runs(tmp_path):
    nothing = ended(None, step(12.0, {}, verdict=""), reached=False, ending="it does not follow")
    found = campaign_answer(nothing, WISH, Path("a"))
    assert found.summary[1].startswith("It does not follow. Next: `butterfly inspect a`")
    assert found.rows()[0]["verdict"] == "no estimate"
    found.report(tmp_path / "page.html")
    assert "Goal missed" in (tmp_path / "page.html").read_text(encoding="utf-8")


def test_before_any_run_more_robot_time_is_what_is_missing():
    found = campaign_answer(ended(None, reached=False, ending="no time"), LATE, Path("a"))
    assert found.summary[0].endswith("0 s of robot time, 0 runs, no change of mass.")
    assert "`--seconds 120`" in found.summary[1]
    assert not found.tables()


@pytest.mark.parametrize("folder", ["/elsewhere/runs", "runs", Path.cwd() / "runs"])
def test_what_is_said_has_no_path_of_this_machine(folder):
    found = campaign_answer(ended(None), WISH, Path(folder))
    assert "`butterfly export runs --out twin.xml`" in found.summary[1]
