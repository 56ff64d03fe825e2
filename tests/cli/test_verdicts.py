"""A command says what was asked, then the verdict it rests on in two lines; if bad, that first."""

import json
import re
from functools import partial
from operator import attrgetter

import pytest
import yaml
from pyarrow import parquet

import butterfly as bf
from butterfly.cli.output import ExitCode
from butterfly.identification.estimators import fast_look
from butterfly.report.finding_texts import estimate_sentences
from tests.cli.one_line import assert_tables_fit, done
from tests.experiment.setting import changed
from tests.verdicts import follow_nothing, impossible_data

COMMANDS = {
    "identify": (),
    "validate": ("--terms=",),
    "select": ("--candidates", "drag"),
    "residual": (),
    "design": ("--limit", 1, "--verbose"),
    "compare": ("--log", "0"),
    "validate of several": ("--method", "harmonic-balance,weak-form"),
    "predict": (),
}
ANSWERS = {
    "validate": r"Held-out median FIT \S+ %",
    "select": r"Chosen: --terms ",
    "design": r"Run next: |No run is needed",
    "compare": r"MuJoCo and grey box differ by at most \S+ rad",
    "validate of several": r"quickstart: ",
    "predict": r"\d+ logs predicted from",
}
"""How a command begins that was asked for more than the values."""
FITTING = {"identify", "validate", "select", "validate of several"}
"""Commands that fit; the others judge by what was saved."""


def _arguments(command, data, saved):
    """Words of a command about data, or about what was identified from them."""
    about = {"predict": (data, "--with", saved)}.get(command, (saved,))
    name = command.partition(" ")[0]
    return (name, *([data] if command in FITTING else about), *COMMANDS.get(command, ()))


@pytest.fixture
def words(quick_data, few_data, saved, unfit):
    """Words of a command about an estimate that is good, and about one that is not."""

    def words(command):
        data = quick_data if command == "identify" else few_data
        return [_arguments(command, data, each) for each in (saved, unfit)]

    return words


@pytest.fixture(scope="module")
def impossible(quick_data, tmp_path_factory):
    """A saved identification with values that no joint has."""
    folder = tmp_path_factory.mktemp("impossible")
    found = bf.identify(impossible_data(quick_data, folder / "data"), "weak-form", terms=())
    found.save(folder / "saved.json")
    return folder / "saved.json"


@pytest.mark.parametrize("command", COMMANDS)
def test_the_verdict_follows_the_answer_at_once_and_one_not_to_be_used_leads_and_ends_with_code_3(
    butterfly, words, tmp_path, monkeypatch, command
):
    good, bad = words(command)
    monkeypatch.setenv("COLUMNS", "80")
    told = ("--report", tmp_path / "r.html") if command == "select" else ()
    out = done(butterfly(*good, *told))
    answer = ANSWERS.get(command)
    lines = out.splitlines()
    if answer:
        assert re.match(answer, lines.pop(0))
    first, model = lines[:2]
    assert re.match(r"Good: (quickstart, [\w-]+: )?p1 ±", first)
    assert re.fullmatch(r"Model: error \S+ % of the motion, \S+ times the sensor noise\.", model)
    assert_tables_fit(out)
    if told:
        assert f"Report: {tmp_path / 'r.html'}" in out
        page = (tmp_path / "r.html").read_text(encoding="utf-8")
        assert first[6:] in page
        assert model in page
    follow_nothing(monkeypatch)
    code, out, err = butterfly(*bad)
    assert (code, err) == (ExitCode.NOT_TO_BE_USED, "")
    first, model, *_ = out.splitlines()
    assert first.startswith("Do not use: ")
    assert "The model does not follow" in first
    # the error of the fitted logs says nothing of predicted ones that are not followed
    assert re.match(answer if command == "predict" else "Model: error ", model)
    assert "p1 ±" not in out


@pytest.mark.parametrize("command", ["design", "compare", "inspect", "predict"])
def test_nothing_is_made_of_values_that_no_joint_has(
    butterfly, impossible, quick_data, tmp_path, command
):
    words = _arguments(command, quick_data, impossible)
    code, out, err = butterfly(*words, "--json", tmp_path / "told.json", "--quiet")
    assert (code, out) == (ExitCode.NOT_TO_BE_USED, "")
    told = json.loads((tmp_path / "told.json").read_text(encoding="utf-8"))
    assert told["verdict"] == "do not use"
    assert told["reasons"][0].startswith("No joint has these values")
    assert err.startswith("error: Do not use: No joint has these values: p1 gives an inertia of")
    assert err.count("\n") == 1


