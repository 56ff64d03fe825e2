"""`--json` and `--quiet`: what every command that has an answer does alike."""

import contextlib
import inspect
import io
import json
import os
import subprocess
import sys

import numpy as np
import pytest
import yaml

import butterfly as bf
from butterfly.cli import main
from butterfly.cli.command_table import COMMANDS, MODEL_COMMANDS, RESULTS_COMMANDS
from butterfly.cli.exit_codes import ExitCode
from butterfly.cli.loudness import be_quiet, one_command, standard_output
from butterfly.document import HEAD
from tests.cli.one_line import assert_one_line_error
from tests.cli.test_orbit_commands import ORBIT

GROUPS = {"": COMMANDS, "model": MODEL_COMMANDS, "results": RESULTS_COMMANDS}
LOADS = {
    f"{group} {name}".strip(): command.load
    for group, commands in GROUPS.items()
    for name, command in commands.items()
}
GOOD = "Good: nothing was found that speaks against these values.\n"

KINDS = {  # of the answers
    "inspect": "inspection",
    "identify": "identification",
    "select": "selection",
    "validate": "validation",
    "predict": "prediction",
    "residual": "residual",
    "compare": "comparison",
    "leaderboard": "leaderboard",
    "design": "design",
    "run": "run",
    "calibrate-orbit": "orbit",
    "reproduce": "reproduction",
    "model show": "model",
    "results list": "results",
    "results show": "run-record",
    "results table": "table",
    "results compare": "change",
}
WITHOUT = {  # commands whose answer is a file, a window, or JSON already
    *("manifest", "simulate", "view", "video", "schema", "model render", "model export"),
    *("results export", "results clean"),
}
SLOW = {"calibrate-orbit", "reproduce"}
ON_AN_ESTIMATE = {
    *("identify", "select", "validate", "residual", "compare", "design", "model show"),
    *("predict", "calibrate-orbit"),
}


def _call(*words):
    """Run a command before there is a test; return what it prints."""
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(io.StringIO()) as out:
        patch.setattr(sys, "argv", ["butterfly", *map(str, words)])
        with pytest.raises(SystemExit):
            main()
    return out.getvalue()


@pytest.fixture(scope="module")
def place(quick_data, tmp_path_factory):
    """A folder with what the commands work with: a saved identification, results of a run."""
    folder = tmp_path_factory.mktemp("place")
    bf.identify(quick_data).save(folder / "saved.json")
    (folder / "orbit.yaml").write_text(ORBIT)
    _call("run", quick_data.parent / "quick.yaml", "--out", folder / "results/one")
    return folder


def _words(command, data, place):
    """Return the words of a command that has something to answer."""
    saved, results = place / "saved.json", place / "results/one"
    told = {
        "select": (data, "--method", "harmonic-balance", "--candidates", "drag"),
        "identify": (data, "--against", "p1=0.003,p2=0.0014,p3=0.05"),
        "validate": (data, "--terms", "", "--bootstrap", 20),
        "predict": (data, "--with", saved),
        "compare": (data, "--log", "0"),
        "leaderboard": (data, "--method", "linear"),
        "run": (data.parent / "quick.yaml", "--out", results),
        "calibrate-orbit": (place / "orbit.yaml", "--out", place / "orbit"),
        "reproduce": ("thesis",),
        "results list": (place / "results",),
        "results show": (results, 0),
        "results table": (results, "--table", "estimates"),
        "results compare": (saved, saved),
    }
    return (*command.split(), *told.get(command, (data,)))


@pytest.mark.parametrize("command", LOADS)
def test_every_command_that_has_an_answer_tells_it_as_json(command):
    assert (command in KINDS) != (command in WITHOUT)
    assert ("json_file" in inspect.signature(LOADS[command]()).parameters) == (command in KINDS)


@pytest.mark.parametrize(
    "command",
    [pytest.param(each, marks=[pytest.mark.slow] * (each in SLOW)) for each in KINDS],
)
def test_what_is_told_has_one_form_and_stands_alone_on_standard_output(
    butterfly, quick_data, place, command
):
    code, out, err = butterfly(*_words(command, quick_data, place), "--json", "-")
    assert code == ExitCode.DONE
    assert not err
    said = json.loads(out, parse_constant=pytest.fail)
    assert list(said)[: len(HEAD)] == list(HEAD)
    assert said["schema"] == f"butterfly.{KINDS[command]}"
    assert said["schema_number"] == 2
    assert said["versions"].keys() == {"butterfly", "numpy", "mujoco", "scipy", "python"}
    assert isinstance(said["title"], str)
    assert said["verdict"] in {None, "good", "use with care"}
    assert all(isinstance(each, str) for key in ("reasons", "summary") for each in said[key])
    assert all(isinstance(unit, str) for unit in said["units"].values())
    for folder in (quick_data, place):
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
        assert each["severity"] in {"note", "care", "warning"}
        assert each["text"].endswith(".")
    for each in said["left_out"]:
        assert each["without"]
        assert {"p1", "p3"} & set(each["values"])


