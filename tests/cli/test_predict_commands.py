"""`butterfly predict`."""

import csv
import json

import pytest

from tests.cli.one_line import assert_one_line_error


@pytest.fixture
def saved(butterfly, quick_data, tmp_path):
    """An identification, as the command saves it."""
    file = tmp_path / "result.json"
    code, out, err = butterfly("identify", quick_data, "--save", file)
    assert (code, err) == (0, "")
    assert f"Saved: {file}" in out
    return file


def test_logs_are_predicted_with_bands_draws_and_a_page(butterfly, quick_data, saved, tmp_path):
    code, out, err = butterfly("predict", quick_data, "--with", saved)
    assert (code, err) == (0, "")
    assert "median FIT" in out
    assert "band" not in out
    options = ("--bands", "--draws", 50, "--out", tmp_path / "d.csv")
    code, out, err = butterfly(
        "predict", quick_data, "--with", saved, *options, "--report", tmp_path / "p.html"
    )
    assert (code, err) == (0, "")
    assert "inside the band of a new log" in out
    assert "known within 10 %" in out
    with (tmp_path / "d.csv").open(encoding="utf-8", newline="") as file:
        assert len(list(csv.DictReader(file))) == 50
    assert (tmp_path / "p.html").stat().st_size > 1e5
    assert (tmp_path / "p.json").exists()


def test_an_experiment_is_predicted(butterfly, quick, saved):
    code, out, err = butterfly("predict", quick, "--with", saved, "--bands", "--draws", 40)
    assert (code, err) == (0, "")
    assert "nobody has recorded" in out
    assert "FIT" not in out


def test_slips_end_in_one_line(butterfly, quick_data, saved, tmp_path):
    assert_one_line_error(
        butterfly("predict", quick_data, "--with", tmp_path / "none.json"), "none"
    )
    assert_one_line_error(butterfly("predict", tmp_path / "none", "--with", saved), "none")
    assert_one_line_error(
        butterfly("predict", quick_data, "--with", saved, "--figures"), "--report FILE beside it"
    )


def test_given_parameters_are_applied_to_logs(butterfly, quick_data, tmp_path):
    given = "p1=0.00325,p2=0.00145,p3=0.04905,p4=0.025,coulomb=3e-4"
    out = tmp_path / "p.json"
    code, said, err = butterfly("predict", quick_data, "--with", given, "--json", out)
    assert (code, err) == (0, "")
    assert said.startswith("Good")
    assert "They move like this robot" in said
    assert json.loads(out.read_text())["schema"] == "butterfly.prediction"
    code, said, _ = butterfly("predict", quick_data, "--with", given.replace("0.00325", "0.01"))
    assert code == 3
    assert said.startswith("Do not use: The model follows the logs")
    assert_one_line_error(
        butterfly("predict", quick_data, "--with", given, "--out", tmp_path / "d.csv"),
        "an identification to draw from",
    )
