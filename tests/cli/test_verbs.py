"""The commands that estimate: identify, select, validate, residual, compare, design, predict."""

import csv
import json
import re
from functools import wraps

import mujoco
import numpy as np
import pytest

import butterfly as bf
from butterfly.logs.manifest import read_manifest
from tests.cli.one_line import assert_one_line_error, done

GIVEN = "p1=0.00325,p2=0.00145,p3=0.04905,p4=0.025,coulomb=3e-4"

SAYS = {
    "identify {few} -m output-error --terms= --loss soft_l1": ("output",),
    "identify {few} -m weak-form": ("weak",),
    "identify {files} -m linear -v": ("linear", "6 logs, 3 added masses, "),
    "identify {data} --terms= --against p1=0.004,p2=0.001,p3=0.05": ("best p4",),
    "validate {few} -m weak-form --terms= --split mass --bootstrap 20": (
        *("Held out by mass: as requested", "6 of 6"),
        *(r"^ +p1 .*kg m²$", "bootstrap over logs"),
    ),
    "validate {data} --terms= --split frequency": ("out by frequency: as requested", "9 of 9"),
    "select {few} --candidates drag,load": ("Chosen: --terms",),
    "residual {data}": ("of the 9 logs",),
    "design {few} --limit 3 --goal 5% --price 9": (r"^ +3  ", "Run next|No run is needed"),
    "predict {data} --with {saved}": ("median FIT",),
    "predict {quick} --with {saved} --bands --draws 40": ("no measurement to compare",),
}
"""Patterns of what answers say."""

SAYS_NOT = {
    "design {few} --limit 3 --goal 5% --price 9": r"(?m)^ +4  ",
    "predict {data} --with {saved}": "band",
    "predict {quick} --with {saved} --bands --draws 40": "FIT",
}

REFUSED = {
    "identify {data} --against p1=0.1,p2=0.1": "p3",
    "identify {data} --against p1=x,p2=1,p3=1": "got x",
    "identify {data} --against p1": "NAME=VALUE",
    "identify {data} --against p1=1,p2=1,p3=1,mass=2": "unknown parameter",
    "identify {data} --against p1=1e-9,p3=1e9": "p3: got a resonance of 1e+09 rad/s; expected at",
    "identify {data} --figures": "--report FILE as well",
    "identify {data} --holdout run99": "run0",
    "validate {data} --terms drug": "did you mean",
    "validate {data} -m linear,weekform": "weak-form",
    "validate {data} -m linear,thesis --terms drag": "terms: got ('drag',); expected no such",
    "predict {data} --with nowhere.json": "nowhere",
    "predict nowhere --with {saved}": "nowhere",
    f"predict {{data}} --with {GIVEN} --out d.csv": "an identification to draw from",
    "compare {saved} {data}": "two runs of sweeps",
    "residual {saved} --method linear": "got --method; expected no such option with a saved result",
    "residual {saved} --holdout x --terms drag": "got --holdout, --terms; expected no such",
    "compare {saved} {saved} --terms drag --log 1": "got --log, --terms; expected no such",
    "validate {data} --bootstrap 3": "bootstrap: got 3; expected an integer of 20 or more",
    "compare {saved} --log=0,99": "numbers from 0",
    "residual {saved} --log=-1": "numbers from 0",
    "inspect {data} --log=x": "numbers from 0",
    "inspect missing.json": "no such file or folder; expected an existing path",
    "design {saved} --limit -1": "--limit",
    "run quickstart --jobs -2": "jobs: got -2; expected a positive number",
    **{
        f"{command} {{data}} --report {{data}}": "--report: got a folder"
        for command in ("identify", "select", "compare")
    },
    **{
        f"{command} {{data}} --holdout nowhere*": "nowhere*"
        for command in ("residual", "compare", "validate", "select")
    },
}


