"""Every command whose answer rests on an identification begins with the verdict, in two lines."""

import json
import re

import pytest

from butterfly.cli.output import ExitCode
from tests.cli.one_line import assert_tables_fit, done
from tests.experiment.setting import changed
from tests.verdicts import follow_nothing, impossible_data

REPORTED = {"validate", "select", "design"}
COMMANDS = {
    "identify": (),
    "validate": (),
    "select": ("--method", "harmonic-balance", "--candidates", "drag"),
    "residual": (),
    "design": ("--limit", 1),
    "compare": ("--log", "0"),
    "validate of several": ("--method", "harmonic-balance,linear"),
    "predict": (),
}


def _arguments(butterfly, command, data, folder, identified=None):
    """Words of a command about data; those that foretell need what was identified before."""
    told = (data,)
    if command == "predict":
        saved = folder / "saved.json"
        butterfly("identify", identified or data, "--save", saved)
        told = (data, "--with", saved)
    if command == "inspect":
        told = (folder / "saved.json",)
        butterfly("identify", identified or data, "--save", *told)
    told += ("--report", folder / "r.html") if command in REPORTED else ()
    return (command.partition(" ")[0], *told, *COMMANDS.get(command, ()))


@pytest.fixture(scope="module")
def impossible(quick_data, tmp_path_factory):
    return impossible_data(quick_data, tmp_path_factory.mktemp("impossible") / "data")


@pytest.mark.parametrize("command", COMMANDS)
def test_the_verdict_is_the_first_line_and_an_answer_not_to_be_used_ends_with_code_3(
    butterfly, quick_data, tmp_path, monkeypatch, command
):
    monkeypatch.setenv("COLUMNS", "80")
    out = done(butterfly(*_arguments(butterfly, command, quick_data, tmp_path)))
    first, model = out.splitlines()[:2]
    assert re.match("Good: (quickstart, harmonic-balance: )?p1 ±", first)
    assert re.fullmatch(r"Model: error \S+ % of the motion, \S+ times the sensor noise\.", model)
    assert_tables_fit(out)
    if command in REPORTED:
        assert f"Report: {tmp_path / 'r.html'}" in out
        page = (tmp_path / "r.html").read_text(encoding="utf-8")
        assert first[6:] in page
        assert model in page
    follow_nothing(monkeypatch)
    code, out, err = butterfly(*_arguments(butterfly, command, quick_data, tmp_path))
    assert (code, err) == (ExitCode.NOT_TO_BE_USED, "")
    first, *rest = out.splitlines()
    assert first.startswith("Do not use: ")
    assert "The model does not follow" in first
    assert rest[0] == model
    assert "p1 ±" not in out


@pytest.mark.parametrize("command", ["design", "compare", "inspect", "predict"])
def test_nothing_is_made_of_values_that_no_joint_has(
    butterfly, impossible, quick_data, tmp_path, command
):
    data = quick_data if command == "predict" else impossible
    words = _arguments(butterfly, command, data, tmp_path, impossible)
    code, out, err = butterfly(*words, "--json", tmp_path / "told.json", "--quiet")
    assert (code, out) == (ExitCode.NOT_TO_BE_USED, "")
    told = json.loads((tmp_path / "told.json").read_text(encoding="utf-8"))
    assert told["verdict"] == "do not use"
    assert told["reasons"][0].startswith("No joint has these values")
    assert err.startswith("error: Do not use: No joint has these values: p1 gives an inertia of")
    assert err.count("\n") == 1


