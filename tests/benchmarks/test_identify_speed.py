"""What `identify` costs, as a ratio to what cannot be avoided: to read, and to import.

Run with ``make bench``.
"""

import os

import numpy as np
import pytest
from scipy.io import loadmat

from butterfly.experiment.simulate import simulate, write_logs
from butterfly.experiment.source import read_experiment
from butterfly.identification.data import DataSet, read_data_set
from butterfly.identification.identify import identify
from butterfly.logs.log import InputKind, Intersample, Log, Sine
from butterfly.model.greybox import simulate as simulated
from butterfly.plant.sensors import Encoder
from tests.benchmarks.bars import SHORT, measured
from tests.benchmarks.cpu_time import least_seconds, least_seconds_of_processes
from tests.conftest import MASSES, ROBOT

_OMEGAS = (2.0, 3.0, 3.5, 4.0, 5.0, 6.0, 7.0, 9.0)

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
    measured("identify 41 real logs", whole / reading)


def test_a_short_log_s_sample_costs_at_most_two_microseconds():
    """Some 25 steps of the kernel: what every log costs by itself weighs most there."""
    time = 1e-3 * np.arange(10_001)
    runs = [(mass, Sine(omega=omega, amplitude=0.2)) for mass in MASSES for omega in _OMEGAS]
    jobs = [
        (
            ROBOT.with_added_mass(mass),
            time,
            np.repeat(sine.sample(time[:-1])[:, None], 3, axis=1),
            0.0,
        )
        for mass, sine in runs
    ]
    about = {"input_kind": InputKind.VOLTAGE, "intersample": Intersample.ZERO_ORDER_HOLD}
    logs = [
        Log(
            time=time,
            input=sine.sample(time),
            angle=Encoder().read(time, simulated(*job)[0], np.random.default_rng(0)),
            added_mass=mass,
            excitation=sine,
            source=f"{mass} {sine}",
            **about,
        )
        for (mass, sine), job in zip(runs, jobs, strict=True)
    ]
    identify(DataSet.of(logs))
    bare, whole = least_seconds(
        lambda: [simulated(*job) for job in jobs], lambda: identify(DataSet.of(logs))
    )
    measured("identify 24 logs of 10 s", whole / bare)


@pytest.mark.skipif(not hasattr(os, "wait4"), reason="needs the CPU time of single children")
def test_identifying_the_quick_start_costs_no_more_than_twice_the_imports_it_needs(quick_start):
    needed, own = least_seconds_of_processes(
        ("-c", NEEDED), ("-m", "butterfly", "identify", str(quick_start))
    )
    measured("butterfly identify, quick start", own / needed)


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
    measured("what --report adds to it", (whole - own) / (drawing - needed))
