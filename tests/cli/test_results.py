"""Results of sweeps are cleaned up, and runs compared."""

import pytest

from butterfly.experiment.sweep import run_sweep
from tests.cli.one_line import done
from tests.experiment.setting import HereEngine, small_plan


@pytest.fixture(scope="module")
def sweep(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sweep")
    grid = {"plant.friction.coulomb": [1e-4, 2e-4]}
    run_sweep(small_plan(folder, sweep={"grid": grid}), folder / "one", HereEngine())
    return folder / "one"


def test_two_runs_differ_in_what_was_varied(butterfly, sweep):
    out = done(butterfly("compare", sweep / "0", sweep / "1"))
    assert "Settings that differ" in out
    (line,) = (line for line in out.splitlines() if "friction coulomb" in line)
    assert line.split()[-2:] == ["0.0001", "0.0002"]
    assert "The settings are the same." in done(butterfly("compare", sweep / "0", sweep / "0"))


def test_a_record_that_no_run_has_is_cleaned_up(butterfly, sweep):
    stray = sweep / "runs/ab" / f"{'ab' * 12}.json"
    stray.parent.mkdir(exist_ok=True)
    stray.write_text("{}")
    out = done(butterfly("results", "clean", sweep))
    assert out.splitlines() == [f"Removed {stray}", "1 removed."]