@pytest.fixture
def ask(answer, quick_data, few_data, saved):
    """Run a command in which data, saved result and experiment stand by their names."""
    names = {"data": quick_data, "few": few_data, "saved": saved}
    names["quick"] = quick_data.parent / "quick.yaml"
    names["files"] = " ".join(str(quick_data / each.file) for each in read_manifest(few_data).logs)
    return lambda words: answer(*words.format(**names).split())


@pytest.mark.parametrize("words", SAYS)
def test_what_is_asked_for_is_said(ask, words):
    out = done(ask(words))
    for pattern in SAYS[words]:
        assert re.search(pattern, out, re.MULTILINE), pattern
    assert not re.search(SAYS_NOT.get(words, "$^"), out)


@pytest.mark.parametrize("words", REFUSED)
def test_what_cannot_be_is_refused_in_a_line(ask, words):
    """Before any work."""
    assert_one_line_error(ask(words), REFUSED[words])
    assert ask(words)[1] == ""


def test_the_real_logs_are_those_of_the_shipped_manifest(
    butterfly, logs_folder, saved, monkeypatch
):
    found, given = bf.load(saved), []
    identify = wraps(bf.identify)(lambda data, *_, **__: given.append(data) or found)
    monkeypatch.setattr(bf, "identify", identify)
    done(butterfly("identify", "real-logs", "--root", logs_folder))
    assert len(given[0].logs) == 41
    assert len(given[0].masses) == 3


@pytest.mark.slow
@pytest.mark.parametrize("told", ["p1=1e-9,p3=1e9,p4=1", "p1=1e300,p3=1,p4=1"])
def test_absurd_parameters_are_compared_without_filling_the_memory(ask, told):
    assert told in done(ask(f"identify {{data}} --against {told}"))


@pytest.mark.usefixtures("brief_twins")
def test_a_saved_result_is_the_estimate(answer, saved, tmp_path):
    """Values that no data would give are those that are looked at, compared and exported."""
    content = json.loads(saved.read_text())
    del content["digest"], content["data"]["manifest"]["logs"][2:]
    row = content["parameters"]["p3"]
    row["value"] *= 1.5
    other = tmp_path / "other.json"
    other.write_text(json.dumps(content))
    assert "0.0735" in answer("inspect", other)[1]
    for words in (("residual",), ("compare", "--log", 0)):
        _, out, err = answer(*words, other, "--json", "-")
        assert json.loads(out)["parameters"]["p3"]["value"] == pytest.approx(row["value"]), err
    out = done(answer("export", other, "--out", tmp_path / "twin.xml"))
    assert "left out" not in out  # of the few microseconds that were found where there are none
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "twin.xml"))
    data = mujoco.MjData(model)
    data.qpos[0], data.ctrl[0] = 0.5, 1.0
    mujoco.mj_forward(model, data)
    inertia = np.zeros((1, 1))
    mujoco.mj_fullM(model, data, inertia)
    assert inertia[0, 0] == pytest.approx(0.00325, rel=0.02)
    assert data.qfrc_bias[0] == pytest.approx(row["value"] * np.sin(0.5), rel=1e-3)
    assert data.qfrc_actuator[0] == pytest.approx(0.025, rel=0.02)


def test_a_weighed_hand(answer, quick_data, tmp_path):
    page = tmp_path / "r.html"
    told = ("--terms=", "--known", "hand_mass=0.1+-0.001", "--report", page)
    out = done(answer("identify", quick_data, *told))
    value, error = re.search(r"com_distance +([\d.]+) ± ([\d.]+)", out).groups()
    assert float(value) == pytest.approx(0.05, rel=0.01)
    assert float(error) == pytest.approx(2 * 0.0005, rel=0.05)
    assert 'id="physical"' in page.read_text(encoding="utf-8")
    numbers = json.loads(page.with_suffix(".json").read_text(encoding="utf-8"))["physical"]
    assert numbers["com_distance"]["value"] == pytest.approx(float(value), rel=1e-3)


