"""What a campaign says at its end: goal, next step, parameters, runs; the same on all its views."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import butterfly as bf
from butterfly.api.campaigns import Campaign
from butterfly.campaigns.bench import Limits
from butterfly.campaigns.campaign import CampaignOptions, CampaignResult
from butterfly.campaigns.contact import Contact
from butterfly.campaigns.folder import Journal, Step
from butterfly.cli import output
from butterfly.identification.design import OF_GOAL
from butterfly.logs.log import InputKind
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass
from butterfly.model.prior import Prior

MASS = AddedMass(mass=0.12, arm=0.104)
WISH = CampaignOptions(limits=Limits(command=1.0), masses=(NO_ADDED_MASS, MASS))
BREAKAWAY = 0.04
FIT = 99.6


def step(seconds, shares, mass=NO_ADDED_MASS, **more):
    about = {"what": "relay of 0.2 rad, then free", "why": "to see", "verdict": "good"} | more
    return Step(added_mass=mass, seconds=seconds, shares=shares, **about)


RATIOS = {"p2": 0.16, "p3": 0.02, "p4": 0.04, "coulomb": 0.3}
VALIDATION = step(50.0, {}, MASS, held_out=True, verdict="")


def ended(found, *steps, **more):
    journal = Journal(input_kind=InputKind.VOLTAGE, contact=Contact(1, BREAKAWAY), steps=steps)
    return CampaignResult(
        **{"journal": journal, "identified": found, "reached": True, "ending": ""} | more
    )


def shares_of(estimate, goal):
    """Half-widths over a goal in the values, by hand."""
    return {
        name: max(upper - value, value - lower) / (goal * abs(value))
        for name, value, lower, upper in zip(
            estimate.names, estimate.values, estimate.lower, estimate.upper, strict=True
        )
        if name in OF_GOAL
    }


def told(result, wish=WISH, **more):
    """The campaign of an estimate in two runs, and one that was held out."""
    known = step(36.0, shares_of(result.estimate, wish.goal), MASS)
    steps = more.pop("steps", (step(20.0, RATIOS), known, VALIDATION))
    return Campaign.of(ended(result, *steps, **more), wish, Path("my folder"))


@pytest.fixture(scope="module")
def reached(result):
    return told(replace(result, held_out={"run_002.parquet": FIT}))


@pytest.fixture(scope="module")
def open_scale(data):
    """Only ratios: identified with p1 = 1, which nobody has given, as campaigns do it."""
    bare = [k for k, log in enumerate(data.logs) if not log.added_mass.mass]
    found = bf.identify(data.take(bare).knowing(Prior.of({"p1": 1.0})), terms=())
    first = step(20.0, shares_of(found.estimate, 0.01))
    more = {"steps": (first,), "reached": False, "ending": "nothing more is known"}
    return told(found, replace(WISH, masses=(NO_ADDED_MASS,)), **more)


def test_the_first_line_says_whether_the_goal_is_reached_and_the_second_what_to_do(reached):
    first, second, verdict, *_ = reached.summary
    assert first == ("The goal of 1 % is reached: 50 s of robot time, 3 runs, 1 change of mass.")
    assert "Next: `butterfly identify 'my folder' --report page.html`" in second
    assert "`butterfly export 'my folder' --out twin.xml`" in second
    assert verdict.startswith("Good: p1 ±")
    assert reached.summary[-1].endswith(f"has a FIT of {FIT} %.")


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
    found = Campaign.of(nothing, WISH, Path("a"))
    assert found.summary[1].startswith("It does not follow. Next: `butterfly inspect a`")
    assert found.rows()[0]["verdict"] == "no estimate"
    found.report(tmp_path / "page.html")
    assert "Goal missed" in (tmp_path / "page.html").read_text(encoding="utf-8")


def test_before_any_run_more_robot_time_is_what_is_missing():
    found = Campaign.of(ended(None, reached=False, ending="no time"), LATE, Path("a"))
    assert found.summary[0].endswith("0 s of robot time, 0 runs, no change of mass.")
    assert "`--seconds 120`" in found.summary[1]
    assert not found.tables()


@pytest.mark.parametrize("folder", ["/elsewhere/runs", "runs", Path.cwd() / "runs"])
def test_what_is_said_has_no_path_of_this_machine(folder):
    found = Campaign.of(ended(None), WISH, Path(folder))
    assert "`butterfly export runs --out twin.xml`" in found.summary[1]


def test_the_parameters_are_those_of_identify_beside_their_share_of_the_goal(reached, result):
    table, runs = reached.tables()
    theirs = result.tables()[0]
    place = table.headers.index("of the goal")
    own = [(*row[:place], *row[place + 1 :]) for row in table.rows]
    assert own == [tuple(row) for row in theirs.rows]
    shares = {str(row[0]): row[place] for row in table.rows}
    for name, share in shares_of(result.estimate, 0.01).items():
        assert float(shares[name].removesuffix(" %")) == pytest.approx(100 * share, rel=0.06)
    assert shares["delay"] == "–"
    assert [row[-2] for row in runs.rows] == ["ratios only", "good", "held out"]


def test_the_json_has_the_parameters_with_intervals_units_and_the_goal_in_per_cent(reached, result):
    found = json.loads(json.dumps(reached.to_dict()))
    rows = {row["parameter"]: row for row in result.rows()}
    assert found["summary"][0].startswith("The goal of 1 % is reached")
    assert found["parameters"].keys() == rows.keys()
    for name, each in found["parameters"].items():
        assert {key: each[key] for key in rows[name] if key != "parameter"} == {
            key: value for key, value in rows[name].items() if key != "parameter"
        }
    for name, share in shares_of(result.estimate, 0.01).items():
        assert found["parameters"][name]["half_width"] == pytest.approx(share)
        assert found["parameters"][name]["wanted"] == pytest.approx(1.0)
    assert found["units"]["parameters.wanted"] == "%"


def test_without_a_scale_the_parameters_are_ratios_to_p1(open_scale, data):
    first, second, verdict, *_ = open_scale.summary
    assert "not reached" in first
    assert "only ratios to p1 are known" in second
    assert "`--known p4=VALUE`" in second
    assert verdict.startswith("Good: p4/p1 ±")
    table, runs = open_scale.tables()
    assert table.title == "Parameters, ratios to p1"
    assert [str(row[0]) for row in table.rows][:4] == ["p2/p1", "p3/p1", "p4/p1", "coulomb/p1"]
    assert "N m/(kg m²)" in table.rows[1]
    assert open_scale.content["ratios"]
    true = bf.read_experiment("quickstart").plant.robot.lumped
    value = open_scale.content["parameters"]["p3"]["value"]
    assert value == pytest.approx(true.p3 / true.p1, rel=0.01)
    assert [row[-2] for row in runs.rows] == ["ratios only"]
    assert data.logs[0].input_kind == "voltage"
    assert "ratios to p1" in open_scale.page().sections[0].text
    assert open_scale.facts()[-1][1:] == ("0.04 V", "command")


def test_it_says_at_what_torque_the_joint_breaks_away(reached, result):
    torque = BREAKAWAY * result.estimate.named["p4"]
    fact = reached.facts()[-1]
    assert fact.value == f"{torque:.2g} N m"
    assert fact.detail == "a command of 0.04 V"


def test_intervals_shrink_in_per_cent_of_the_value_towards_the_goal(reached, result):
    figure = reached.figures()["shrinking"]
    axis, traces = figure.layout.yaxis, {trace.name: trace for trace in figure.data}
    marks = dict(zip(axis.tickvals, axis.ticktext, strict=True))
    assert {marks[each] for each in (0.1, 1.0, 10.0, 100.0)} == {"0.1 %", "1 %", "10 %", "100 %"}
    assert all(re.fullmatch(r"[01.]+ %", text) for text in axis.ticktext)
    low, high = axis.range
    assert high - low >= 1
    assert low < np.log10(min(traces["p4"].y)) < 0 < high
    assert traces["p4"].y[1] == pytest.approx(shares_of(result.estimate, 0.01)["p4"])
    # of ratios half of the goal is wanted while another mass is to come
    assert [*traces["goal"].y] == [0.5, 0.5, 1.0, 1.0, 1.0, 1.0]
    assert [*traces["goal"].x] == [0.0, 20.0, 20.0, 36.0, 36.0, 50.0]
    assert traces["p2"].y[0] == pytest.approx(0.16 * 0.5)


def test_a_saved_campaign_shows_what_it_showed(reached, open_scale, tmp_path):
    for found in (reached, open_scale):
        found.save(tmp_path / "saved.json")
        again = bf.load(tmp_path / "saved.json")
        assert again.to_dict() == found.to_dict()
        assert (str(again), again.tables(), again.facts()) == (
            str(found),
            found.tables(),
            found.facts(),
        )
        assert again.page().headed == found.page().headed
        assert [*again.figures()] == ["shrinking", "played"]


def test_the_page_has_the_goal_on_top_then_the_parameters(reached, tmp_path):
    reached.report(tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    places = [
        text.index(part)
        for part in ("Goal reached", "The goal of 1 % is reached", "Next:", 'id="parameters"')
    ]
    assert places == sorted(places)
    assert text.index('id="parameters"') < text.index("Good: p1 ±") < text.index(">Runs<")


def test_a_command_prints_the_goal_above_the_verdict_and_keeps_both_if_quiet(
    reached, capsys, monkeypatch
):
    output.show(reached)
    printed = capsys.readouterr().out.splitlines()
    assert printed[:4] == list(reached.summary[:4])
    monkeypatch.setattr(output, "asked", output.OutputOptions(quiet=True))
    output.show(reached)
    assert capsys.readouterr().out.splitlines() == list(reached.summary[:4])
