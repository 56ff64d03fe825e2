"""What is on disk is whole, found again, and the tables hold whatever a field may be set to."""

import pyarrow as pa
import pytest

from butterfly.errors import InputError
from butterfly.experiment.columns import ESTIMATES, RUNS, Columns
from butterfly.experiment.plan import plan_sweep
from butterfly.experiment.reading import Source
from butterfly.experiment.record import FAILED, Outcome, PlannedRun, RunRecord
from butterfly.experiment.store import ResultStore
from butterfly.experiment.sweep_runner import run_sweep
from tests.experiment.setting import HereEngine, small_plan


def test_half_a_record_counts_as_none_and_cleaning_takes_away_what_is_not_wanted(folder):
    plan = small_plan(folder, sweep={"repetitions": 2})
    store = ResultStore(folder / "torn")
    run_sweep(plan, store.folder, HereEngine())
    path = store.record_path(plan.tasks[0].key)
    path.write_text(path.read_text()[:100])
    assert run_sweep(plan, store.folder, HereEngine()).done == 1
    stray = RunRecord(key="ff" * 12, status=FAILED, seed=0)
    store.write(Outcome(record=stray, files={"x": b"1"}))
    (path.parent / ".draft-x.json.part.json").write_text("{")
    removed = {each.name for each in store.clean()}
    assert removed == {"ff" * 12, f"{'ff' * 12}.json", ".draft-x.json.part.json"}
    assert store.clean() == []


def test_cleaning_follows_no_link(folder):
    plan = small_plan(folder)
    store = ResultStore(folder / "linked")
    run_sweep(plan, store.folder, HereEngine())
    elsewhere = folder / "elsewhere"
    elsewhere.mkdir()
    kept = elsewhere / f"{'ff' * 12}.json"
    kept.write_text("{}")
    (store.folder / "runs/link").symlink_to(elsewhere, target_is_directory=True)
    (store.folder / "runs/ff").mkdir()
    (store.folder / "runs/ff" / kept.name).symlink_to(kept)
    assert store.clean() == []
    assert kept.exists()


@pytest.mark.parametrize(
    "text", ["", "[]", "null", '{"key": 3}', '{"schema": 1}', "\x00", '{"status": "ok", "seed": 1}']
)
def test_a_foreign_record_counts_as_none(tmp_path, text):
    store = ResultStore(tmp_path)
    store.write(Outcome(record=RunRecord(key="ab" * 12, status="ok", seed=1)))
    assert store.read("ab" * 12) is not None
    store.record_path("ab" * 12).write_text(text)
    assert store.read("ab" * 12) is None
    store.record_path("ab" * 12).write_bytes(b"\xff\xfe")
    assert store.read("ab" * 12) is None


def test_results_of_another_version_are_named_as_such(tmp_path):
    (tmp_path / "sweep.json").write_text('{"fields": [], "runs": []}')
    with pytest.raises(InputError, match="of this version"):
        ResultStore(tmp_path).sweep()


MIXED = [1.0, "a", True, None, {"x": 1}, {"x": {"y": 2}}, [1, 2], 10**400, 2**60, float("nan")]


@pytest.mark.parametrize(
    ("values", "kind"),
    [
        (MIXED, pa.string()),
        ([2**60, 1.5, None], pa.float64()),
        ([10**400, 1], pa.string()),
        ([True, False], pa.bool_()),
        ([True, 1], pa.string()),
        ([1e-4, "1e-4"], pa.string()),
        ([None], pa.float64()),
    ],
)
def test_a_field_may_be_set_to_anything(values, kind):
    runs = [
        PlannedRun(number=k, key=str(k), repetition=0, seed=2**63 - 1, overrides={"f": value})
        for k, value in enumerate(values)
    ]
    columns = Columns(("f",), runs)
    assert columns.schema(RUNS).field("f").type == kind
    for name in (RUNS, ESTIMATES):
        rows = [row for run in runs for row in columns.rows(name, run, None)]
        table = pa.Table.from_pylist(rows, schema=columns.schema(name))
        assert table.num_rows == (len(values) if name == RUNS else 0)
    assert (table["f"].null_count == 0) or None in values


def test_a_swept_number_may_be_written_without_a_point(tmp_path):
    path = tmp_path / "s.yaml"
    path.write_text(
        "extends: quickstart\nname: s\n"
        "sweep: {grid: {plant.encoder.noise: [1e-4, 2.0e-4], duration: [20, 3e1]}}\n"
    )
    plan = plan_sweep(Source(path))
    runs = [task.planned for task in plan.tasks]
    columns = Columns(plan.fields, runs)
    schema = columns.schema(RUNS)
    assert {schema.field(name).type for name in plan.fields} == {pa.float64()}
    (first,) = columns.rows(RUNS, runs[0], None)
    assert (first["plant.encoder.noise"], first["duration"]) == (1e-4, 20.0)
