"""What is on disk is whole, found again, and the tables hold whatever a field may be set to."""

import itertools
import os
import shutil
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest

import butterfly as bf
from butterfly.errors import InputError
from butterfly.experiment.record import FAILED, Outcome, RunRecord, SweepRecord, SweepRun
from butterfly.experiment.store import ResultStore
from butterfly.experiment.sweep import run_sweep
from butterfly.experiment.sweep_tables import ESTIMATES, RUNS
from tests.experiment.setting import HereEngine, planned, small_plan, tables_of


def test_half_a_record_counts_as_none_and_cleaning_takes_away_what_is_not_wanted(folder):
    plan = small_plan(folder, sweep={"repetitions": 2})
    store = ResultStore(folder / "torn")
    run_sweep(plan, store.folder, HereEngine())
    path = store.record_path(plan.tasks[0].key)
    path.write_text(path.read_text()[:100])
    assert run_sweep(plan, store.folder, HereEngine()).done == 1
    stray = RunRecord(key="ff" * 12, status=FAILED, seed=0)
    store.write(Outcome(record=stray, files={"x": b"1"}))
    begun = path.parent / ".draft-x.json.part.json"
    begun.write_text("{")
    left = store.files_path("ee" * 12)
    left.mkdir(parents=True)
    removed = {each.name for each in store.clean()}
    assert removed == {"ff" * 12, f"{'ff' * 12}.json", "ee" * 12}
    assert begun.exists()  # another process may be writing it
    os.utime(begun, (0, 0))
    assert store.clean() == [begun]
    assert store.clean() == []


def test_kept_logs_are_read_back_and_those_that_were_cut_changed_or_lost_are_done_again(folder):
    plan = small_plan(folder, keep_signals=True, duration=6.0, sweep={"repetitions": 4})
    store = ResultStore(folder / "kept-whole")
    run_sweep(plan, store.folder, HereEngine())
    kept = store.files_path(plan.tasks[0].key) / "manifest.yaml"
    read = [(log.added_mass.mass, log.time.size) for log in bf.read(kept).logs]
    assert read == [(0.0, 1501), (0.05, 1501)]
    assert run_sweep(plan, store.folder, HereEngine()).done == 0
    logs = [min(store.files_path(task.key).glob("*.parquet")) for task in plan.tasks]
    contents = {path: path.read_bytes() for path in logs}
    cut, changed, lost, whole = logs
    cut.write_bytes(contents[cut][:-1])
    changed.write_bytes(contents[changed][:-1] + bytes([contents[changed][-1] ^ 1]))
    lost.unlink()
    written = whole.stat().st_mtime_ns
    assert run_sweep(plan, store.folder, HereEngine()).done == 3
    assert whole.stat().st_mtime_ns == written
    assert {path: path.read_bytes() for path in contents} == contents
    assert run_sweep(plan, store.folder, HereEngine()).done == 0


