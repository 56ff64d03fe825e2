"""A run gives all that is asked for, is kept, and is found again; `simulate` makes a data set."""

import json
import math
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml

import butterfly as bf
from butterfly.api.experiments import run_answer
from butterfly.api.identification import Identification
from butterfly.experiment.record import OrbitRecord, RunRecord
from butterfly.experiment.source import EXPERIMENT, read_experiment
from butterfly.experiment.store import ResultStore
from butterfly.experiment.sweep import run_sweep
from tests.cli.one_line import assert_one_line_error
from tests.experiment import setting
from tests.experiment.setting import ESTIMATORS, SHIPPED, changed

ASKED = {"validation": {"split": "mass"}, "keep_signals": True, "estimators": ESTIMATORS}


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """What a run gave of which much is asked, its file, and the folder of its results."""
    folder = tmp_path_factory.mktemp("run")
    path = setting.written(
        folder / "single.yaml", **setting.SINGLE | ASKED | {"added_masses": setting.THREE_MASSES}
    )
    return bf.run(path, out=folder / "out"), path, folder / "out"


def _json(path):
    return json.loads(path.read_text(encoding="utf-8"))


def test_every_key_counts_without_a_sweep(run):
    found, _, out = run
    left_out = "weak-form(load): held-out logs, median FIT"
    assert any(text.startswith(left_out) for text in found.paragraphs())
    for name in ("report.html", "report-2.html", "sweep.json", "runs.parquet", "manifest.yaml"):
        assert (out / name).exists()
    (task,) = ResultStore(out).sweep().runs
    record = ResultStore(out).read(task.key)
    labels = ["weak-form", "weak-form(load)"]
    assert [each.estimator for each in record.estimates] == list(found.identifications) == labels
    assert all(each.held_out.median > 90 for each in record.estimates)
    own = found.identifications[labels[1]].rows()[-1]
    assert found.rows()[-1] == {"estimator": labels[1]} | own
    assert (ResultStore(out).files_path(task.key) / "manifest.yaml").exists()
    numbers = _json(out / "report.json")["parameters"]
    assert {row.name: row.value for row in record.estimates[0].parameters} == {
        name: row["value"] for name, row in numbers.items()
    }


def test_a_run_keeps_its_experiment_and_its_truth(run, butterfly):
    _, _, out = run
    truth = read_experiment(out / EXPERIMENT).plant.robot.lumped
    said = _json(out / "result.json")
    assert said["experiment"] == yaml.safe_load((out / EXPERIMENT).read_text())
    assert said["truth"]["p1"] == {"value": truth.p1, "unit": "kg m²"}
    first = said["estimates"][0]
    assert first["parameters"]["p3"]["true"] == truth.p3
    assert first["truth"] == said["truth"]
    assert first["parameters"] == _json(out / "report.json")["parameters"]
    del said["digest"]  # of the file
    code, again, _ = butterfly("run", out / EXPERIMENT, "--out", out, "--json", "-")
    assert (code, json.loads(again)) == (0, said)


def test_the_logs_of_a_run_are_identified_alike_by_identify(run, butterfly):
    _, _, out = run
    words = ("--method", "weak-form", "--terms", "", "--json", "-")
    code, printed, err = butterfly("identify", out, *words)
    assert code == 0, err
    first, again = (
        each["parameters"] for each in (_json(out / "report.json"), json.loads(printed))
    )
    for name, row in first.items():
        assert row | {"true": None} == again[name] | {"true": None}


