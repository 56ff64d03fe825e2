"""A single run is a run of a sweep, and nothing that is asked for is ignored."""

import json
from dataclasses import replace

import numpy as np
import pytest
import yaml

from butterfly.errors import IdentifiabilityError, InputError
from butterfly.experiment import perform as performing
from butterfly.experiment.perform import execute, perform
from butterfly.experiment.record import OK, REFUSED
from butterfly.experiment.schema import Experiment
from butterfly.experiment.source import Source, read_experiment
from butterfly.experiment.store import ResultStore
from butterfly.experiment.sweep import plan_sweep, run_sweep
from tests.experiment.setting import SWEEP, HereEngine, small_plan

SINGLE = {key: value for key, value in SWEEP.items() if key != "sweep"} | {"name": "single"}
THREE = [*SWEEP["added_masses"], {"mass": 0.1, "arm": 0.1}]
ESTIMATORS = [{"method": "weak-form", "terms": terms} for terms in ([], ["load"])]


def _small(tmp_path, **changes):
    path = tmp_path / "single.yaml"
    path.write_text(yaml.safe_dump(SINGLE | changes))
    return path


def test_a_run_gives_the_same_in_a_worker_and_here(folder):
    plan = small_plan(folder)
    here = perform(Experiment.model_validate(plan.tasks[3].content)).record
    there = execute(plan.tasks[3], {}).record
    place = {"key": "", "overrides": {}, "repetition": 0, "seconds": {}}
    assert replace(there, **place).to_json() == replace(here, **place).to_json()
    assert there.key == plan.tasks[3].key


def test_every_key_counts_without_a_sweep(butterfly, tmp_path):
    path = _small(
        tmp_path,
        added_masses=THREE,
        estimators=ESTIMATORS,
        validation={"split": "mass"},
        keep_signals=True,
    )
    out = tmp_path / "out"
    code, printed, err = butterfly("run", path, "--out", out)
    assert (code, err) == (0, "")
    assert printed.count("deviation") == 2
    assert "weak-form(load): logs that were left out are followed with a median FIT" in printed
    assert "harmonic" not in printed
    for name in ("report.html", "report-2.html", "sweep.json", "runs.parquet", "manifest.yaml"):
        assert (out / name).exists()
    (run,) = ResultStore(out).sweep().runs
    record = ResultStore(out).read(run.key)
    assert [each.estimator for each in record.estimates] == [
        "weak-form(no terms)",
        "weak-form(load)",
    ]
    assert all(each.held_out.median > 90 for each in record.estimates)
    assert (ResultStore(out).files_path(run.key) / "manifest.yaml").exists()
    (first, _) = record.estimates
    numbers = json.loads((out / "report.json").read_text())["parameters"]
    for row in first.parameters:
        assert numbers[row.name]["value"] == row.value


def test_a_run_that_is_done_is_printed_from_its_record(butterfly, tmp_path):
    path, out = _small(tmp_path), tmp_path / "out"
    _, first, _ = butterfly("run", path, "--out", out)
    written = (out / "report.html").stat().st_mtime_ns
    code, again, _ = butterfly("run", path, "--out", out)
    assert code == 0
    assert "found done; --force does it again" in again
    assert (out / "report.html").stat().st_mtime_ns == written
    assert again.splitlines()[0] == first.splitlines()[0]  # the verdict
    (estimate,) = json.loads((out / "result.json").read_text())["estimates"]
    for row in estimate["parameters"].values():
        assert f"{row['value']:.5g}" in again
    assert "found done" not in butterfly("run", path, "--out", out, "--force")[1]
    other = _small(tmp_path, duration=13.0)
    assert "found done" not in butterfly("run", other, "--out", out)[1]
    assert "found done" not in butterfly("run", _small(tmp_path), "--out", out)[1]
    run_sweep(plan_sweep(Source(path)), out, HereEngine(), only="0")
    assert "found done" not in butterfly("run", path, "--out", out)[1]


