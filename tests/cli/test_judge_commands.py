"""The commands that judge an identification."""

import json
import re

import pytest

from tests.cli.one_line import assert_one_line_error


def test_unseen_masses_and_frequencies_are_predicted(butterfly, quick_data):
    for split in ("mass", "frequency"):
        code, out, err = butterfly("validate", quick_data, "--split", split)
        assert code == 0, err
        assert f"Left out by {split}: as asked." in out
        assert "above 90 %" in out
        assert re.search(r"^ +p1 .*kg m²$", out, re.MULTILINE)


def test_a_weighed_hand_and_the_bootstrap(butterfly, quick_data, tmp_path):
    page = tmp_path / "r.html"
    told = ("--known", "hand_mass=0.1+-0.001", "--report", page)
    code, out, err = butterfly("identify", quick_data, *told)
    assert code == 0, err
    value, error = re.search(r"l_c, pivot to centre of +([\d.]+) +([\d.]+)", out).groups()
    assert float(value) == pytest.approx(0.05, rel=0.01)
    assert float(error) == pytest.approx(0.0005, rel=0.05)
    assert "take J_r from the motor's data sheet" in out
    assert "weigh the hand" not in out
    assert 'id="physical"' in page.read_text(encoding="utf-8")
    numbers = json.loads(page.with_suffix(".json").read_text(encoding="utf-8"))["physical"]
    assert numbers["com_distance"]["value"] == pytest.approx(float(value), rel=1e-3)
    code, out, err = butterfly("validate", quick_data, "--bootstrap", 20)
    assert code == 0, err
    assert "bootstrap over logs" in out


def test_terms_are_chosen(butterfly, quick_data):
    code, out, err = butterfly(
        "select", quick_data, "--method", "harmonic-balance", "--candidates", "drag,load"
    )
    assert code == 0, err
    assert "Chosen: --terms" in out


def test_a_term_that_is_none_is_one_line(butterfly, quick_data):
    code, _, err = butterfly("validate", quick_data, "--terms", "drug")
    assert code == 2
    assert "did you mean" in err
    assert err.count("\n") == 1


def test_what_is_left_over_is_told_of_all_logs_and_drawn_of_one(butterfly, quick_data, tmp_path):
    plot, numbers = tmp_path / "residual.html", tmp_path / "residual.json"
    code, out, err = butterfly("residual", quick_data, "--json", numbers)
    assert code == 0, err
    assert "of 12 logs leave over more than their sensors explain" in out
    assert "torque left over" not in out
    assert len(json.loads(numbers.read_text(encoding="utf-8"))["logs"]) == 12
    code, out, err = butterfly("residual", quick_data, "--log", 2, "--plot", plot)
    assert code == 0, err
    assert "the torque left over looks like" in out
    text = plot.read_text(encoding="utf-8")
    assert "The torque left over" in text
    assert "The errors of the free run" in text
    code, _, err = butterfly("residual", quick_data, "--log", 99)
    assert code == 2
    assert "numbers from 0 to 11" in err


def test_a_folder_is_no_report_and_is_refused_before_the_work(butterfly, quick_data, tmp_path):
    for command in ("identify", "select", "compare"):
        result = butterfly(command, quick_data, "--report", tmp_path)
        assert_one_line_error(result, tmp_path, "--report", "a folder")
        assert result[1] == ""


def test_logs_are_held_out_by_name(butterfly, quick_data, tmp_path):
    saved = tmp_path / "result.json"
    code, out, err = butterfly("identify", quick_data, "--holdout", "run000*", "--save", saved)
    assert (code, err) == (0, "")
    assert "11 logs with 3 added masses" in out
    assert re.search(r"Held out: run000\S*, not used for the fit, has a FIT of 9\d\.\d %", out)
    content = json.loads(saved.read_text())
    (held,) = content["held_out"]
    assert held not in content["fits"]
    assert content["data"]["manifest"]["holdout"] == [held]
    code, out, err = butterfly("validate", saved, "--split", "log", "--folds", 3)
    assert (code, err) == (0, "")
    assert "held out by name" in out
    assert "11 of 11 logs left out" in out
    code, _, err = butterfly("identify", quick_data, "--holdout", "run99")
    assert code == 2
    assert "the name of a log, such as run0" in err


def test_two_identifications_are_compared(butterfly, quick_data, tmp_path):
    first, second = tmp_path / "a.json", tmp_path / "b.json"
    for file, name in ((first, "run000*"), (second, "run001*")):
        butterfly("identify", quick_data, "--holdout", name, "--save", file)
    out_file, page = tmp_path / "c.json", tmp_path / "c.html"
    options = ("--json", out_file, "--report", page)
    code, out, err = butterfly("results", "compare", first, second, *options)
    assert (code, err) == (0, "")
    assert out.startswith("No change can be seen")
    assert "of the logs are in both" in out
    assert json.loads(out_file.read_text())["schema"] == "butterfly.change"
    assert page.exists()
    code, _, err = butterfly("results", "compare", tmp_path, "3")
    assert code == 2
    assert "and two of its runs" in err
