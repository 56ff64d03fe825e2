"""The robot of an experiment, by its masses, lengths and motor; what logs can tell."""

import math

import numpy as np
import pytest

import butterfly as bf
from butterfly.api.inspected import robot_of, unusable_logs

GRAVITY = 9.81


def test_the_robot_of_an_experiment_is_told_with_the_mass_that_it_carries(quick):
    found = bf.inspect(quick, added_mass=0.05, arm=0.2)
    told = {row["parameter"]: row["value"] for row in found.rows()}
    p1 = 0.003 + 0.1 * 0.05**2 + 0.05 * 0.2**2
    p2 = 2e-4 + 0.05 * 0.05 / 2.0  # with the back EMF
    p3 = GRAVITY * (0.1 * 0.05 + 0.05 * 0.2)
    wanted = {"p1": p1, "p2": p2, "p3": p3, "p4": 0.05 / 2.0, "coulomb": 3e-4}
    assert {name: told[name] for name in wanted} == pytest.approx(wanted)
    peak = math.sqrt(p3 / p1 - (p2 / p1) ** 2 / 2)
    assert found.to_dict()["resonance"] == pytest.approx(peak)


def test_what_is_loaded_lists_the_robot_that_an_experiment_names(quick, tmp_path):
    found = bf.inspect(quick)
    found.save(tmp_path / "robot.json")
    again = bf.load(tmp_path / "robot.json")
    assert again.tables() == found.tables()
    assert str(again) == str(found)
    named = robot_of(quick, hand_mass=None, added_mass=0.0, arm=None)
    assert named.twin.name == "quickstart"
    assert named.judged is None


def test_its_first_line_says_whose_values_these_are(quick):
    first, *_ = bf.inspect(quick).summary
    assert first == "The robot that 'quickstart' simulates: its true values."


def test_its_rows_are_its_parameters_with_their_units(quick):
    units = {row["parameter"]: row["unit"] for row in bf.inspect(quick).rows()}
    assert [*units][:4] == ["p1", "p2", "p3", "p4"]
    assert (units["p1"], units["p4"]) == ("kg m²", "N m/V")


def test_an_inspection_forecasts_on_the_logs_that_are_fitted(quick_data, results, tmp_path):
    found = results["inspection"]
    assert [row["word"] for row in found.content["before_fit"]] == ["identifiable"] * 6
    assert "identifiable" in found._repr_html_()
    found.save(tmp_path / "seen.json")
    assert unusable_logs(bf.load(tmp_path / "seen.json")) == 0
    alone = bf.inspect(quick_data / found.rows()[0]["log"], known={"p4": 0.025})
    assert alone.rows()[0]["log"] in (cell := alone._repr_html_())
    assert "identifiable" in cell[cell.index("<table") :]
    assert results["one log"].content["before_fit"] == []  # one log tells less than the data set
    told = bf.inspect(quick_data, holdout=["of no log", "*"])
    assert told.content["before_fit"] == []  # the first pattern does not undo the second


def test_what_is_true_of_all_logs_is_said_once_with_their_number(tmp_path):
    time = np.arange(0.0, 8.0, 0.4)
    for number in (1, 2, 3):
        angle = 0.1 * number * np.sin(time)
        table = np.column_stack([time, 0.1 * np.cos(time), angle])
        lines = "time,input,angle\n" + "\n".join(",".join(map(repr, row)) for row in table.tolist())
        (tmp_path / f"{number}.csv").write_text(lines, encoding="utf-8")
    found = bf.inspect(tmp_path, known={"p4": 1.0})
    assert found.summary.count("All 3 logs: only one sample every 0.4 s.") == 1
    assert not any("one sample every" in cell for row in found.tables()[0].rows for cell in row)
    assert all("one sample every" in str(row["findings"]) for row in found.rows())
