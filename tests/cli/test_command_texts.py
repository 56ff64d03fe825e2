"""Texts of commands: of each command, and of nothing else."""

import re
from pathlib import Path

from butterfly import cli
from butterfly.cli.app import COMMANDS
from butterfly.cli.command_texts import ARGUMENTS, DESCRIPTIONS, FACTS, SUMMARIES

VERBS = Path(cli.__file__).with_name("verbs.py").read_text(encoding="utf-8")


def test_every_command_has_a_summary_which_its_description_begins_with():
    assert SUMMARIES.keys() == COMMANDS.keys()
    for name, text in DESCRIPTIONS.items():
        assert text.partition("\n")[0] == SUMMARIES[name]


def test_no_text_speaks_of_python_or_ends_in_the_air():
    for text in (*SUMMARIES.values(), *DESCRIPTIONS.values(), *ARGUMENTS.values()):
        assert text.endswith(".")
        assert not re.search(r"`|In Python|As in", text)
    assert not any("``" in text or text.endswith(".") for text in FACTS.values())


def test_every_argument_is_that_of_a_command():
    for name in ARGUMENTS:
        assert f'"{name}"' in VERBS or f"'{name}'" in VERBS, name
