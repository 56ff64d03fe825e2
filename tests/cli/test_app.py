"""The program: its commands, its options, its start, its end."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from butterfly import __version__
from butterfly.cli.app import COMMANDS, GROUPS, program
from butterfly.cli.output import ExitCode
from tests.cli.one_line import assert_one_line_error
from tests.cli.one_line import program as run_program
from tests.programs import said


def test_the_version_is_printed(butterfly):
    assert butterfly("--version") == (0, f"butterfly {__version__}\n", "")


def test_a_command_is_the_function_that_its_table_names():
    for name, command in COMMANDS.items():
        assert callable(command.functions()[name])
    tables = {command.functions for command in COMMANDS.values()}
    assert {name for table in tables for name in table()} == COMMANDS.keys()


def test_help_lists_every_command_by_the_way_of_work(answer):
    out = answer("--help")[1]
    parts = {part: answer(part, "--help")[1] for part in GROUPS}
    panels = {command.panel: None for name, command in COMMANDS.items() if " " not in name}
    places = [out.index(f"─ {panel} ─") for panel in panels]
    assert places == sorted(places)
    for call in COMMANDS:
        part, _, name = call.rpartition(" ")
        assert re.search(rf"│ {name} ", parts.get(part, out))


VAIN = {
    "design data --units 1": "butterfly manifest",
    "manifest data --from 1": "from and to in the manifest's logs",
    "identify data --wnidow 1": "--window",
    "identify": "DATA",
    "identify data --window x": "--window",
    "identify x.csv --budget -1": "--budget",
    "schema --budget 1": "--budget",
    "identify data --method weekform": "weak-form",
    "schema --json -": "a command with a JSON answer",
    "design a b": "b",
    "idenfity": 'Did you mean "identify"',
    "idenfity --help": 'Did you mean "identify"',
    "results shwo": 'Did you mean "show"',
    "simulate nowhere.yaml --out x": "nowhere.yaml",
    "inspect nowhere.mat": "nowhere.mat",
    "inspect notes.txt": "notes.txt",
    "manifest nowhere --arm 0.1": "nowhere",
}


@pytest.mark.parametrize("call", VAIN)
def test_what_is_typed_in_vain_is_one_line_with_what_is_meant(butterfly, call):
    named = [each.partition("=")[0] for each in call.split()[-2:-1] if call.endswith(" 1")]
    assert_one_line_error(butterfly(*call.split()), *named, VAIN[call])


def test_shells_complete_commands_and_options():
    script = program().generate_completion(shell="bash")  # noqa: S604 - its name
    assert all(word in script for word in ("identify", "--holdout", "results", "--bootstrap"))


SLOW = {"numpy", "scipy", "mujoco", "numba", "pyarrow", "plotly", "matplotlib"}


def _imported(*stages):
    """Return the packages that calls of the command line have imported at the end of each stage."""
    program = (
        "import contextlib, sys; from butterfly.cli import main\n"
        f"for calls in {stages!r}:\n"
        "    for call in calls:\n"
        "        with contextlib.suppress(SystemExit): sys.argv[1:] = call.split(); main()\n"
        "    print('imported', *{name.partition('.')[0] for name in sys.modules})"
    )
    lines = [line.split() for line in said(sys.executable, "-c", program).splitlines()]
    return [{*words} for words in lines if words[:1] == ["imported"]]


def test_no_command_imports_what_it_does_not_need(quick_data):
    general = ("--help", "--version", "results --help")
    light = [f"{name} --help" for name in COMMANDS if not name.startswith("results ")]
    stages = general, light, [f"identify {quick_data} --terms="]
    of_help, of_more, of_identify = _imported(*stages)
    assert "cyclopts" in of_help
    assert not of_help & (SLOW | {"pydantic"})
    assert not of_more & SLOW
    assert "scipy" in of_identify
    assert not of_identify & {"mujoco", "control", "pyarrow", "matplotlib"}


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
    code, out, err = run_program("identify", quick_data, "--terms=", env=encoding)
    assert (code, err) == (ExitCode.DONE, "")
    assert "kg m?" in out


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has other signals")
@pytest.mark.parametrize(
    "first", ["signal.raise_signal(signal.SIGTERM)", "raise KeyboardInterrupt"]
)
def test_whoever_asks_it_to_end_again_and_again_gets_no_traceback(first):
    program = (
        "import atexit, signal, sys; from butterfly.cli import app\n"
        "def again(*_, **__):\n"
        "    signal.raise_signal(signal.SIGTERM); signal.raise_signal(signal.SIGTERM)\n"
        f"def first(*_):\n    {first}\n"
        "app.put, app.program, sys.argv = again, first, ['butterfly']\n"
        "atexit.register(again)\n"
        "app.main()"
    )
    words = [sys.executable, "-c", program]
    ended = subprocess.run(words, capture_output=True, text=True, check=False)  # noqa: S603 - our own
    assert (ended.returncode, ended.stderr) == (ExitCode.STOPPED, "")