def test_a_run_that_is_done_is_found_and_anything_else_is_done_anew(
    run, butterfly, tmp_path, monkeypatch
):
    path, out = Path(shutil.copy(run[1], tmp_path)), shutil.copytree(run[2], tmp_path / "out")
    written_at = (out / "report.html").stat().st_mtime_ns
    code, printed, err = butterfly("run", path, "--out", out)
    assert (code, err) == (0, "")
    assert "already done; --force repeats it" in printed
    assert (out / "report.html").stat().st_mtime_ns == written_at
    lines = run[0].judged.lines
    assert tuple(printed.splitlines()[:2]) == lines[:2]
    whole = butterfly("run", path, "--out", out, "--verbose")[1]
    assert all(line in " ".join(whole.split()) for line in lines)
    again = bf.run(path, out=out)
    assert again.to_dict() == run[0].to_dict()
    again.save(tmp_path / "again.json")
    for each in (again, bf.load(tmp_path / "again.json")):
        assert (str(each), each.tables()) == (str(run[0]), run[0].tables())
    assert list(again.identifications) == list(run[0].identifications)
    setting.changed(path, estimators=ESTIMATORS[:1], validation=None, keep_signals=False)

    monkeypatch.setattr(Identification, "report", lambda _, path, **__: path.write_text(""))

    def is_found(*words):
        return "already done" in butterfly("run", path, "--out", out, *words)[1]

    assert not is_found()
    assert is_found()
    assert not is_found("--force")
    (out / "result.json").write_text("{}")
    assert not is_found()
    run_sweep(setting.planned(path), out, setting.HereEngine(), only="0")
    assert not is_found()


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (("--only", "1"), "numbers from 0 to 0"),
        (("--only", "x"), "--only"),
        (("--scheduler", "tcp://127.0.0.1:1"), "--engine dask"),
    ],
)
def test_an_option_that_says_nothing_of_a_single_run_is_refused(run, butterfly, arguments, part):
    assert_one_line_error(butterfly("run", run[1], "--out", run[2], *arguments), part)


def test_an_experiment_in_memory_is_the_data_set_of_its_folder(quick, tmp_path):
    loads = [{"mass": 0.05, "mass_uncertainty": 1e-3}, {"mass": 0.12, "arm_uncertainty": 2e-3}]
    loads[1]["own_inertia"] = 5e-5
    added = [{"mass": 0.0}, *({"arm": 0.104} | each for each in loads)]
    known = {"p4": {"value": 0.025, "uncertainty": 0.001}}
    sines = SHIPPED["excitations"][2::3]
    about = {"known": known, "holdout": ["run002*"], "excitations": sines, "duration": 6.0}
    changed(quick, added_masses=added, **about)
    memory, folder = bf.simulate(quick), bf.simulate(quick, out=tmp_path / "logs")
    for data in (memory, folder):
        assert data.given.to_dict() == known
        assert [log.name[:6] for log in data.test_logs.logs] == ["run002"]
        carried = [log.added_mass for log in data.logs]
        uncertain = {(added.mass_uncertainty, added.arm_uncertainty) for added in carried}
        assert uncertain == {(0.0, 0.0), (1e-3, 0.0), (0.0, 2e-3)}
        assert {added.own_inertia for added in carried} == {0.0, 5e-5}
    first, second = (bf.identify(data, "linear").estimate for data in (memory, folder))
    np.testing.assert_array_equal(first.values, second.values)
    np.testing.assert_array_equal(first.covariance, second.covariance)


def test_a_run_with_an_orbit_begins_with_whether_it_is_held_and_is_judged_near_it():
    errors = {"generic": math.radians(20), "re-calibrated": math.radians(0.02)}
    sizes = {"target_rad": math.radians(60), "amplitudes_rad": (math.radians(59.95),)}
    ended = {"ending": "the amplitude error is within its bound", "reached": True}
    more = {"absolute": True, "cross_orbit": {}, "verdict": "good"}
    orbit = OrbitRecord(**sizes, **ended, **more, free_run_rms_rad=errors)
    found = run_answer(RunRecord(status="ok", seed=1, orbit=orbit), "Run")
    assert found.headline == ("Held: an orbit of 60°. Reached 59.95° in 1 round.",)
    assert found.summary[1] == (
        "Good: error of a free run near the orbit, by its model: 20° generic, 0.02° re-calibrated."
    )
    again = bf.Answer.from_dict(json.loads(json.dumps(found.to_dict())))
    assert again.headline == found.headline
    assert again.notes == found.notes
    *_, settings = found.tables()
    assert ("status", "ok") in settings.rows
