"""What results say for programs."""

import json

import pytest

from butterfly.report.numbers import write_columns


def test_the_numbers_beside_the_page_say_what_is_left_over(page, simulated):
    residuals = simulated[0].residuals
    numbers = json.loads(page.with_suffix(".json").read_text(encoding="utf-8"))
    assert numbers["residuals"]["times_sensors"] == pytest.approx(residuals.times)
    assert numbers["residuals"]["findings"][0]["kind"] == "followed"


def test_no_text_of_an_export_is_a_formula(tmp_path):
    columns = {"name": ["=1+1", "plain", None, "@x", "-2"], "value": [-1.0, 2, 3, 4, 5]}
    write_columns(tmp_path / "x.csv", "table", columns)
    _, *lines = (tmp_path / "x.csv").read_text(encoding="utf-8").splitlines()
    assert lines == ['"\'=1+1",-1', '"plain",2', ",3", '"\'@x",4', '"\'-2",5']
