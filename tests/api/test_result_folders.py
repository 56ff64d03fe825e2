"""Results in folders: a run, a sweep, all of them; beside logs, or damaged."""

import json
import shutil

import pytest
from pyarrow import parquet

import butterfly as bf
from butterfly.api.result_folders import run_record
from butterfly.errors import InputError
from butterfly.experiment.store import ResultStore
from butterfly.experiment.sweep import run_sweep
from butterfly.verdict import VERDICTS
from tests.experiment.setting import SINGLE, HereEngine, small_plan, written


@pytest.fixture(scope="module")
def made(tmp_path_factory, result):
    """A folder with a sweep, a run and a saved identification."""
    folder = tmp_path_factory.mktemp("made")
    plan = small_plan(folder, sweep={"grid": {"plant.encoder.noise": [0.0, 1e-4]}})
    run_sweep(plan, folder / "sweep", HereEngine())
    bf.run(written(folder / "single.yaml", **SINGLE), out=folder / "single")
    result.save(folder / "joint.json")
    return folder


def test_a_folder_of_results_lists_their_verdicts(made):
    found = bf.inspect(made)
    rows = {row["result"]: row for row in found.rows()}
    assert {name: row["kind"] for name, row in rows.items()} == {
        "joint.json": "identification",
        "single": "run",
        "sweep": "sweep",
    }
    single = bf.load(made / "single/result.json")
    assert rows["single"][single.standing] == 1
    assert sum(rows["sweep"][level.verdict] for level in VERDICTS) == 2
    assert (rows["sweep"]["runs"], rows["sweep"]["varied"]) == (2, ["encoder noise"])
    assert found.summary[0].startswith("3 results: ")
    assert str(made) not in json.dumps(found.to_dict())


def test_a_run_is_its_result_file(made):
    found, saved = bf.inspect(made / "single"), bf.load(made / "single/result.json")
    assert found.to_dict() == saved.to_dict() == bf.inspect(made / "single/result.json").to_dict()
    assert str(made / "single/manifest.yaml") in found.note
    assert bf.inspect(made / "single/manifest.yaml").kind == "inspection"


def test_a_sweep_is_what_run_answered(made, tmp_path):
    found = bf.inspect(made / "sweep")
    assert found.kind == "sweep"
    assert "runs.parquet" in found.note
    assert parquet.read_table(made / "sweep/runs.parquet").num_rows == found.content["runs"] == 2
    again = bf.run(made / "small.yaml", out=shutil.copytree(made / "sweep", tmp_path / "again"))
    assert again.to_dict() == found.to_dict()


def test_what_a_killed_sweep_has_done_is_shown(made, tmp_path):
    store = ResultStore(shutil.copytree(made / "sweep", tmp_path / "killed"))
    sweep = store.sweep()
    store.record_path(sweep.runs[1].key).unlink()
    for path in store.folder.glob("*.parquet"):
        path.unlink()
    store.begin_sweep(sweep)
    found = bf.inspect(store.folder)
    assert "1 have not run yet." in found.summary
    (row,) = bf.inspect(tmp_path).rows()
    assert (row["runs"], row["done"], row["failed"]) == (2, 1, 0)


def test_one_run_of_a_sweep_is_shown_by_its_number_or_key(made):
    record = run_record(made / "sweep", "1")
    for name in ("1", record.key[:8]):
        assert bf.inspect(made / "sweep" / name).content["key"] == record.key
    with pytest.raises(InputError, match="a number from 0 to 1"):
        bf.inspect(made / "sweep/2")


def test_logs_beside_results_stay_logs_and_the_results_are_named(quick_data, made, tmp_path):
    folder = shutil.copytree(quick_data, tmp_path / "both")
    shutil.copy(made / "joint.json", folder)
    found = bf.inspect(folder)
    assert found.kind == "inspection"
    assert found.note.endswith("by name: joint.json.")


def test_what_another_version_or_a_slip_left_is_listed_as_such(made, tmp_path):
    shutil.copytree(made / "sweep", tmp_path / "old")
    (tmp_path / "old/sweep.json").write_text('{"schema": 2, "versions": {"butterfly": "0.1"}}')
    (row,) = bf.inspect(tmp_path).rows()
    assert row["error"] == "unreadable, or another version's"
    with pytest.raises(InputError, match=r"schema 2 of butterfly 0\.1"):
        bf.inspect(tmp_path / "old")


def test_options_of_logs_are_none_of_results(made):
    with pytest.raises(InputError, match="got --log; expected no such option"):
        bf.inspect(made, logs=[0])
