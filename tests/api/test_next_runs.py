"""The next run is the one by which the goal is reached for the least robot time."""

import pytest

import butterfly as bf
from butterfly.api.campaigns import share_of
from butterfly.identification.design import masses_at_hand
from tests.cli.one_line import assert_one_block


def test_the_next_run_is_not_proposed_twice_for_masses_that_load_alike(data):
    masses = masses_at_hand(data)
    loads = [(mass.inertia, mass.gravity_moment) for mass in masses]
    assert (0.0, 0.0) in loads
    assert len(set(loads)) == len(loads) == 3


def test_the_first_run_needs_the_least_robot_time_and_leads_the_page(results):
    found = results["design"]
    best, *_ = rows = found.rows()
    assert best["robot time in s"] == min(row["robot time in s"] for row in rows)
    assert found.facts()[0][1:] == (best["input"], best["added mass"])
    assert [line[0] for line in found.tables()[0].rows][:2] == ["1", "2"]


def test_costs_and_warnings_of_runs_are_one_table_within_80_columns_and_errors_are_detail(results):
    costs, errors = results["design"].tables()
    assert_one_block(costs)
    doubt = "hypersensitive: its angle is uncertain by 120 % of its swing"
    assert_one_block(costs._replace(rows=[(*row[:-1], doubt) for row in costs.rows]))
    assert {"run", "robot time in s", "reached in %"} < {*costs.headers}
    best = results["design"].rows()[0]
    assert costs.rows[0][1] == f"{best['input']}, {best['added mass']}"
    assert costs.headers[-1] == "warning"
    assert errors.detail
    assert [*errors.headers] == ["", *results["design"].content["parameters"]]
    assert {*costs.headers, *errors.headers} == {"", "run", *best} - {"input", "added mass"}


def test_a_goal_is_a_share_or_in_per_cent():
    assert share_of(0.02) == share_of("2%") == 0.02
    for slip in ("2", "x%", -1, ""):
        with pytest.raises(bf.InputError, match="a share between 0 and 1"):
            share_of(slip)
