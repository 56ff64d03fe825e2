"""Commands made of verbs: options and help are said once, and mean the same everywhere."""

import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

import butterfly as bf
from butterfly.cli import derived
from butterfly.cli.app import COMMANDS, program
from butterfly.cli.command_texts import DESCRIPTIONS, SUMMARIES
from tests.cli.one_line import done
from tests.cli.one_line import program as run_program
from tests.cli.test_written import CALLS, command_of

OF_DATA = {"--root", "--arm", "--input", "--intersample", "--columns", "--units", "--known"}
SHORT = {"-o": "--out", "-m": "--method", "-r": "--report", "-q": "--quiet"}


@cache
def _options(call):
    """Return the names of each option of a command."""
    app = program(call.split())
    for word in call.split():
        app = app[word]
    arguments = app.assemble_argument_collection(parse_docstring=True)
    return [each.names for each in arguments if each.names and each.names[0].startswith("-")]


def test_commands_have_eleven_options_at_most_in_the_mean():
    assert COMMANDS.keys() == CALLS.keys()
    assert 5 < sum(len(_options(call)) for call in COMMANDS) / len(COMMANDS) <= 11


def test_only_commands_that_describe_data_take_what_is_said_of_them():
    for call in COMMANDS:
        names = {name for option in _options(call) for name in option}
        told = names >= OF_DATA
        assert told == (call in {"inspect", "manifest", "identify", "report"}), call
        assert told or "--columns" not in names or call == "results table"


def test_short_forms_mean_the_same_everywhere():
    for call in COMMANDS:
        for names in _options(call):
            for short in (name for name in names if not name.startswith("--")):
                assert SHORT[short] in names


@pytest.mark.parametrize("call", COMMANDS)
def test_every_command_explains_itself_in_any_width(butterfly, monkeypatch, call):
    described = getattr(bf, call) if call in DESCRIPTIONS else command_of(call)
    summary = derived.description_of(described).splitlines()[0]
    assert SUMMARIES[call] == summary
    monkeypatch.setenv("COLUMNS", "60")
    out = done(butterfly(*call.split(), "--help"))
    assert " ".join(summary.split()) in " ".join(out.replace("`", "").split())
    assert max(map(len, out.splitlines())) <= 60
    assert not re.search(r"\w…|In Python|As in|[(<]class", out.replace("=…", ""))


def test_help_is_short_and_all_options_are_shown_on_request(answer):
    short = answer("identify", "--help")[1].splitlines()
    assert len(short) <= 60
    assert max(map(len, short)) <= 80
    assert not any("--gravity" in line for line in short)
    everything = run_program("identify", "--help-all")[1]
    for names in _options("identify"):
        assert names[0] in everything


@pytest.mark.parametrize("name", derived.MODULES)
def test_what_is_made_of_the_verbs_is_what_make_commands_makes_today(name):
    path = Path(derived.__file__).with_name(name)
    words = [sys.executable, "-m", "ruff", "format", "--stdin-filename", path, "-"]
    made = subprocess.run(  # noqa: S603 - our own
        words, input=derived.MODULES[name]().encode(), capture_output=True, check=True
    )
    assert made.stdout.decode() == path.read_text(encoding="utf-8"), "run `make commands`"


def test_texts_leave_out_what_is_for_python_and_follow_what_is_said_elsewhere():
    def verb(data, method, more):
        """Do.

        Whole. Of an `Estimator`. With ``terms``.

        Parameters
        ----------
        data, method
            As in `residual`.
        more
            A number. In Python `numbers.Real`. Default: ``1``.
        """

    texts = derived.texts_of(verb)
    assert texts["data"] == derived.texts_of(bf.residual)["data"]
    assert texts["more"] == "A number. Default: 1."
    assert derived.description_of(verb) == "Do.\n\nWhole. With terms."
