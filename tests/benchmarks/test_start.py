"""How long command line and package take to start, as a ratio to what cannot be avoided."""

import os

import pytest

from tests.benchmarks.bars import measured
from tests.benchmarks.cpu_time import least_seconds_of_processes

BARE = """
from cyclopts import App

app = App(name="bare", version="bare 1.0")


@app.command
def nothing() -> None:
    "Do nothing."


app()
"""


@pytest.mark.skipif(not hasattr(os, "wait4"), reason="needs the CPU time of single children")
@pytest.mark.parametrize("option", ["--version", "--help"])
def test_the_command_line_starts_in_little_more_than_a_bare_cyclopts_program(option, tmp_path):
    bare = tmp_path / "bare.py"
    bare.write_text(BARE, encoding="utf-8")
    least, own = least_seconds_of_processes((str(bare), option), ("-m", "butterfly", option))
    measured(f"butterfly {option}", own / least)


@pytest.mark.skipif(not hasattr(os, "wait4"), reason="needs the CPU time of single children")
def test_the_package_is_imported_in_little_more_than_numpy():
    """Until something of it is used."""
    numpy, own = least_seconds_of_processes(
        ("-c", "import numpy"), ("-c", "import butterfly as bf; dir(bf)")
    )
    measured("import butterfly", own / numpy)