def test_logs_are_held_out_by_name(answer, quick_data, tmp_path):
    saved = tmp_path / "result.json"
    told = ("--holdout", "run000*", "--terms=", "--save", saved, "-v")
    out = done(answer("identify", quick_data, *told))
    assert "8 logs, 3 added masses, " in out
    assert re.search(r"Held out: run000\S*, not used for the fit, has a FIT of 9\d\.\d %", out)
    content = json.loads(saved.read_text())
    (held,) = content["held_out"]
    assert held not in content["fits"]
    assert content["data"]["manifest"]["holdout"] == [held]
    out = done(answer("validate", saved, "--terms=", "--split", "log", "--folds", 3))
    assert "held out by name" in out
    assert "8 of 8" in out


REPORTED = {
    "compare {saved} --log 0,3": ("comparison", "residual torque", "MuJoCo", "grey box"),
    "compare {saved} {saved}": ("change", "", r"\ANo significant change", "logs are in both"),
    "validate {few} {few} --method harmonic-balance,linear": (
        *("leaderboard", "harmonic-balance"),
        r"harmonic-balance\s+(predicts\s+held-out\s+logs\s+best|and\s+\S+\s+do\s+not\s+differ)",
    ),
}
"""Kind of the answer, a word of its page, and patterns of what is said."""


@pytest.mark.parametrize("words", REPORTED)
def test_what_is_said_has_a_page_and_its_numbers_beside_it(ask, tmp_path, words):
    page = tmp_path / "page.html"
    kind, word, *patterns = REPORTED[words]
    out = done(ask(f"{words} --report {page}"))
    for pattern in [*patterns, f"Report: {page}"]:
        assert re.search(pattern, out), pattern
    assert word in page.read_text(encoding="utf-8").lower()
    assert page.stat().st_size > 1e5
    numbers = json.loads(page.with_suffix(".json").read_text(encoding="utf-8"))
    assert numbers["schema"] == f"butterfly.{kind}"


def test_logs_are_predicted_with_bands_draws_and_a_page(answer, few_data, saved, tmp_path):
    options = ("--bands", "--draws", 50, "--out", tmp_path / "d.csv")
    out = done(
        answer("predict", few_data, "--with", saved, *options, "--report", tmp_path / "p.html")
    )
    assert "inside the band of a new log" in out
    assert re.match(r"\d+ logs predicted from the initial angle: median FIT .*\nGood: p1 ±", out)
    with (tmp_path / "d.csv").open(encoding="utf-8", newline="") as file:
        assert len(list(csv.DictReader(file))) == 50
    assert (tmp_path / "p.html").stat().st_size > 1e5
    assert (tmp_path / "p.json").exists()


@pytest.fixture(scope="module")
def by_weak_form(answer, quick_data, tmp_path_factory):
    """A saved identification whose errors have degrees of freedom of their own."""
    file = tmp_path_factory.mktemp("weak-form") / "saved.json"
    answer("identify", quick_data, "--method", "weak-form", "--terms=", "--save", file)
    return file


@pytest.mark.parametrize(
    "damage", ["short", "missing", "none", "lopsided", "nameless", "foreign", "numberless"]
)
def test_a_saved_result_with_errors_unlike_its_parameters_is_one_line(
    butterfly, by_weak_form, tmp_path, damage
):
    content = json.loads(by_weak_form.read_text())
    del content["digest"]  # what is damaged is noticed without it too
    freedom = content["freedom"]
    damaged = {"short": freedom[1:], "missing": [None, *freedom[1:]], "none": [0, *freedom[1:]]}
    content["freedom"] = damaged.get(damage, freedom)
    if damage == "lopsided":
        content["covariance"]["matrix"][0][1] = None
    if damage in {"nameless", "foreign"}:
        names = [] if damage == "nameless" else ["p1", 1e-308]
        content["findings"].append({"kind": "rests-on", "parameters": names})
    if damage == "numberless":
        content["findings"].append({"kind": "few-logs", "parameters": []})
    other = tmp_path / "other.json"
    other.write_text(json.dumps(content))
    result = butterfly("compare", by_weak_form, other)
    assert_one_line_error(result, "other.json" * (damage != "missing"))