def test_from_python_a_result_tells_the_same(butterfly, quick_data):
    for command, result in (("identify", bf.identify), ("validate", bf.validate)):
        words = (command, quick_data, "--method", "harmonic-balance", "--terms", "")
        said = json.loads(butterfly(*words, "--json", "-")[1])
        found = result(quick_data, "harmonic-balance", terms=())
        assert said == json.loads(json.dumps(found.to_dict()))
    assert {each["without"] for each in said["left_out"]} == {
        "no added mass",
        "50 g at 104 mm",
        "120 g at 104 mm",
    }


def test_the_file_beside_a_report_tells_the_same_and_can_be_read_again(
    butterfly, quick_data, tmp_path
):
    for command in ("identify", "leaderboard"):
        words = (command, quick_data, *("--method", "linear") * (command == "leaderboard"))
        file, page = tmp_path / f"{command}-told.json", tmp_path / f"{command}.html"
        code, out, err = butterfly(*words, "--json", file, "--report", page)
        assert (code, err) == (0, "")
        assert f"Numbers: {file}" in out
        told, beside = (json.loads(each.read_text()) for each in (file, page.with_suffix(".json")))
        for each in (told, beside):
            [entry.pop("seconds") for entry in each.get("entries", ())]
        assert told == beside
    file = tmp_path / "identify-told.json"
    manifest = yaml.safe_load((quick_data / "manifest.yaml").read_text())
    told = json.loads(file.read_text())
    assert list(told["fits"]) == [each["file"] for each in manifest["logs"]]
    loaded = bf.load(file)
    assert loaded.to_dict() == told
    with pytest.raises(bf.InputError, match="logs"):
        _ = loaded.data
    assert bf.load(file, root=quick_data).data.logs
    assert_one_line_error(butterfly("identify", file), "--root")
    assert butterfly("identify", file, "--root", quick_data, "--quiet")[:2] == (0, GOOD)


def test_saved_is_the_same_and_where_the_logs_lie(butterfly, quick_data, tmp_path):
    told, saved = tmp_path / "told.json", tmp_path / "saved.json"
    butterfly("identify", quick_data, "--json", told, "--save", saved)
    one, other = (json.loads(each.read_text()) for each in (told, saved))
    assert one["data"]["manifest"].pop("root") is None
    assert other["data"]["manifest"].pop("root") == str(quick_data)
    assert one == other


@pytest.mark.parametrize("command", sorted(KINDS.keys() - SLOW - {"results list"}))
def test_bad_input_leaves_standard_output_empty(butterfly, tmp_path, command):
    more = {"predict": ("--with", "p1=1"), "results show": (0,), "results compare": ("x.json",)}
    words = (*command.split(), tmp_path / "nowhere.json", *more.get(command, ()), "--json", "-")
    assert_one_line_error(butterfly(*words), "nowhere")


@pytest.mark.parametrize("words", [("--quiet", "identify"), ("identify", "-q")])
def test_quietly_the_verdict_is_printed_alone(butterfly, quick_data, tmp_path, words):
    saved = tmp_path / "saved.json"
    assert butterfly(*words, quick_data, "--save", saved) == (ExitCode.DONE, GOOD, "")
    assert saved.exists()


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


def test_quietly_standard_output_is_a_file_still_and_comes_back():
    before = sys.stdout
    with one_command():
        be_quiet()
        assert sys.stdout is not before
        sys.stdout.buffer.write(b"nothing")
        assert os.isatty(sys.stdout.fileno()) is False
        assert standard_output() is before
    assert sys.stdout is before


def _program(*words, **how):
    command = [sys.executable, "-m", "butterfly", *map(str, words)]
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True, **how)  # noqa: S603


def test_a_reader_that_has_read_enough_ends_a_command_without_a_word(quick_data):
    reading, writing = os.pipe()
    os.close(reading)
    with _program("inspect", quick_data, stdout=writing) as done:
        os.close(writing)
        assert done.stderr.read() == ""
    assert done.returncode == ExitCode.UNREAD


def test_json_is_whole_where_letters_are_lacking(quick_data):
    environment = os.environ | {"PYTHONIOENCODING": "ascii"}
    words = ("inspect", quick_data, "--json", "-")
    with _program(*words, stdout=subprocess.PIPE, env=environment) as done:
        assert json.loads(done.stdout.read())["logs"]
        assert done.stderr.read() == ""
