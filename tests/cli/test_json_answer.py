"""`--json` and `--quiet`: what every command that has an answer does alike."""

import json
import os

import numpy as np
import pytest
import yaml

import butterfly as bf
from butterfly.cli.app import COMMANDS
from butterfly.cli.output import ExitCode
from butterfly.result import HEAD, schema_number
from tests.cli.one_line import assert_one_line_error, done, program

KINDS = {name: command.answer for name, command in COMMANDS.items() if command.answer}
SLOW = {"reproduce"}
ON_AN_ESTIMATE = {"identify", "select", "validate", "residual", "compare", "design", "predict"}


def _words(command, data, few, place):
    """Return the words of a command that has something to answer."""
    saved, results = place / "saved.json", place / "results/one"
    told = {
        "select": (few, "--candidates", "drag"),
        "identify": (data, "--against", "p1=0.003,p2=0.0014,p3=0.05"),
        "validate": (data, "--terms="),
        "predict": (few, "--with", saved),
        "residual": (saved,),
        "compare": (saved, "--log", "0"),
        "design": (saved,),
        "run": (place / "quick.yaml", "--out", results),
        "campaign": (place / "quick.yaml", "--out", place / "campaign"),
        "reproduce": ("thesis",),
        "library list": (),
        "library show": ("xl330",),
    }
    return (*command.split(), *told.get(command, (data,)))


@pytest.mark.parametrize(
    "command", [pytest.param(each, marks=[pytest.mark.slow] * (each in SLOW)) for each in KINDS]
)
def test_what_is_told_has_one_form_and_stands_alone_on_standard_output(
    answer, quick_data, few_data, place, command
):
    code, out, err = answer(*_words(command, quick_data, few_data, place), "--json", "-")
    assert code == ExitCode.DONE
    assert not err
    said = json.loads(out, parse_constant=pytest.fail)
    assert list(said)[: len(HEAD)] == list(HEAD)
    assert said["schema"] == f"butterfly.{KINDS[command]}"
    assert said["schema_number"] == schema_number(KINDS[command])
    assert said["versions"].keys() >= {"butterfly", "numpy", "mujoco", "scipy", "python"}
    assert isinstance(said["title"], str)
    assert said["verdict"] in {None, "good", "use with care"}
    assert all(isinstance(each, str) for key in ("reasons", "summary") for each in said[key])
    assert all(isinstance(unit, str) for unit in said["units"].values())
    for folder in (quick_data, few_data.parent, place):
        assert str(folder) not in out
    if command in ON_AN_ESTIMATE:
        _assert_tells_an_estimate(said)


def _assert_tells_an_estimate(said):
    """Values with units, a covariance that goes with their errors, findings in words."""
    assert said["data"]["name"]
    for row in said["parameters"].values():
        assert row["unit"]
        assert row.keys() >= {"value", "standard_error", "lower", "upper", "true", "known"}
    names, matrix = said["covariance"]["names"], np.array(said["covariance"]["matrix"])
    np.testing.assert_allclose(matrix, matrix.T, rtol=1e-9)
    errors = [said["parameters"][name]["standard_error"] for name in names]
    np.testing.assert_allclose(np.sqrt(np.diag(matrix)), errors)
    assert said["findings"]
    for each in said["findings"]:
        assert each["text"].endswith(".")
    for each in said["left_out"]:
        assert each["without"]
        assert {"p1", "p3"} & set(each["values"])


def test_from_python_a_result_tells_the_same(answer, quick_data):
    said = json.loads(answer("identify", quick_data, "--terms=", "--json", "-")[1])
    found = bf.identify(quick_data, terms=())
    assert said == json.loads(json.dumps(found.to_dict()))
    masses = {"no added mass", "50 g at 104 mm", "120 g at 104 mm"}
    assert {each["without"] for each in said["left_out"]} == masses


