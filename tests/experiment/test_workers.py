"""Engines lose no task and no time when workers die, and end what they started."""

import json
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from functools import partial

import pytest

from butterfly.errors import ButterflyError
from butterfly.experiment.record import FAILED, OK
from butterfly.experiment.run import execute
from butterfly.experiment.store import ResultStore
from butterfly.experiment.sweep import DaskEngine, LocalEngine, run_sweep
from butterfly.experiment.sweep_tables import RUNS
from tests.cli.one_line import assert_one_line_error
from tests.experiment.jobs import EndsWorker, Job, work
from tests.experiment.setting import small_plan, tables_of


def _seconds(jobs, tmp_path, **how):
    tmp_path.mkdir()
    tasks = [Job(str(k), tmp_path, 0.3, how.get("dies") == k) for k in range(jobs)]
    begun = time.perf_counter()
    outcomes = dict(LocalEngine(4).run(work, tasks, {}))
    return time.perf_counter() - begun, outcomes


@pytest.mark.slow
def test_a_worker_that_dies_costs_the_others_next_to_nothing(tmp_path):
    undisturbed, outcomes = _seconds(24, tmp_path / "a")
    assert outcomes == {str(k): None for k in range(24)}
    disturbed, outcomes = _seconds(24, tmp_path / "b", dies=5)
    assert outcomes == {str(k): None for k in range(24)} | {"5": "the worker died 3 times"}
    begun = {path.name: len(path.read_text()) for path in (tmp_path / "b").iterdir()}
    assert begun == {str(k): 1 for k in range(24)} | {"5": 3}
    assert disturbed < 2 * undisturbed


def test_workers_are_sent_what_tasks_share_and_few_tasks_and_end_when_the_engine_is_left(tmp_path):
    tasks = [Job(str(k), tmp_path, 0.05 if k == 0 else 60.0) for k in range(30)]
    outcomes = LocalEngine(2).run(work, tasks, {"0": (1.0, 2.0)})
    begun = time.perf_counter()
    assert next(outcomes) == ("0", (1.0, 2.0))
    outcomes.close()
    assert time.perf_counter() - begun < 30
    assert multiprocessing.active_children() == []
    assert len(list(tmp_path.iterdir())) <= 3


def test_workers_that_cannot_be_started_are_one_error(tmp_path):
    with pytest.raises(ButterflyError, match="exit at start"):
        list(LocalEngine(1).run(work, [Job("a", tmp_path)], {"x": EndsWorker()}))


@pytest.mark.slow
def test_a_task_whose_worker_dies_is_given_up_after_three_attempts_and_tried_again_next_time(
    folder, monkeypatch, undisturbed
):
    plan = small_plan(folder)
    work = partial(_dies_or_executes, plan.tasks[2].key)
    monkeypatch.setattr("butterfly.experiment.sweep.execute", work)
    summary = run_sweep(plan, folder / "dying", LocalEngine(2))
    assert summary.unsuccessful == 1
    rows = ResultStore(folder / "dying").table(RUNS).to_pylist()
    assert [row["status"] for row in rows] == [OK, OK, FAILED, OK, OK, OK]
    assert "died" in rows[2]["error"]
    monkeypatch.undo()
    assert run_sweep(plan, folder / "dying", LocalEngine(2)).done == 1
    assert tables_of(folder / "dying") == undisturbed


def _dies_or_executes(key, task, tables, **options):
    if task.key == key:
        os.kill(os.getpid(), signal.SIGKILL)
    return execute(task, tables, **options)


def test_a_sweep_that_cannot_be_written_leaves_no_process(folder, monkeypatch):
    def full(*_):
        raise OSError("no space left")

    monkeypatch.setattr(ResultStore, "write", full)
    with pytest.raises(OSError, match="no space"):
        run_sweep(small_plan(folder), folder / "full", LocalEngine(1))
    assert multiprocessing.active_children() == []


@contextmanager
def _cluster(folder):
    """A Dask scheduler and two workers, each a process of its own."""
    folder.mkdir()
    address = folder / "scheduler.json"
    common = ["--scheduler-file", str(address), "--host", "127.0.0.1", "--no-dashboard"]
    commands = [
        ["scheduler", "--port", "0", *common],
        *2 * [["worker", "--nthreads", "1", "--no-nanny", *common]],
    ]
    started = [
        subprocess.Popen(  # noqa: S603 - our own cluster
            [sys.executable, "-m", "dask", *command],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        for command in commands
    ]
    deadline = time.monotonic() + 30
    while not address.exists() and time.monotonic() < deadline:
        time.sleep(0.1)
    try:
        yield json.loads(address.read_text())["address"], started
    finally:
        for process in started:
            process.kill()
            process.wait()


@pytest.fixture
def cluster(tmp_path):
    pytest.importorskip("distributed")
    with _cluster(tmp_path / "cluster") as found:
        yield found


@pytest.mark.slow
def test_a_sweep_whose_scheduler_dies_goes_on_with_the_next_one(
    folder, undisturbed, cluster, tmp_path
):
    address, (scheduler, *_) = cluster
    out = folder / "restarted"
    engine = _KillsAfter(DaskEngine(address), scheduler, done=2)
    with pytest.raises(ButterflyError, match=r"lost the scheduler; .* run the same command"):
        run_sweep(small_plan(folder), out, engine)
    assert 2 <= len(list(out.glob("runs/*/*.json"))) < 6
    with _cluster(tmp_path / "next") as (address, _):
        summary = run_sweep(small_plan(folder), out, DaskEngine(address))
    assert summary.unsuccessful == 0
    assert tables_of(out) == undisturbed


@pytest.mark.slow
def test_a_dask_cluster_that_loses_a_worker_loses_no_result(folder, undisturbed, cluster):
    address, (_, *workers) = cluster
    shared = dict(DaskEngine(address).run(work, [Job("a", folder)], {"a": (1.0, 2.0)}))
    assert shared == {"a": (1.0, 2.0)}
    out = folder / "dask"
    engine = _KillsAfter(DaskEngine(address), workers[0], done=1)
    summary = run_sweep(small_plan(folder), out, engine)
    assert (summary.done, summary.unsuccessful) == (6, 0)
    assert tables_of(out) == undisturbed


class _KillsAfter:
    """An engine one of whose workers is killed after some outcomes."""

    def __init__(self, engine, worker, done):
        self._engine, self._worker, self._done = engine, worker, done

    def run(self, work, tasks, tables):
        for number, outcome in enumerate(self._engine.run(work, tasks, tables), start=1):
            if number == self._done:
                self._worker.send_signal(signal.SIGKILL)
            yield outcome


def test_a_scheduler_that_is_not_there_is_one_error(butterfly, folder, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("butterfly.experiment.sweep._ANSWER", "1s")
    small_plan(folder)
    words = ("--engine", "dask", "--scheduler", "tcp://127.0.0.1:1", "--out", folder / "none")
    assert_one_line_error(butterfly("run", folder / "small.yaml", *words), "--scheduler")