def test_the_logs_of_a_run_are_identified_alike_by_identify(butterfly, tmp_path):
    path, out = _small(tmp_path, added_masses=THREE), tmp_path / "out"
    butterfly("run", path, "--out", out)
    report = tmp_path / "again.html"
    code, _, err = butterfly(
        *("identify", out, "--method", "weak-form", "--terms", "", "--report", report)
    )
    assert code == 0, err
    first = json.loads((out / "report.json").read_text())["parameters"]
    again = json.loads((tmp_path / "again.json").read_text())["parameters"]
    for name, row in first.items():
        assert {k: v for k, v in row.items() if k != "true"} == {
            k: v for k, v in again[name].items() if k != "true"
        }


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (("--only", "1"), "numbers from 0 to 0"),
        (("--only", "x"), "--only"),
        (("--scheduler", "tcp://127.0.0.1:1"), "--engine dask"),
    ],
)
def test_an_option_that_says_nothing_of_a_single_run_is_refused(
    butterfly, tmp_path, arguments, part
):
    code, _, err = butterfly("run", _small(tmp_path), "--out", tmp_path / "out", *arguments)
    assert code == 2
    assert part in err


def test_a_run_in_which_every_estimator_refused_has_no_result():
    content = SINGLE | {"added_masses": SINGLE["added_masses"][:1], "estimators": ESTIMATORS}
    result = perform(Experiment.model_validate(content))
    assert result.record.status == REFUSED
    assert isinstance(result.error, IdentifiabilityError)
    assert len(result.record.estimates) == 2
    assert result.record.logs == len(result.logs) == 1


def test_a_run_in_which_one_of_two_estimators_refused_has_a_result():
    estimators = [{"method": "harmonic-balance"}, ESTIMATORS[0]]
    result = perform(Experiment.model_validate(SINGLE | {"estimators": estimators}))
    assert result.record.status == OK
    assert list(result.identifications) == ["weak-form(no terms)"]
    assert "harmonic-balance: " in result.record.reason


def test_intervals_mean_the_same_whether_or_not_logs_are_held_out():
    estimators = [{"method": "output-error", "terms": []}]
    content = SINGLE | {"added_masses": THREE, "estimators": estimators, "duration": 6.0}

    def parameters(**changes):
        (estimate,) = perform(Experiment.model_validate(content | changes)).record.estimates
        return estimate.parameters

    plain = parameters()
    assert plain == parameters(validation={"split": "mass"})
    assert all(row.lower <= row.least_left_out for row in plain)
    assert all(row.largest_left_out <= row.upper for row in plain)
    unchecked = parameters(estimators=[estimators[0] | {"check": False}])
    assert all(row.least_left_out is None for row in unchecked)


def test_two_estimators_of_one_name_are_refused():
    with pytest.raises(ValueError, match="estimators that differ"):
        Experiment.model_validate(SINGLE | {"estimators": [ESTIMATORS[0], ESTIMATORS[0]]})


def test_the_orbit_draws_from_a_stream_of_its_own(monkeypatch):
    drawn = []

    def stop(*_, rng, **__):
        drawn.append(rng.random(8).tolist())
        raise InputError("orbit", "x", "y", "z")

    monkeypatch.setattr(performing, "study_orbit", stop)
    control = {"target": {"amplitude": 0.9}, "starts": [0.9]}
    control["believed"] = {"p1": 0.003, "p2": 0.0012, "p3": 0.045, "p4": 9.0}
    experiment = Experiment.model_validate(SINGLE | {"control": control, "duration": 2.0})
    perform(experiment)
    runs = np.random.SeedSequence(3).spawn(4)
    assert drawn == [np.random.default_rng(experiment.orbit_seed).random(8).tolist()]
    assert drawn[0] not in [np.random.default_rng(each).random(8).tolist() for each in runs]


def test_logs_held_out_by_name_are_foretold_and_recorded(quick):
    experiment = read_experiment(quick).model_copy(update={"holdout": ("run000*",)})
    result = perform(experiment)
    (record,) = result.record.estimates
    assert record.holdout.median > 90
    (identification,) = result.identifications.values()
    assert len(identification.data.logs) == len(result.logs) - 1
    assert list(identification.held_out) == [result.logs[0].name]
