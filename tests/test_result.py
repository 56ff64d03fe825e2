"""The one form of all answers in JSON."""

import json
import math

import numpy as np
import pytest

from butterfly.files import json_text, write_document
from butterfly.identification.estimate import left_out_content
from butterfly.identification.residuals import residual_units
from butterfly.model.parameters import AddedMass, JointKind
from butterfly.report.page import PageTable, views
from butterfly.result import Answer, document


def test_numbers_that_are_not_finite_are_null_and_letters_stay_or_are_escaped(tmp_path):
    content = {"values": [1.0, math.nan, {"worst": -math.inf}], "unit": "kg m²"}
    made = document("x", "t", content)
    assert made["values"] == [1.0, None, {"worst": None}]
    write_document(made, tmp_path / "x.json")
    assert "kg m²" in (tmp_path / "x.json").read_text(encoding="utf-8")
    assert json_text(made, ascii_only=True).isascii()
    assert json.loads(json_text(made)) == made


def test_a_page_without_rows_has_each_table_once():
    tables = [PageTable(title, ("a",), [("1",)]) for title in ("First", "More")]
    answer = Answer(kind="x", title="t", content={"rows": [], **views(tables)})
    assert answer.tables() == [table._replace(headers=["a"]) for table in tables]
    assert [part.title for part in answer.page().parts] == ["In numbers", "More"]


def test_a_cell_is_what_a_column_makes_of_a_row_and_a_dash_of_nothing():
    columns = {
        "half": lambda row: row / 2,
        "none": lambda _: None,
        "even": lambda row: row % 2 == 0,
    }
    table = PageTable.of("Numbers", [1.0, 4.0], columns)
    assert table.headers == ("half", "none", "even")
    assert table.rows == [("0.5", "–", "no"), ("2", "–", "yes")]
    assert PageTable.of("Rows", [{"a": 1 / 3, "b": "x"}]).rows == [("0.3333", "x")]


@pytest.mark.parametrize(
    "damage",
    [
        {"rows": []},
        {"rows": [{"a": 1}, {"b": 1}]},
        {"tables": [{"title": "t", "headers": ["a"], "rows": [["1", "2"]]}]},
        {"tables": [{"title": "t", "headers": ["a"], "rows": [[1]]}]},
        {"tables": 3},
    ],
)
def test_a_damaged_answer_is_not_loaded(damage):
    rows = [{"a": 1}, {"a": 2}]
    whole = Answer(kind="x", title="t", content={"rows": rows, **views([PageTable.of("t", rows)])})
    assert Answer.from_dict(whole.to_dict()).to_dict() == whole.to_dict()
    with pytest.raises((KeyError, TypeError, ValueError)):
        Answer.from_dict(whole.to_dict() | damage)


def test_what_a_slide_leaves_over_is_in_metres():
    assert set(residual_units(JointKind.SLIDE).values()) == {"m"}
    assert set(residual_units(JointKind.HINGE).values()) == {"rad"}


def test_estimates_without_a_mass_or_a_log_say_without_what():
    mass = AddedMass(mass=0.05, arm=0.104)
    said = left_out_content(("p1", "p3"), {mass: np.array([1.0, 2.0]), "a.csv": np.array([3, 4])})
    assert [each["without"] for each in said] == [str(mass), "a.csv"]
    assert said[0]["added_mass"]["mass"] == 0.05
    assert said[1]["values"] == {"p1": 3.0, "p3": 4.0}
