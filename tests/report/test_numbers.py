"""What is told as numbers for programs."""

import json
import math

import numpy as np

from butterfly.document import HEAD, Told, json_text, write_document
from butterfly.identification.estimate import left_out_content
from butterfly.model.parameters import AddedMass, JointKind
from butterfly.report.numbers.estimate_numbers import misfit_units, without_root
from butterfly.verdict import Level, Verdict


def test_numbers_that_are_not_finite_are_null_and_letters_stay_or_are_escaped(tmp_path):
    content = {"values": [1.0, math.nan, {"worst": -math.inf}], "unit": "kg m²"}
    document = Told(kind="x", title="t", content=content).document()
    assert document["values"] == [1.0, None, {"worst": None}]
    write_document(document, tmp_path / "x.json")
    assert "kg m²" in (tmp_path / "x.json").read_text(encoding="utf-8")
    assert json_text(document, ascii_only=True).isascii()
    assert json.loads(json_text(document)) == document


def test_a_document_begins_alike_with_and_without_a_verdict():
    verdict = Verdict(Level.CARE, ("Few logs.",))
    judged = Told(kind="x", title="t", verdict=verdict).document()
    plain = Told(kind="x", title="t").document()
    assert list(judged) == list(plain) == list(HEAD)
    assert (judged["verdict"], judged["reasons"]) == ("use with care", ["Few logs."])
    assert (plain["verdict"], plain["reasons"]) == (None, [])


def test_what_a_slide_leaves_over_is_in_metres():
    assert set(misfit_units(JointKind.SLIDE).values()) == {"m"}
    assert set(misfit_units(JointKind.HINGE).values()) == {"rad"}


def test_estimates_without_a_mass_or_a_log_say_without_what():
    mass = AddedMass(mass=0.05, arm=0.104)
    said = left_out_content(("p1", "p3"), {mass: np.array([1.0, 2.0]), "a.csv": np.array([3, 4])})
    assert [each["without"] for each in said] == [str(mass), "a.csv"]
    assert said[0]["added_mass"]["mass"] == 0.05
    assert said[1]["values"] == {"p1": 3.0, "p3": 4.0}


def test_a_manifest_is_told_without_the_place_of_its_logs():
    assert without_root({"name": "n", "root": "/somewhere"}) == {"name": "n", "root": None}
    assert without_root(None) is None
