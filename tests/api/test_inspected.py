"""The robot of an experiment, by its masses, lengths and motor."""

import math

import pytest

import butterfly as bf
from butterfly.api.inspected import robot_of

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