@pytest.mark.slow
def test_a_damaged_byte_of_a_table_is_noticed(folder):
    plan = small_plan(folder, sweep={"repetitions": 2})
    store = ResultStore(folder / "flipped")
    run_sweep(plan, store.folder, HereEngine())
    path = store.folder / "estimates.parquet"
    content = bytearray(path.read_bytes())
    sound = store.table(ESTIMATES)
    for place in range(0, len(content), len(content) // 9):
        content[place] ^= 4
        path.write_bytes(content)
        with suppress(InputError):
            assert store.table(ESTIMATES).equals(sound), place
        content[place] ^= 4


def test_cleaning_follows_no_link(tmp_path):
    store, _ = _with_sweep(tmp_path / "linked", "a")
    elsewhere = tmp_path / "elsewhere"
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


@pytest.mark.parametrize(
    ("content", "found"),
    [
        ('{"fields": [], "runs": []}', "no record"),
        ("[" * 100_000, "no record"),
        ('{"schema": 6, "versions": {"butterfly": "0.3.0"}}', "a damaged record"),
        ('{"schema": 2, "versions": {"butterfly": "0.1"}}', "schema 2 of butterfly 0.1"),
    ],
)
def test_results_of_another_version_are_named_as_such(tmp_path, content, found):
    (tmp_path / "sweep.json").write_text(content)
    with pytest.raises(InputError, match=f"got {found}; expected .*repeat the sweep"):
        ResultStore(tmp_path).sweep()


def test_a_half_done_sweep_of_0_2_0_is_done_anew(tmp_path):
    """`before/` is what butterfly 0.2.0 (6a36961) left after one of two runs."""
    shutil.copytree(Path(__file__).parent / "before", tmp_path / "before")
    store = ResultStore(tmp_path / "before")
    (old,) = store.folder.glob("runs/*/*.json")
    with pytest.raises(InputError, match=r"schema 3 of butterfly 0\.2\.0; expected .*repeat"):
        store.sweep()
    store.require_own()
    summary = run_sweep(planned(store.folder / "experiment.yaml"), store.folder, HereEngine())
    assert (summary.done, summary.reused, summary.unsuccessful) == (2, 0, 0)
    assert old in store.clean()


WRITES = 300


def _written(function, folder, names):
    """Return the store that processes of some names have written with a function from here."""
    begin = f"import sys; from tests.experiment import test_store as t; t.{function}(*sys.argv[1:])"
    words = [sys.executable, "-c", begin, str(folder)]
    writers = [subprocess.Popen([*words, name]) for name in names]  # noqa: S603
    assert [writer.wait(timeout=120) for writer in writers] == [0] * len(names)
    return ResultStore(folder)


@pytest.mark.slow
def test_four_writers_lose_nothing(tmp_path):
    """Every record of each is there and whole, of runs of their own and of runs they share."""
    store = _written("write_many", tmp_path, "abde")
    for number in range(WRITES):
        for name in "abcde":
            record = store.read(_key(name, number))
            assert record is not None
            assert store.complete(record.key) == record
    assert not list(tmp_path.rglob(".draft-*"))


@pytest.mark.slow
def test_tables_that_two_write_belong_to_the_sweep(tmp_path):
    store = _written("end_often", tmp_path, "ab")
    (run,) = store.sweep().runs
    assert store.table(RUNS)["key"].to_pylist() == [run.key]


def _with_sweep(folder, name):
    """Return a store with a sweep of one run, and the sweep."""
    store, key = ResultStore(Path(folder)), name * 24
    run = SweepRun(number=0, key=key, repetition=0, seed=0, overrides={})
    about = {"name": name, "description": "", "seed": 0, "worst": 1, "versions": {}}
    sweep = SweepRecord(**about, fields=(), runs=(run,))
    store.write(Outcome(record=RunRecord(key=key, status="ok", seed=0)))
    store.end_sweep(sweep)
    return store, sweep


def end_often(folder, name):
    """End a sweep of one's own in a folder, again and again."""
    store, sweep = _with_sweep(folder, name)
    for _ in range(60):
        store.end_sweep(sweep)


def write_many(folder, name):
    """Write records that are this writer's alone, and as many that the other writes too."""
    store = ResultStore(Path(folder))
    for number in range(WRITES):
        for own in (name, "c"):
            record = RunRecord(key=_key(own, number), status="ok", seed=number)
            store.write(Outcome(record=record, files={"x": own.encode()}))


def _key(name, number):
    return f"{number:03d}{name}"[::-1]


@pytest.mark.slow
@pytest.mark.parametrize("jump", [1e7, -1e7])
def test_a_clock_that_jumps_changes_no_result(folder, undisturbed, monkeypatch, jump):
    clock = itertools.count(time.time(), jump)
    monkeypatch.setattr("time.time", lambda: next(clock))
    out = folder / f"jumps {jump > 0}"
    run_sweep(small_plan(folder), out, HereEngine())
    assert tables_of(out) == undisturbed
    assert not list(out.rglob(".draft-*"))
