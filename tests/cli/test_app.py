"""The program: its commands, its options, its start, its end."""

import inspect
import os
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

from butterfly import __version__
from butterfly.cli.app import COMMANDS, FORMER_COMMANDS, program
from butterfly.cli.output import ExitCode
from tests.cli.one_line import assert_one_line_error, done
from tests.cli.one_line import program as run_program

TWENTY = {
    *("inspect", "manifest", "fetch", "identify", "select", "validate", "residual", "predict"),
    *("compare", "design", "run", "simulate", "show", "export", "reproduce", "schema"),
    *("results list", "results show", "results table", "results clean"),
}
OF_DATA = {"--root", "--arm", "--input", "--intersample", "--columns", "--units", "--known"}
SHORT = {"-o": "--out", "-m": "--method", "-r": "--report", "-q": "--quiet"}


def _options(call):
    """Return the names of each option of a command."""
    app = program(call.split())
    for word in call.split():
        app = app[word]
    arguments = app.assemble_argument_collection(parse_docstring=True)
    return [each.names for each in arguments if each.names and each.names[0].startswith("-")]


def test_the_version_is_printed(butterfly):
    assert butterfly("--version") == (0, f"butterfly {__version__}\n", "")


def test_twenty_commands_have_two_hundred_options_at_most():
    assert {*COMMANDS} == TWENTY
    assert 100 < sum(len(_options(call)) for call in COMMANDS) <= 200


def test_only_commands_that_describe_data_take_what_is_said_of_them():
    for call in COMMANDS:
        names = {name for option in _options(call) for name in option}
        told = names >= OF_DATA
        assert told == (call in {"inspect", "manifest", "identify"}), call
        assert told or "--columns" not in names or call == "results table"


def test_short_forms_mean_the_same_everywhere():
    for call in COMMANDS:
        for names in _options(call):
            for short in (name for name in names if not name.startswith("--")):
                assert SHORT[short] in names


@pytest.mark.parametrize("call", COMMANDS)
def test_every_command_explains_itself_in_any_width(answer, butterfly, monkeypatch, call):
    module, _, name = COMMANDS[call].path.partition(":")
    function = getattr(import_module(f"butterfly.cli.{module}"), name)
    summary = inspect.getdoc(function).splitlines()[0]
    assert COMMANDS[call].summary == summary
    out = done(answer(*call.split(), "--help"))
    assert " ".join(summary.split()) in " ".join(out.replace("`", "").split()).replace("`", "")
    assert max(map(len, out.splitlines())) <= 80
    monkeypatch.setenv("COLUMNS", "60")
    out = butterfly(*call.split(), "--help")[1]
    assert max(map(len, out.splitlines())) <= 60
    assert not re.search(r"\w…", out.replace("=…", ""))


def test_help_lists_every_command_by_the_way_of_work(answer):
    out, of_results = answer("--help")[1], answer("results", "--help")[1]
    panels = {command.panel: None for name, command in COMMANDS.items() if " " not in name}
    places = [out.index(f"─ {panel} ─") for panel in panels]
    assert places == sorted(places)
    for call in COMMANDS:
        listed, name = (of_results if " " in call else out), call.rpartition(" ")[2]
        assert re.search(rf"│ {name} ", listed)


def test_help_is_short_and_all_options_are_shown_on_request(answer):
    short = answer("identify", "--help")[1]
    assert len(short.splitlines()) <= 60
    assert "--gravity" not in short
    everything = run_program("identify", "--help-all")[1]
    for names in _options("identify"):
        assert names[0] in everything


@pytest.mark.parametrize("former", FORMER_COMMANDS)
def test_a_former_command_ends_in_a_line_that_tells_the_present_one(butterfly, former):
    result = butterfly(*former.split(), "data")
    assert_one_line_error(result, former, f"expected {FORMER_COMMANDS[former]}")


@pytest.mark.parametrize(
    ("call", "old", "new"),
    [
        (("compare", "data"), "--logs", "--log"),
        (("export", "data", "--out", "x"), "--mass=0.3", "--hand-mass"),
        (("design", "data"), "--count", "--limit"),
        (("validate", "data"), "--methods", "--method"),
        (("compare", "results/x/0", "results/x/1"), "--against", "RESULTS/RUN"),
        (("design", "data"), "--units", "butterfly manifest"),
        (("identify", "data"), "--wnidow", "--window"),
    ],
)
def test_a_former_or_misspelt_option_tells_the_one_that_is_meant(butterfly, call, old, new):
    assert_one_line_error(butterfly(*call, old, "1"), old.partition("=")[0], new)


@pytest.mark.parametrize(
    ("call", "part"),
    [
        ("identify", "DATA"),
        ("identify data --window x", "--window"),
        ("identify data --method weekform", "weak-form"),
        ("schema --json -", "a command with a JSON answer"),
        ("design a b", "b"),
        ("idenfity", 'Did you mean "identify"'),
        ("results shwo", 'Did you mean "show"'),
        ("simulate nowhere.yaml --out x", "nowhere.yaml"),
        ("inspect nowhere.mat", "nowhere.mat"),
        ("inspect notes.txt", "notes.txt"),
        ("manifest nowhere --arm 0.1", "nowhere"),
    ],
)
def test_what_is_typed_in_vain_is_one_line_with_what_is_meant(butterfly, call, part):
    assert_one_line_error(butterfly(*call.split()), part)


def test_shells_complete_commands_and_options():
    script = program().generate_completion(shell="bash")  # noqa: S604 - its name
    assert all(word in script for word in ("identify", "--holdout", "results", "--bootstrap"))


SLOW = {"numpy", "scipy", "mujoco", "numba", "pyarrow", "plotly", "matplotlib"}


def _imported(*call):
    """Return the packages that a call of the command line has imported when it ends."""
    program = (
        "import atexit, sys; from butterfly.cli import main; "
        "atexit.register(lambda: print(*{name.partition('.')[0] for name in sys.modules})); main()"
    )
    command = [sys.executable, "-c", program, *map(str, call)]
    ended = subprocess.run(command, capture_output=True, text=True, check=True)  # noqa: S603
    return set(ended.stdout.splitlines()[-1].split())


@pytest.mark.parametrize("call", [("--help",), ("--version",), ("results", "--help")])
def test_help_and_version_import_no_library_that_computes_or_draws(call):
    assert not _imported(*call) & (SLOW | {"pydantic"})


@pytest.mark.parametrize("command", ["inspect", "manifest", "show", "export", "predict"])
def test_the_help_of_a_command_without_estimator_computes_nothing(command):
    assert not _imported(command, "--help") & SLOW


def test_identifying_without_a_report_imports_no_simulator(quick_data):
    unused = {"mujoco", "control", "pyarrow", "matplotlib"}
    assert not _imported("identify", quick_data) & unused


@pytest.mark.slow
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full to write to")
def test_a_full_disk_is_one_line(quick_data):
    with Path("/dev/full").open("w") as full:
        code, _, err = run_program("inspect", quick_data, stdout=full)
    assert code == ExitCode.BAD_INPUT
    assert re.fullmatch(r"error: .*No space left on device\n", err)


@pytest.mark.slow
def test_a_terminal_that_lacks_a_letter_shows_the_others(quick_data):
    encoding = os.environ | {"PYTHONIOENCODING": "ascii"}
    code, out, err = run_program("identify", quick_data, env=encoding)
    assert (code, err) == (ExitCode.DONE, "")
    assert "kg m?" in out
