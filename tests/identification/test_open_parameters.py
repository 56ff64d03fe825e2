"""Joints that show friction or gain alone: these are answered, and the inertia is open."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import butterfly as bf
from butterfly.cli.next_command import next_command
from butterfly.errors import IdentifiabilityError
from butterfly.identification.design import next_experiments, wanted
from butterfly.identification.estimate import Estimate
from butterfly.verdict import Level
from tests.independent.slow_joints import NOTHING_HOLDS, creeping, played, steady


def _identified(logs):
    return bf.identify(bf.read(logs, known=NOTHING_HOLDS))


@cache
def _answer(draw, number):
    """Return what is identified of a joint, and the truth."""
    logs, truth = draw(number)
    return _identified(logs), truth


def _outside(found, truth):
    """Return the parameters whose intervals do not hold the truth, inertia and friction apart.

    Those of friction by half of their width: one in twenty is outside by less.
    """
    rows = {row.name: row for row in found.estimate.table()}
    more = {name: (row.upper - row.lower) / 4 for name, row in rows.items()} | {"p1": 0.0}
    off = [
        name
        for name, true in truth.items()
        if not rows[name].lower - more[name] <= true <= rows[name].upper + more[name]
    ]
    return "p1" in off, [name for name in off if name != "p1"]


def _judge(draw, numbers):
    """Return how many are usable, how many have an open inertia, and the wrong ones."""
    usable, opened, inertias, frictions = 0, 0, [], []
    for number in numbers:
        found, truth = _answer(draw, number)
        if not found.judged.level.usable:
            continue
        usable += 1
        opened += found.estimate.open == ("p1",)
        inertia, friction = _outside(found, truth)
        inertias += [number] if inertia else []
        frictions += [(number, friction)] if friction else []
    return usable, opened, inertias, frictions


def test_slow_speeds_show_friction_and_leave_the_inertia_open():
    usable, opened, inertias, frictions = _judge(creeping, (1, 4))
    assert (usable, opened, inertias, frictions) == (2, 2, [], [])


def test_levels_of_a_viscous_joint_show_its_gain_and_leave_the_inertia_open():
    usable, opened, inertias, frictions = _judge(steady, (0, 3))
    assert (usable, opened, inertias, frictions) == (2, 2, [], [])


@pytest.mark.slow
def test_of_thirty_slow_joints_hardly_one_is_lost_and_no_friction_is_wrong():
    friction, gain = _judge(creeping, range(20)), _judge(steady, range(10))
    assert friction[0] >= 19
    assert gain[0] == 10
    assert not friction[3]
    assert not gain[3]
    assert len(friction[2]) + len(gain[2]) <= 1


@pytest.fixture(scope="module")
def found():
    return _answer(steady, 0)[0]


def test_the_first_line_says_what_is_known_and_open_and_the_second_which_run_closes_it(found):
    first, second, *_ = found.verdict
    assert first.startswith("Good: p2 ±")
    assert "coulomb ±" in first
    assert "open: p1 (at most 0.00" in first
    assert "p1 ±" not in " ".join(found.summary)
    assert "p1 open" in repr(found)
    assert second.startswith("To know p1, add a run that reverses faster")
    assert "butterfly design" in second


def test_an_open_value_is_none_with_its_limits_for_programs(found):
    row = next(row for row in found.rows() if row["parameter"] == "p1")
    assert row["value"] is None
    assert row["standard_error"] is None
    assert row["lower"] == 0.0
    assert 0.0 < row["upper"] < 0.01
    numbers = found.to_dict()
    assert numbers["parameters"]["p1"]["claim"] == "open"
    assert numbers["parameters"]["p1"]["value"] is None
    shown = found.printed()
    row = next(row for row in shown.rows if row[0] == "p1")
    assert row[shown.headers.index("value")] == "open"


def test_a_limit_is_rounded_up(found):
    row = next(row for row in found.rows() if row["parameter"] == "p1")
    said = found.verdict[0].partition("at most ")[2].partition(" ")[0]
    assert row["upper"] <= float(said) <= 1.1 * row["upper"]


def test_a_saved_result_is_as_open_as_before(found, tmp_path):
    found.save(tmp_path / "joint.json")
    again = bf.load(tmp_path / "joint.json")
    assert again.estimate.open == ("p1",)
    assert again.verdict == found.verdict
    assert again.rows() == found.rows()
    assert again.estimate.named == found.estimate.named
    content = json.loads((tmp_path / "joint.json").read_text())
    assert Estimate.from_dict(content).open == ("p1",)


def test_what_needs_the_inertia_says_so(found):
    for use in (
        lambda: found.model,
        lambda: bf.predict(found.data, found),
        lambda: bf.draws(found),
        lambda: bf.compare(found),
    ):
        with pytest.raises(IdentifiabilityError, match=r"p1 is open, and a .* needs it: add a run"):
            use()


def test_the_next_command_plans_the_run_that_closes_it(found):
    assert next_command(found, ["identify", "my"], ["my"]).endswith("--save joint.json")
    assert next_command(found, ["identify", "my"], ["my"], "a.json") == "butterfly design a.json"
    plan = bf.design(found)
    assert plan.summary[0].startswith("Run next: ")


def test_its_page_has_no_sliders_and_names_it_open(found, tmp_path):
    found.report(tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    assert "No sliders: p1 is open." in page


@pytest.mark.slow
def test_the_planned_run_closes_the_inertia():
    logs, truth = creeping(4)
    before = _identified(logs)
    assert before.estimate.open == ("p1",)
    aim = wanted(before.estimate.at_limit, before.data.logs, 0.01)
    plan, *_ = next_experiments(before.data, before.estimate, aim, duration=40.0, price=120.0)
    stamps = 5e-3 * np.arange(8000)
    after = _identified(played(logs, truth, plan.recipe.signal.sample(stamps), stamps))
    rows = {row.name: row for row in after.estimate.table()}
    limit = {row.name: row for row in before.estimate.table()}["p1"].upper
    assert rows["p1"].lower <= truth["p1"] <= rows["p1"].upper
    assert rows["p1"].upper < 0.5 * limit


def test_a_scale_that_is_open_leaves_the_verdict_to_the_other_values(found):
    estimate = found.estimate
    assert estimate.level is Level.GOOD
    friction = np.array([name in {"p2", "coulomb"} for name in estimate.names])
    wide = np.where(friction, 0.5 * estimate.values, 0.0)
    rough = replace(estimate, lower=estimate.lower - wide, upper=estimate.upper + wide)
    assert rough.level is Level.CARE
    nothing = replace(rough, upper=rough.upper + 2 * wide)
    assert nothing.level is Level.CARE
