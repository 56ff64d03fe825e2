"""The experiment that is kept beside its results."""

import math

import numpy as np
import pytest

from butterfly.errors import InputError
from butterfly.experiment.source import EXPERIMENT, Source, keep_experiment
from butterfly.experiment.sweep import plan_sweep
from tests.cli.one_line import assert_one_line_error
from tests.experiment.setting import planned, written

CHANGES = {
    "extends": "base.yaml",
    "name": "kept",
    "seed": 7,
    "plant": {"encoder": {"noise": 1.0e-5}, "simulator": "grey-box", "path": {"delay": 1 / 3000}},
    "signals": [
        {"file": {"path": "inputs/wave.csv", "values": "u"}},
        {"prbs": {"amplitude": 0.1, "bit": 0.3}},
    ],
}


@pytest.fixture
def given(tmp_path, quick):
    """An experiment that extends another, with a signal from a file."""
    folder = tmp_path / "given"
    (folder / "inputs").mkdir(parents=True)
    quick.rename(folder / "base.yaml")
    time = np.arange(40) * 0.3
    rows = "\n".join(f"{t!r},{0.1 * math.sin(3 * t)!r}" for t in time.tolist())
    (folder / "inputs/wave.csv").write_text(f"time,u\n{rows}\n")
    return written(folder / "kept.yaml", **CHANGES)


@pytest.mark.parametrize("sweep", [{}, {"sweep": {"grid": {"plant.encoder.noise": [1e-5, 1 / 3]}}}])
def test_what_is_kept_is_the_same_experiment_bit_for_bit(given, tmp_path, sweep):
    source = Source(written(given, **CHANGES | sweep))
    plan = plan_sweep(source)
    assert keep_experiment(source, tmp_path / "out") == [EXPERIMENT, "inputs/wave.csv"]
    again = planned(tmp_path / "out" / EXPERIMENT)
    assert again.experiment == plan.experiment
    assert [task.key for task in again.tasks] == [task.key for task in plan.tasks]
    assert "extends:" not in (tmp_path / "out" / EXPERIMENT).read_text()


def test_a_file_of_the_experiment_is_never_replaced(given, tmp_path, butterfly):
    renamed = given.rename(given.with_name(EXPERIMENT))
    with pytest.raises(InputError, match="--out"):
        keep_experiment(Source(renamed), renamed.parent)
    before = renamed.read_text()
    result = butterfly("run", renamed, "--out", renamed.parent)
    assert_one_line_error(result, "a new folder", "--out")
    assert renamed.read_text() == before
    assert not (renamed.parent / "sweep.json").exists()  # it is refused before anything is done
    contents = []
    for path in (renamed, tmp_path / "out" / EXPERIMENT):
        source = Source(path)
        source.experiment()
        keep_experiment(source, tmp_path / "out")
        contents.append((tmp_path / "out" / EXPERIMENT).read_bytes())
    assert contents[0] == contents[1]