@pytest.mark.slow
@pytest.mark.parametrize("command", ["identify", "compare", "validate of several", "predict"])
def test_the_numbers_and_the_page_say_the_verdict(
    butterfly, quick_data, tmp_path, monkeypatch, command
):
    follow_nothing(monkeypatch)
    saved, report = tmp_path / "saved.json", tmp_path / "r.html"
    words = _arguments(butterfly, command, quick_data, tmp_path)
    words += ("--save", saved) if command == "identify" else ()
    code, out, _ = butterfly(*words, "--report", report)
    assert code == ExitCode.NOT_TO_BE_USED
    numbers = json.loads(report.with_suffix(".json").read_text(encoding="utf-8"))
    assert numbers["verdict"] == "do not use"
    text = report.read_text(encoding="utf-8")
    head, _, after = text.partition('<section class="summary"')
    assert '<div class="verdict warning">' in head
    said = "All: do not use" if command == "validate of several" else "Do not use"
    assert f"✕ {said}" in head
    for reason in numbers["reasons"]:
        assert reason in out
        assert reason in head
        assert reason not in after.partition("</section>")[0]
    if command in {"identify", "predict"}:
        assert json.loads(saved.read_text(encoding="utf-8"))["verdict"] == "do not use"


def test_what_is_left_over_of_an_estimate_not_to_be_used_says_so_in_numbers_and_plot(
    butterfly, quick_data, tmp_path, monkeypatch
):
    follow_nothing(monkeypatch)
    plot, numbers = tmp_path / "r.html", tmp_path / "r.json"
    code, _, _ = butterfly("residual", quick_data, "--json", numbers, "--log", 1, "--plot", plot)
    assert code == ExitCode.NOT_TO_BE_USED
    assert json.loads(numbers.read_text(encoding="utf-8"))["verdict"] == "do not use"
    assert '<div class="verdict warning">' in plot.read_text(encoding="utf-8")


def test_a_run_and_its_record_say_the_verdict(butterfly, quick, tmp_path, monkeypatch):
    follow_nothing(monkeypatch)
    out = tmp_path / "out"
    for _ in ("fresh", "from its record"):
        code, said, err = butterfly("run", quick, "--out", out)
        assert (code, err) == (ExitCode.NOT_TO_BE_USED, "")
        assert said.startswith("Do not use: ")
    (record,) = out.glob("runs/*/*.json")
    (estimate,) = json.loads(record.read_text(encoding="utf-8"))["estimates"]
    assert estimate["verdict"] == "do not use"
    said = done(butterfly("results", "show", out, 0))
    assert "harmonic-balance: Do not use: " in said
    assert said.index("Do not use: ") < said.index("95 % interval")
    code, said, _ = butterfly("compare", out / "0", out / "0")
    assert said.count("Do not use: ") == 2
    for table in ("runs", "estimates"):
        told = ("--table", table, "--columns", "verdict")
        assert "do not use" in butterfly("results", "table", out, *told)[1]


@pytest.mark.slow
def test_the_report_of_a_sweep_counts_verdicts(butterfly, quick, tmp_path, monkeypatch):
    follow_nothing(monkeypatch)
    changed(quick, sweep={"repetitions": 2})
    said = done(butterfly("run", quick, "--out", tmp_path / "out", "--jobs", 1))
    assert "Verdicts on 2 estimates: " in said
    numbers = json.loads((tmp_path / "out/report.json").read_text(encoding="utf-8"))
    assert sum(numbers["verdicts"]["harmonic-balance"].values()) == 2


def test_the_fault_of_a_poor_method_is_no_slip_of_the_logs(butterfly, quick_data):
    code, out, _ = butterfly("identify", quick_data, "--method", "thesis")
    assert code == ExitCode.NOT_TO_BE_USED
    assert "The model does not follow" in out.splitlines()[0]
    assert "degrees" not in out


def test_what_a_method_does_not_estimate_is_no_value_of_it(butterfly, quick_data, tmp_path):
    page = tmp_path / "r.html"
    _, out, _ = butterfly("identify", quick_data, "--method", "thesis", "--report", page, "-v")
    assert "This method estimates neither coulomb nor delay nor p4" in out
    assert_tables_fit(out)
    table = out[out.index("quickstart: thesis") :]
    assert all(symbol in table for symbol in ("p₁", "p₂", "p₃"))
    assert not any(symbol in table for symbol in ("p₄", "T_c", "delay"))
    assert {*json.loads(page.with_suffix(".json").read_text())["parameters"]} == {"p1", "p2", "p3"}
    assert "<td>T_c</td>" not in page.read_text(encoding="utf-8")
