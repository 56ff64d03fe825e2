"""How long command line and package take to start, as a ratio to what cannot be avoided.

CPU time, so that other work on the machine counts for little; the best of several starts.
"""

import os
import sys

import pytest

from tests.benchmarks.bars import SHORT, at_most

BARE = """
from typing import Annotated

import typer

app = typer.Typer(add_completion=False, no_args_is_help=True)


@app.callback(invoke_without_command=True)
def _root(
    version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False,
) -> None:
    if version:
        typer.echo("bare 1.0")
        raise typer.Exit


@app.command()
def nothing() -> None:
    "Do nothing."


app()
"""


def _least_seconds(*programs, repeats=5 if SHORT else 20):
    """Return the least CPU time in s of each program, started in turn."""
    least = [float("inf")] * len(programs)
    silence = [(os.POSIX_SPAWN_OPEN, 1, os.devnull, os.O_WRONLY, 0)]
    for _ in range(repeats):
        for k, program in enumerate(programs):
            command = [sys.executable, *program]
            child = os.posix_spawn(sys.executable, command, os.environ, file_actions=silence)
            _, status, used = os.wait4(child, 0)
            assert status == 0
            least[k] = min(least[k], used.ru_utime + used.ru_stime)
    return least


@pytest.mark.skipif(not hasattr(os, "wait4"), reason="needs the CPU time of single children")
@pytest.mark.parametrize("option", ["--version", "--help"])
def test_the_command_line_starts_in_little_more_than_a_bare_typer_program(option, tmp_path):
    bare = tmp_path / "bare.py"
    bare.write_text(BARE, encoding="utf-8")
    least, own = _least_seconds((str(bare), option), ("-m", "butterfly", option))
    ratio = own / least
    print(f"\nbutterfly {option}: {1e3 * own:.0f} ms, {ratio:.2f} times a bare typer program")
    at_most(ratio, 1.5, f"butterfly {option} over a bare typer program")


@pytest.mark.skipif(not hasattr(os, "wait4"), reason="needs the CPU time of single children")
def test_the_package_is_imported_in_little_more_than_numpy():
    """Until something of it is used."""
    numpy, own = _least_seconds(("-c", "import numpy"), ("-c", "import butterfly as bf; dir(bf)"))
    ratio = own / numpy
    print(f"\nimport butterfly: {1e3 * own:.0f} ms, {ratio:.2f} times import numpy")
    at_most(ratio, 1.5, "import butterfly over import numpy")