def test_from_python_nothing_is_made_of_values_that_no_joint_has(impossible, quick_data):
    found = bf.load(impossible)
    predict = partial(bf.predict, quick_data)
    for make in (bf.design, bf.compare, predict, bf.draws, attrgetter("model")):
        with pytest.raises(bf.UnusableError, match=r"^Do not use: No joint has these values"):
            make(found)


@pytest.mark.slow
@pytest.mark.parametrize("command", ["identify", "compare", "validate of several", "predict"])
def test_the_numbers_and_the_page_say_the_verdict(butterfly, words, tmp_path, monkeypatch, command):
    follow_nothing(monkeypatch)
    saved, report = tmp_path / "saved.json", tmp_path / "r.html"
    told = ("--save", saved) if command == "identify" else ()
    code, out, _ = butterfly(*words(command)[1], *told, "--report", report)
    assert code == ExitCode.NOT_TO_BE_USED
    numbers = json.loads(report.with_suffix(".json").read_text(encoding="utf-8"))
    assert numbers["verdict"] == "do not use"
    text = report.read_text(encoding="utf-8")
    head, _, after = text.partition('<section class="summary"')
    assert '<div class="verdict warning">' in head
    badge = "Do not use" if command == "identify" else "Parameters: do not use"
    assert f"✕ {badge}" in head
    for reason in numbers["reasons"]:
        assert reason in out
        assert reason in head
        assert reason not in after.partition("</section>")[0]
    if command == "identify":
        assert json.loads(saved.read_text(encoding="utf-8"))["verdict"] == "do not use"


def test_what_is_left_over_of_a_log_is_drawn_and_says_so_if_the_estimate_is_not_to_be_used(
    butterfly, unfit, tmp_path
):
    plot, numbers = tmp_path / "r.html", tmp_path / "n.json"
    code, out, _ = butterfly("residual", unfit, "--json", numbers, "--log", 1, "--report", plot)
    assert code == ExitCode.NOT_TO_BE_USED
    assert "Residuals of" in out
    assert json.loads(numbers.read_text(encoding="utf-8"))["verdict"] == "do not use"
    text = plot.read_text(encoding="utf-8")
    for part in ('<div class="verdict warning">', "Residual torque", "over sensor noise"):
        assert part in text


def fewer(quick, **content):
    """Write an experiment anew with two masses and two sines."""
    about = yaml.safe_load(quick.read_text())
    some = {key: about[key][:2] for key in ("added_masses", "excitations")}
    return changed(quick, **some | content)


def test_a_run_and_its_record_say_the_verdict(butterfly, quick, tmp_path, monkeypatch):
    monkeypatch.setattr(fast_look, "MOST", 1)
    out = tmp_path / "out"
    fewer(quick, estimators=[{"method": "harmonic-balance", "terms": []}])
    for of_this in ("deviation", "already done"):
        code, said, err = butterfly("run", quick, "--out", out)
        assert (code, err) == (ExitCode.NOT_TO_BE_USED, "")
        assert said.startswith("Do not use: The fit did not converge.\n")
        assert of_this in said
    (record,) = out.glob("runs/*/*.json")
    (estimate,) = json.loads(record.read_text(encoding="utf-8"))["estimates"]
    assert estimate["verdict"] == "do not use"
    code, said, _ = butterfly("inspect", out / "0")
    assert code == ExitCode.NOT_TO_BE_USED
    assert said.startswith("Do not use: The fit did not converge.\n")
    assert "harmonic-balance" in said
    code, said, _ = butterfly("compare", out / "0", out / "0")
    assert said.count("Do not use: ") == 2
    assert "do not use" in done(butterfly("inspect", out.parent))
    for name in ("runs", "estimates"):
        verdicts = parquet.read_table(out / f"{name}.parquet")["verdict"].to_pylist()
        assert {*verdicts} == {"do not use"}


