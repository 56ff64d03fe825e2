"""One identification and its page, which tests of several figures look at."""

import dataclasses

import pytest

from butterfly.api.verbs import identify
from butterfly.experiment.source import read_experiment
from butterfly.identification.data import read_data_set
from butterfly.logs.manifest import read_manifest


@pytest.fixture(scope="session")
def simulated(quick_data):
    truth = read_experiment("quickstart").plant.robot.lumped
    found = identify(read_data_set(read_manifest(quick_data / "manifest.yaml")))
    return dataclasses.replace(found, truth=truth), truth


@pytest.fixture(scope="session")
def result(simulated):
    return simulated[0]


@pytest.fixture(scope="session")
def told(simulated):
    """The page, before it is written."""
    return simulated[0].page()


@pytest.fixture(scope="session")
def page(simulated, tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "report.html"
    simulated[0].report(path)
    return path
