"""The program: its table of commands, its start, its end."""

import inspect
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from butterfly import __version__
from butterfly.cli.command_table import (
    COMMANDS,
    LOGS_COMMANDS,
    MODEL_COMMANDS,
    PANELS,
    RESULTS_COMMANDS,
)
from butterfly.cli.exit_codes import ExitCode
from tests.cli.one_line import assert_one_line_error


def test_the_version_is_printed(butterfly):
    assert butterfly("--version") == (0, f"butterfly {__version__}\n", "")


TABLES = {
    "": COMMANDS,
    "logs": LOGS_COMMANDS,
    "model": MODEL_COMMANDS,
    "results": RESULTS_COMMANDS,
}
CALLS = [(*group.split(), name) for group, commands in TABLES.items() for name in commands]


@pytest.mark.parametrize("call", CALLS, ids=" ".join)
def test_every_command_explains_itself(butterfly, call):
    code, out, _ = butterfly(*call, "--help")
    assert code == 0
    assert len(out) > 400


@pytest.mark.parametrize("call", CALLS, ids=" ".join)
def test_the_table_says_of_a_command_what_its_docstring_says(call):
    *group, name = call
    command = TABLES["".join(group)][name]
    assert inspect.getdoc(command.load()).splitlines()[0] == command.summary


@pytest.mark.parametrize("group", TABLES)
def test_help_lists_every_command_with_its_summary(butterfly, group, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    _, out, _ = butterfly(*group.split(), "--help")
    for name, command in TABLES[group].items():
        assert re.search(rf"{name} +{re.escape(command.summary.replace('`', ''))}", out)


def test_help_lists_commands_by_the_way_of_work(butterfly):
    _, out, _ = butterfly("--help")
    places = [out.index(f"─ {panel} ─") for panel in PANELS]
    assert places == sorted(places)
    assert out.index("─ Identify ─") < out.index("│ identify ") < out.index("─ Judge ─")


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("butterfly ide", {"identify"}),
        ("butterfly identify --met", {"--method"}),
        ("butterfly results sh", {"show"}),
        ("butterfly results table --li", {"--limit"}),
    ],
)
def test_shells_complete_commands_and_options(words, expected):
    asked = {"_BUTTERFLY_COMPLETE": "complete_bash", "COMP_WORDS": words}
    count = str(len(words.split()) - 1)
    done = _run(env=os.environ | asked | {"COMP_CWORD": count}, command="butterfly")
    assert set(done.stdout.split()) == expected


@pytest.mark.parametrize(
    ("call", "wanted"), [(("idenfity",), "identify"), (("results", "shwo"), "show")]
)
def test_a_slip_in_a_command_s_name_is_answered_with_the_right_one(butterfly, call, wanted):
    code, _, err = butterfly(*call)
    assert code == ExitCode.BAD_INPUT
    assert f"Did you mean '{wanted}'" in err


SLOW = {"numpy", "scipy", "mujoco", "numba", "pyarrow", "plotly", "matplotlib"}


def _imported(*call):
    """Return the packages that a call of the command line has imported when it ends."""
    program = (
        "import atexit, sys; from butterfly.cli import main; "
        "atexit.register(lambda: print(*{name.partition('.')[0] for name in sys.modules})); main()"
    )
    command = [sys.executable, "-c", program, *call]
    ended = subprocess.run(command, capture_output=True, text=True, check=True)  # noqa: S603
    return set(ended.stdout.splitlines()[-1].split())


def test_help_and_version_import_no_library_that_computes_or_draws():
    assert not _imported("--help") & (SLOW | {"pydantic"})
    # From here on typer itself imports pydantic.
    assert not _imported("--version") & SLOW
    assert not _imported("model", "--help") & SLOW


@pytest.mark.parametrize("command", ["inspect", "manifest"])
def test_the_help_of_a_command_that_reads_logs_needs_no_simulator(command):
    assert not _imported(command, "--help") & {"mujoco", "numba", "matplotlib"}


def test_identifying_without_a_report_imports_no_simulator_and_nothing_that_draws(quick_data):
    unused = {"mujoco", "control", "pyarrow", "plotly", "matplotlib", "jinja2"}
    assert not _imported("identify", str(quick_data)) & unused


TAKE_DATA = {
    *("inspect", "identify", "validate", "select", "residual", "design", "compare", "leaderboard"),
    *("predict", "model show", "model render", "model export"),
}


@pytest.mark.parametrize("call", CALLS, ids=" ".join)
def test_every_command_that_takes_data_may_be_told_the_same_of_it(call):
    *group, name = call
    taken = inspect.signature(TABLES["".join(group)][name].load()).parameters
    told = {"root", "arm", "input_kind", "intersample", "columns"}
    assert (told <= taken.keys()) == (" ".join(call) in TAKE_DATA)


@pytest.mark.parametrize(
    "arguments",
    [
        ("identify", "nowhere"),
        ("run", "nowhere.yaml"),
        ("simulate", "nowhere.yaml", "--out", "x"),
        ("inspect", "nowhere.mat"),
        ("inspect", "notes.txt"),
        ("manifest", "nowhere", "--arm", "0.1"),
    ],
)
def test_a_missing_file_is_one_line_and_exit_code_2(butterfly, arguments):
    assert_one_line_error(butterfly(*arguments), arguments[1])


def _installed(command):
    """Path of a command of the environment that the tests run in."""
    return Path(sys.executable).with_name(command)


def _run(*call, stdout=subprocess.PIPE, command=None, **how):
    words = [sys.executable, "-m", "butterfly"] if command is None else [_installed(command)]
    words += map(str, call)
    pipes = {"stdout": stdout, "stderr": subprocess.PIPE}
    return subprocess.run(words, **pipes, text=True, check=False, **how)  # noqa: S603 - our own


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full to write to")
def test_a_full_disk_is_one_line(quick_data):
    with Path("/dev/full").open("w") as full:
        done = _run("inspect", quick_data, stdout=full)
    assert done.returncode == ExitCode.BAD_INPUT
    assert re.fullmatch(r"error: .*No space left on device\n", done.stderr)


def test_a_terminal_that_lacks_a_letter_shows_the_others(quick_data):
    encoding = os.environ | {"PYTHONIOENCODING": "ascii"}
    done = _run("identify", quick_data, env=encoding)
    assert (done.returncode, done.stderr) == (ExitCode.DONE, "")
    assert "kg m?" in done.stdout
