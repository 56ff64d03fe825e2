"""Results that several test files look at."""

import pytest

from butterfly.experiment.sweep import run_sweep
from tests.experiment.setting import HereEngine, small_plan, tables_of


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("sweeps")


@pytest.fixture(scope="session")
def undisturbed(folder):
    """Tables of the small sweep, run without workers into ``folder / "one"``."""
    summary = run_sweep(small_plan(folder), folder / "one", HereEngine())
    assert (summary.runs, summary.done, summary.unsuccessful) == (6, 6, 0)
    return tables_of(folder / "one")
