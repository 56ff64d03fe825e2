"""What several benchmarks share, and the table at their end."""

import os
import platform
from importlib.metadata import version

import numpy as np
import pytest

from butterfly.identification.estimators import OutputError
from butterfly.identification.estimators.multistart import Start
from butterfly.identification.inference.term_choice import CANDIDATES
from butterfly.model.greybox import simulate
from butterfly.signals import hold
from tests.benchmarks.bars import ROWS, table, write_page

_VERSIONS = ("mujoco", "numba", "numpy", "scipy")


def pytest_sessionfinish():
    """Write what was measured into the page, if that is asked for."""
    if os.environ.get("BUTTERFLY_BENCH_WRITE"):
        write_page(_machine())


def pytest_terminal_summary(terminalreporter):
    if not ROWS:
        return
    terminalreporter.section("measured, as ratios")
    terminalreporter.write_line(table(ROWS.values()))
    terminalreporter.write_line(f"\n{_machine()}")


def _machine():
    packages = ", ".join(f"{name} {version(name)}" for name in _VERSIONS)
    machine = f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores"
    return f"{machine}; Python {platform.python_version()}, {packages}."


@pytest.fixture(scope="session")
def fitted(real):
    """The default output error of the real logs, without leaving a mass out."""
    data = real.data
    start = Start(real.estimate.parameters, data.equilibria)
    return OutputError(workers=1).of_logs(data.logs, [start])


@pytest.fixture(scope="session")
def fitted_problem(real, fitted):
    """What output error minimises with the terms that are usually tried, begun where it ends."""
    data = real.data
    parameters, own = fitted.applied(data.logs[0])
    zeros = dict.fromkeys(data.equilibria, own["zero"])
    return OutputError(terms=CANDIDATES, workers=1).problem(data.logs, Start(parameters, zeros))


@pytest.fixture(scope="session")
def simulation(fitted, fitted_problem):
    """Simulates all real logs with the parameters of `fitted`, each input at hand on its grid."""
    jobs = []
    for trajectory in fitted_problem.simulations:
        log, grid = trajectory.log, trajectory.grid
        parameters, own = fitted.applied(log)
        instants = grid - parameters.delay
        inputs = hold.parabolas(log.time, log.input, instants, log.intersample)[0]
        loaded = parameters.with_added_mass(log.added_mass)
        start = float(log.angle[0]) - own["zero"]
        jobs.append((loaded, grid, np.ascontiguousarray(inputs), start))

    def integrate():
        for job in jobs:
            simulate(*job)

    integrate()
    return integrate
