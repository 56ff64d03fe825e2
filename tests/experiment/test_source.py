"""The experiment that is kept beside its results."""

import json
import math

import numpy as np
import pytest
import yaml

from butterfly.errors import InputError
from butterfly.experiment.source import EXPERIMENT, Source, keep_experiment, read_experiment
from butterfly.experiment.sweep import plan_sweep
from tests.cli.one_line import assert_one_line_error

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
    path = folder / "kept.yaml"
    path.write_text(yaml.safe_dump(CHANGES))
    return path


@pytest.mark.parametrize("sweep", [{}, {"sweep": {"grid": {"plant.encoder.noise": [1e-5, 1 / 3]}}}])
def test_what_is_kept_is_the_same_experiment_bit_for_bit(given, tmp_path, sweep):
    given.write_text(yaml.safe_dump(CHANGES | sweep))
    source = Source(given)
    plan = plan_sweep(source)
    written = keep_experiment(source, tmp_path / "out")
    assert written == [EXPERIMENT, "inputs/wave.csv"]
    again = plan_sweep(Source(tmp_path / "out" / EXPERIMENT))
    assert again.experiment == plan.experiment
    assert [task.key for task in again.tasks] == [task.key for task in plan.tasks]
    assert "extends:" not in (tmp_path / "out" / EXPERIMENT).read_text()


def test_a_file_of_the_experiment_is_never_replaced(given, tmp_path):
    renamed = given.rename(given.with_name(EXPERIMENT))
    with pytest.raises(InputError, match="--out"):
        keep_experiment(Source(renamed), renamed.parent)
    source = Source(renamed)
    source.experiment()
    keep_experiment(source, tmp_path / "out")
    kept = (tmp_path / "out" / EXPERIMENT).read_bytes()
    source = Source(tmp_path / "out" / EXPERIMENT)
    source.experiment()
    keep_experiment(source, tmp_path / "out")
    assert (tmp_path / "out" / EXPERIMENT).read_bytes() == kept


def test_a_run_keeps_its_experiment_and_its_truth(butterfly, quick, tmp_path):
    out, told = tmp_path / "out", tmp_path / "told.json"
    assert butterfly("run", quick, "--out", out, "--json", told)[0] == 0
    truth = read_experiment(out / EXPERIMENT).plant.robot.lumped
    said = json.loads(told.read_text())
    assert said == json.loads((out / "result.json").read_text())
    assert said["experiment"] == yaml.safe_load((out / EXPERIMENT).read_text())
    assert said["truth"]["p1"] == {"value": truth.p1, "unit": "kg m²"}
    (estimate,) = said["estimates"]
    assert estimate["parameters"]["p3"]["true"] == truth.p3
    assert estimate["truth"] == said["truth"]
    beside = json.loads((out / "report.json").read_text())
    assert beside["parameters"] == estimate["parameters"]
    code, again, _ = butterfly("run", out / EXPERIMENT, "--out", out, "--json", "-")
    assert code == 0
    assert json.loads(again) == said
    (out / "result.json").write_text("{}")
    assert "found done" not in butterfly("run", quick, "--out", out)[1]


def test_results_in_the_experiment_s_own_folder_are_refused_before_anything_is_done(
    butterfly, quick
):
    own = quick.rename(quick.with_name(EXPERIMENT))
    text = own.read_text()
    result = butterfly("run", own, "--out", own.parent)
    assert_one_line_error(result, "the file of the experiment", "--out")
    assert own.read_text() == text
    assert not (own.parent / "sweep.json").exists()
