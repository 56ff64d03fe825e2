"""The page of a campaign."""

import re

import numpy as np
import pytest

from butterfly.verdict import Level
from tests.campaigns.ended import shares_of, within_goal


@pytest.fixture(scope="module")
def reached(result):
    return within_goal(result)


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


def test_the_page_has_the_goal_on_top_then_the_parameters(reached, tmp_path):
    reached.report(tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    places = [
        text.index(part)
        for part in ("Goal reached", "The goal of 1 % is reached", "Next:", 'id="parameters"')
    ]
    assert places == sorted(places)
    assert text.index('id="parameters"') < text.index("Good: p1 ±") < text.index(">Runs<")


def test_verdicts_of_runs_and_parameters_are_badges_and_what_is_no_verdict_is_text(reached):
    lead, *sections = reached.page().parts
    chips = [cell for row in lead.tables[0].rows for cell in row if getattr(cell, "level", None)]
    assert {(cell.text, cell.level) for cell in chips} >= {("good", Level.GOOD)}
    (runs,) = (table for section in sections for table in section.tables if section.title == "Runs")
    verdicts = [row[runs.headers.index("verdict")] for row in runs.rows]
    levels = {str(cell): getattr(cell, "level", None) for cell in verdicts}
    assert levels["good"] is Level.GOOD
    assert levels.get("ratios only") is None