def test_the_file_beside_a_report_tells_the_same_and_can_be_read_again(answer, quick_data, place):
    file = place / "told.json"
    told, beside, saved = (
        json.loads(each.read_text()) for each in (file, place / "r.json", place / "saved.json")
    )
    assert told == beside
    assert told["data"]["manifest"].pop("root") is None
    assert saved["data"]["manifest"].pop("root") == str(quick_data)
    assert told | {"saved": True, "digest": saved["digest"]} == saved
    manifest = yaml.safe_load((quick_data / "manifest.yaml").read_text())
    assert list(told["fits"]) == [each["file"] for each in manifest["logs"]]
    loaded = bf.load(file)
    with pytest.raises(bf.InputError, match="logs"):
        _ = loaded.data
    assert bf.load(file, root=quick_data).data.logs
    assert_one_line_error(answer("identify", file), "--root")
    code, out, _ = answer("identify", file, "--root", quick_data, "--terms=", "--quiet")
    assert (code, out.count("\n"), out[:6]) == (0, 2, "Good: ")


@pytest.mark.parametrize("command", sorted(KINDS.keys() - SLOW))
def test_bad_input_leaves_standard_output_empty(answer, tmp_path, command):
    more = {"predict": ("--with", "p1=1")}
    words = (*command.split(), tmp_path / "nowhere.json", *more.get(command, ()), "--json", "-")
    assert_one_line_error(answer(*words), "nowhere")
    assert answer(*words)[1] == ""


@pytest.mark.parametrize("words", [("--quiet", "residual"), ("residual", "-q")])
def test_quietly_the_verdict_is_printed_alone(butterfly, saved, tmp_path, words):
    file = tmp_path / "told.json"
    code, out, err = butterfly(*words, saved, "--json", file)
    assert (code, out.count("\n"), out[:6], err) == (ExitCode.DONE, 2, "Good: ", "")
    assert file.exists()


def test_quietly_nothing_is_printed_where_there_is_no_verdict_but_what_was_asked_for(
    butterfly, quick_data, tmp_path
):
    assert butterfly("inspect", "-q", quick_data) == (ExitCode.DONE, "", "")
    simulated = ("simulate", quick_data.parent / "quick.yaml", "--out", tmp_path, "-q")
    assert butterfly(*simulated) == (ExitCode.DONE, "", "")
    assert_one_line_error(butterfly("-q", "inspect", tmp_path / "nowhere"), "nowhere")
    assert json.loads(butterfly("-q", "inspect", quick_data, "--json", "-")[1])["logs"]
    assert json.loads(butterfly("-q", "schema")[1])["properties"]
    assert "samples" in butterfly("inspect", quick_data, "--log", 0)[1]  # and loud again


@pytest.mark.slow
def test_a_reader_that_has_read_enough_ends_a_command_without_a_word(quick_data):
    reading, writing = os.pipe()
    os.close(reading)
    assert program("inspect", quick_data, stdout=writing) == (ExitCode.UNREAD, None, "")
    os.close(writing)


@pytest.mark.slow
def test_json_is_whole_where_letters_are_lacking(quick_data):
    environment = os.environ | {"PYTHONIOENCODING": "ascii"}
    out = done(program("inspect", quick_data, "--json", "-", env=environment))
    assert json.loads(out)["logs"]


def test_a_command_says_what_its_budget_left_out(answer, few_data):
    words = ("identify", few_data, "--method", "output-error", "--terms=")
    code, out, _ = answer(*words, "--budget", "1e-9")
    assert "Search stopped after 1e-09 s. Skipped: iterations of a fit" in out
    assert code == 0
    assert out.startswith("Use with care: ")
    assert "Search stopped after 0 s" in answer(*words, "--budget", "0")[1]
    assert "Search stopped" not in answer(*words)[1]


@pytest.mark.slow
def test_a_result_is_saved_though_the_reader_of_its_lines_has_gone(quick_data, tmp_path):
    reading, writing = os.pipe()
    os.close(reading)
    saved = tmp_path / "result.json"
    call = ("identify", quick_data, "--save", saved)
    assert program(*call, stdout=writing)[0] == ExitCode.UNREAD
    os.close(writing)
    assert json.loads(saved.read_text())["verdict"] == "good"
