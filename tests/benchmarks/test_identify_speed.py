"""What `identify` costs, as a ratio to what cannot be avoided: to read, and to import.

Run with ``make bench``.
"""

import os

import pytest
from scipy.io import loadmat

from butterfly.experiment.simulate import simulate, write_logs
from butterfly.experiment.source import read_experiment
from butterfly.identification.data import read_data_set
from butterfly.identification.identify import identify
from tests.benchmarks.bars import SHORT, at_most
from tests.benchmarks.cpu_time import least_seconds, least_seconds_of_processes

NEEDED = """
import numba
import numpy
import cyclopts
from pydantic import BaseModel
from rich.console import Console
from rich.progress import track
from rich.table import Table
from ruamel.yaml import YAML
from scipy.io import loadmat
from scipy.optimize import least_squares
"""

DRAWN = """
import jinja2
from matplotlib.backends.backend_agg import FigureCanvasAgg
from plotly.graph_objects import Figure
"""


@pytest.fixture(scope="module")
def quick_start(tmp_path_factory):
    """The logs of the quick start, whole, by the fast simulator."""
    folder = tmp_path_factory.mktemp("quick")
    path = folder / "quick.yaml"
    path.write_text("extends: quickstart\nplant: {simulator: grey-box}\n")
    experiment = read_experiment(path)
    return write_logs(experiment, simulate(experiment), folder / "logs").parent


@pytest.mark.usefixtures("real")  # compiles the kernels
def test_identifying_the_real_logs_costs_little_more_than_reading_them(real_manifest):
    """Besides reading: three simulations of the logs, two for what describing functions neglect."""
    paths = [f"{real_manifest.root}/{entry.file}" for entry in real_manifest.logs]
    reading, whole = least_seconds(
        lambda: [loadmat(path) for path in paths], lambda: identify(read_data_set(real_manifest))
    )
    at_most(whole / reading, 2, "identify 41 real logs", "reading them (loadmat)")


@pytest.mark.skipif(not hasattr(os, "wait4"), reason="needs the CPU time of single children")
def test_identifying_the_quick_start_costs_no_more_than_twice_the_imports_it_needs(quick_start):
    needed, own = least_seconds_of_processes(
        ("-c", NEEDED), ("-m", "butterfly", "identify", str(quick_start))
    )
    at_most(own / needed, 2, "butterfly identify, quick start", "importing what it needs")


@pytest.mark.skipif(not hasattr(os, "wait4"), reason="needs the CPU time of single children")
def test_its_report_costs_little_more_than_the_imports_that_drawing_needs(quick_start, tmp_path):
    command = ("-m", "butterfly", "identify", str(quick_start))
    needed, drawing, own, whole = least_seconds_of_processes(
        ("-c", NEEDED),
        ("-c", NEEDED + DRAWN),
        command,
        (*command, "--report", str(tmp_path / "report.html")),
        repeats=2 if SHORT else 5,
    )
    at_most(
        (whole - own) / (drawing - needed), 5, "what --report adds to it", "importing what draws it"
    )