def test_what_a_method_does_not_estimate_is_no_value_of_it(told, by_thesis, tmp_path):
    """And the fault of a poor method is no slip of the logs."""
    page = tmp_path / "r.html"
    code, out, _ = told(by_thesis, "--report", page, "-v")
    assert code == ExitCode.NOT_TO_BE_USED
    assert "The model does not follow" in out.splitlines()[0]
    assert "degrees" not in out
    assert "This method does not estimate p4 or coulomb or delay" in out
    assert_tables_fit(out)
    _, table, *_ = out[out.index("quickstart: thesis") :].split("\n\n")
    estimated = {"p1", "p2", "p3"}
    assert {*re.findall(r"^  (\w+)", table, re.MULTILINE)} == estimated
    assert {*json.loads(page.with_suffix(".json").read_text())["parameters"]} == estimated
    text = page.read_text(encoding="utf-8")
    assert {*re.findall(r"<tr><td>(\w+)<small>", text)} == estimated


def _sentences(out):
    """What is printed above the tables, a sentence in a line."""
    return out.partition("\n\n")[0].splitlines()


@pytest.mark.parametrize("good", [True, False])
def test_two_lines_three_sentences_and_a_hint_are_printed_and_all_with_verbose(
    told, saved, by_thesis, good
):
    found = bf.load(saved) if good else by_thesis
    values, model, *others, hint = _sentences(told(found)[1])
    assert values.startswith("Good: " if good else "Do not use: ")
    assert model.startswith("Model: error ")
    assert len(others) == 3
    every = _sentences(told(found, "--verbose")[1])
    assert every[:5] == [values, model, *others]
    assert hint == f"--verbose adds {len(every[5:])} more sentences."
    assert {*estimate_sentences(found.estimate)} <= {*every}
    assert len({*every}) == len(every)
    assert told(found, "--quiet")[1] == f"{values}\n{model}\n"


def test_of_several_estimators_the_verdict_is_two_lines_and_sentences_name_theirs(
    butterfly, quick, tmp_path
):
    methods = ("weak-form", "output-error")
    fewer(quick, estimators=[{"method": method} for method in methods])
    words = ("run", quick, "--out", tmp_path / "out")
    out = done(butterfly(*words))
    values, model, other, *others, hint = _sentences(out)
    assert re.search(r"^  p1 .*0\.00325", out, re.MULTILINE)  # the true one, beside both
    assert values.startswith("Good: weak-form: p1 ±")
    assert model.startswith("Model: error ")
    assert other.startswith("output-error: Good: p1 ±")
    assert ". Model: error " in other
    assert len(others) == 2
    assert re.fullmatch(r"--verbose adds \d+ more sentences\.", hint)
    again = "This run was already done; --force repeats it."
    _, _, *every = _sentences(done(butterfly(*words, "--verbose")))
    assert every.pop(0) == again
    assert every[:3] == [other, *others]
    assert {each.partition(": ")[0] for each in every} == {*methods}
    assert not any("Model: " in each for each in every[1:])
    assert done(butterfly(*words, "--quiet")) == f"{values}\n{model}\n"


def test_an_estimator_that_fails_is_said_before_the_findings_of_the_others(
    butterfly, quick, tmp_path
):
    estimators = [{"method": method} for method in ("weak-form", "thesis")]
    changed(quick, estimators=estimators, excitations=[{"omega": 4.5, "amplitude": 0.15}])
    _, _, first, *_ = _sentences(butterfly("run", quick, "--out", tmp_path / "out")[1])
    assert first.startswith("thesis: ")


def test_values_given_by_hand_have_a_verdict_of_one_line(answer, quick_data):
    given = "p1=0.00325,p2=0.00145,p3=0.04905,p4=0.025,coulomb=3e-4"
    words = ("predict", quick_data, "--with")
    model, verdict, *_ = done(answer(*words, given)).splitlines()
    assert verdict == "Use with care: p1, p4, p2, p3, coulomb and delay without an interval."
    assert model.startswith("9 logs predicted from the initial angle")
    assert answer(*words, given, "-q")[1] == f"{verdict}\n"
    code, said, _ = answer(*words, given.replace("0.00325", "0.01"), "-q")
    assert code == ExitCode.NOT_TO_BE_USED
    assert said.startswith("Do not use: The model does not follow the logs")
