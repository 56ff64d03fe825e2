"""How long command line and package take, as a ratio to what cannot be avoided: to import."""

import os

import pytest

from butterfly.experiment.run import simulate, write_logs
from butterfly.experiment.source import read_experiment
from tests.benchmarks.bars import SHORT, measured
from tests.benchmarks.cpu_time import least_seconds_of_processes

pytestmark = pytest.mark.skipif(
    not hasattr(os, "wait4"), reason="needs the CPU time of single children"
)

BARE = """
from cyclopts import App
app = App(name="bare", version="bare 1.0")
app.command(lambda: None, name="nothing")
app()
"""

NEEDED = """
import cyclopts, numba, numpy
from pydantic import BaseModel
from rich import console, progress, table
from ruamel.yaml import YAML
from scipy.io import loadmat
from scipy.optimize import least_squares
"""

DRAWN = f"""{NEEDED}
import jinja2
from matplotlib.backends.backend_agg import FigureCanvasAgg
from plotly.graph_objects import Figure
"""


@pytest.mark.parametrize(
    ("what", "bare", "own"),
    [
        ("butterfly --version", (BARE, "--version"), ("-m", "butterfly", "--version")),
        ("butterfly --help", (BARE, "--help"), ("-m", "butterfly", "--help")),
        ("import butterfly", ("import numpy",), ("-c", "import butterfly as bf; dir(bf)")),
    ],
)
def test_the_program_starts_in_little_more_than_a_bare_one(what, bare, own):
    """The package is imported, until something of it is used, in little more than numpy."""
    least, took = least_seconds_of_processes(("-c", *bare), own)
    measured({what: took / least})


def test_identifying_the_quick_start_costs_little_more_than_the_imports_it_needs(tmp_path):
    """And its report little more than those that drawing needs."""
    path = tmp_path / "quick.yaml"
    path.write_text("extends: quickstart\nplant: {simulator: grey-box}\n", encoding="utf-8")
    experiment = read_experiment(path)
    logs = write_logs(experiment, simulate(experiment), tmp_path / "logs").parent
    command = ("-m", "butterfly", "identify", logs)
    needed, drawing, own, whole = least_seconds_of_processes(
        ("-c", NEEDED),
        ("-c", DRAWN),
        command,
        (*command, "--report", tmp_path / "report.html"),
        repeats=5 if SHORT else 10,  # what is asserted is a ratio of differences
    )
    measured(
        {
            "butterfly identify, quick start": own / needed,
            "what --report adds to it": (whole - own) / (drawing - needed),
        }
    )
