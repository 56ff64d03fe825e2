"""Figures that tests of several files look at."""

import pytest

from butterfly.cli.commands import thesis_robot
from butterfly.thesis.figures import synthetic_figures


@pytest.fixture(scope="session")
def synthetic():
    return {figure.name: figure for figure in synthetic_figures(thesis_robot())}
