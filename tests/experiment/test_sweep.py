"""Sweeps survive kills and lost workers, and give the same results however they are run."""

import json
import os
import random
import signal
import subprocess
import sys
import time
import uuid
from pathlib import Path

import pytest

import butterfly as bf
from butterfly.cli.output import ExitCode
from butterfly.experiment.record import OK, REFUSED
from butterfly.experiment.run import perform
from butterfly.experiment.schema import Experiment
from butterfly.experiment.source import EXPERIMENT, Source
from butterfly.experiment.store import ResultStore
from butterfly.experiment.sweep import LocalEngine, plan_sweep, run_sweep
from butterfly.experiment.sweep_tables import ESTIMATES, RUNS
from butterfly.progress import budget
from tests.cli.one_line import assert_one_line_error
from tests.experiment.setting import (
    SINGLE,
    SWEEP,
    THREE_MASSES,
    HereEngine,
    changed,
    planned,
    small_plan,
    tables_of,
    written,
)


def test_what_is_done_is_not_done_again_unless_forced(folder, undisturbed):
    plan = small_plan(folder)
    again = run_sweep(plan, folder / "one", HereEngine())
    assert (again.done, again.reused) == (0, 6)
    forced = run_sweep(plan, folder / "one", LocalEngine(2), force=True, only="1,3-4")
    assert (forced.runs, forced.done) == (3, 3)
    assert tables_of(folder / "one") == undisturbed


PROC = Path("/proc")
MARK = "BUTTERFLY_TEST_OF_STOPPING"


def _left(mark):
    """Numbers of the processes that were started with a mark."""
    found = []
    for entry in PROC.iterdir():
        try:
            own = entry.name.isdecimal() and mark.encode() in (entry / "environ").read_bytes()
        except OSError:  # it has ended, or is not ours
            continue
        if own:
            found.append(int(entry.name))
    return found


def _until(what):
    end = time.monotonic() + 60.0
    while not what():
        assert time.monotonic() < end
        time.sleep(0.02)


def _begun(path, out, mark=""):
    """Start a sweep in a process of its own; return its command, and the process."""
    command = [sys.executable, "-m", "butterfly", "run", str(path)]
    command += ["--out", str(out), "--jobs", "2"]
    pipes = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
    own = {"env": os.environ | {MARK: mark}, "start_new_session": True}
    return command, subprocess.Popen(command, **pipes, **own)  # noqa: S603 - our own command


def _records(out):
    return len(list(out.glob("runs/*/*.json")))


@pytest.mark.slow
@pytest.mark.skipif(not (PROC / "self/environ").exists(), reason="processes are seen in /proc")
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_a_stopped_sweep_leaves_results_and_no_process(quick, tmp_path, how):
    mark, out = uuid.uuid4().hex, tmp_path / "out"
    _, running = _begun(changed(quick, sweep={"repetitions": 40}), out, mark)
    _until(lambda: _records(out) > 2)
    running.send_signal(how)
    _, said = running.communicate(timeout=60.0)
    _until(lambda: not _left(mark))
    if how is not signal.SIGKILL:
        assert running.returncode == ExitCode.STOPPED
        last = said.splitlines()[-1]  # a slow machine tells its progress before
        assert last.startswith(
            f"stopped: {_records(out)} of 40 runs are done; run the same command "
        )


@pytest.mark.slow
def test_killed_at_random_moments_and_resumed_the_tables_are_the_same(tmp_path):
    plant = SINGLE["plant"] | {"clock": {}, "simulator": "mujoco"}  # which takes a while
    run_sweep(small_plan(tmp_path, plant=plant), tmp_path / "undisturbed", HereEngine())
    out, done = tmp_path / "killed", 0
    chance = random.Random(0)  # noqa: S311 - moments, not secrets
    for _ in range(2):
        command, process = _begun(tmp_path / "small.yaml", out)
        _until(lambda: _records(out) > done)  # noqa: B023 - called at once
        time.sleep(chance.uniform(0.0, 0.1))
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        done = _records(out)
    assert not (out / "runs.parquet").exists()
    finished = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603
    assert finished.returncode == 0, finished.stderr
    assert tables_of(out) == tables_of(tmp_path / "undisturbed")


LEFT_OUT = {"added_masses": THREE_MASSES, "validation": {"split": "mass"}}


def test_a_run_whose_search_was_stopped_is_done_again_once_it_may_search_for_longer(folder):
    plan = small_plan(folder, **LEFT_OUT, sweep={"repetitions": 1})
    store = ResultStore(folder / "stopped")
    with budget(0.0) as search:
        assert run_sweep(plan, store.folder, HereEngine()).done == 1
        assert run_sweep(plan, store.folder, HereEngine()).done == 0
    assert search.left_out == []  # what is done elsewhere is told in the records
    assert store.read(plan.tasks[0].key).stopped_after == 0.0
    assert run_sweep(plan, store.folder, HereEngine()).done == 1
    assert store.read(plan.tasks[0].key).stopped_after is None


def test_what_a_run_simulates_first_takes_nothing_of_its_time_to_search():
    experiment = Experiment.model_validate(SINGLE | LEFT_OUT)
    with budget(60.0) as search:
        search.begun -= 60.0
        assert perform(experiment).record.stopped_after is None
    with budget(0.0) as search:
        assert perform(experiment).record.stopped_after == 0.0
    assert search.left_out == ["some parts of the cross-validation"]


def test_planning_and_writing_the_tables_tell_how_far_they_are(folder):
    told = []

    def track(items, description):
        told.append((description, len(items) if hasattr(items, "__len__") else None))
        return items

    path = written(folder / "small.yaml", **SWEEP | {"sweep": {"repetitions": 2}})
    plan = plan_sweep(Source(path), track=track)
    run_sweep(plan, folder / "told", HereEngine(), track=track)
    parts = ("Checking finished runs", "Running", "Writing the tables")
    assert told == [("Planning", None), *((part, 2) for part in parts)]


WILD = {"signals": [{"multisine": {"base": 0.5, "harmonics": [4], "peak": 1e200, "seed": 0}}]}
ONE_MASS = {"added_masses": SINGLE["added_masses"][:1]}


def test_a_run_that_is_refused_is_recorded_with_its_reason_and_the_others_go_on(folder):
    plan = small_plan(folder, sweep={"list": [WILD, ONE_MASS, {"plant.encoder.noise": 0.0}]})
    assert run_sweep(plan, folder / "refused", HereEngine()).unsuccessful == 2
    rows = ResultStore(folder / "refused").table(RUNS).to_pylist()
    assert [row["status"] for row in rows] == [REFUSED, REFUSED, OK]
    for row, reason in zip(rows, ("command: got", "no log has an added mass", ""), strict=True):
        assert reason in row["error"]
    assert rows[2]["error"] == ""
    assert run_sweep(plan, folder / "refused", HereEngine()).done == 0


def test_runs_are_validated_by_what_is_left_out_where_that_can_be(folder):
    masses = [{"added_masses": some} for some in (SINGLE["added_masses"], THREE_MASSES)]
    plan = small_plan(folder, validation={"split": "mass"}, sweep={"list": masses})
    assert run_sweep(plan, folder / "validated", HereEngine()).unsuccessful == 0
    store = ResultStore(folder / "validated")
    assert "no cross-validation" in store.table(RUNS)["error"][0].as_py()
    rows = store.table(ESTIMATES).to_pylist()
    assert {row["held_out_median"] for row in rows if row["number"] == 0} == {None}
    assert all(row["held_out_median"] > 90 for row in rows if row["number"] == 1)


@pytest.mark.usefixtures("undisturbed")
def test_results_are_listed_shown_compared_and_cleaned_up(butterfly, folder):
    one = folder / "one"

    def said(*words):
        code, out, _ = butterfly(*words)
        assert code == 0
        return out

    assert "encoder noise" in said("inspect", folder)
    assert "weak-form" in said("inspect", one / "4")
    assert f"All rows: {one / 'runs.parquet'}" in said("inspect", one)
    assert "encoder noise" in said("compare", one / "0", one / "3")
    compared = json.loads(said("compare", one / "0", one / "1", "--json", "-"))
    assert compared["schema"] == "butterfly.runs"
    for run in compared["runs"]:
        (estimate,) = run["estimates"]
        assert estimate["parameters"]["p1"]["unit"] == "kg m²"
    assert said("results", "clean", one).strip() == "0 removed."


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (("inspect", "one/9999"), "a number from 0 to 5"),
        (("inspect", "one", "--log", "0"), "no such option"),
        (("inspect", "nowhere/0"), "an existing path"),
        (("results list", "one"), "butterfly inspect FOLDER"),
        (("results show", "one", "0"), "butterfly inspect FOLDER/NUMBER"),
        (("results table", "one", "--columns", "key"), "runs.parquet and estimates.parquet"),
        (("results clean", "nowhere"), "a folder of results"),
    ],
)
@pytest.mark.usefixtures("undisturbed")
def test_a_slip_about_results_is_one_line(butterfly, folder, arguments, part):
    verb, place, *words = arguments
    assert_one_line_error(butterfly(*verb.split(), folder / place, *words), part)


@pytest.mark.usefixtures("undisturbed")
def test_a_sweep_is_run_and_reported_from_the_command_line(butterfly, folder):
    plan, one = small_plan(folder), folder / "one"
    command = ("run", folder / "small.yaml", "--out", one)
    code, out, err = butterfly(*command, "--figures")
    assert code == 0, err
    assert "6 already done" in out
    assert "Verdicts on 6 estimates: " in out
    assert "Against encoder noise" in (one / "report.html").read_text(encoding="utf-8")
    assert (one / "report-figures/axis-0.png").exists()
    numbers = json.loads((one / "report.json").read_text())
    assert numbers["ok"] == 6
    assert json.loads(butterfly(*command, "--json", "-")[1]) == numbers
    again = bf.load(one / "report.json")
    assert (again.content["unsuccessful"], again.to_dict()) == (0, numbers)
    first, *others = again.paragraphs()
    assert first.startswith("Half of all estimates are within ")
    assert any(text.startswith("6 runs, 6 with a result") for text in others)
    assert planned(one / EXPERIMENT).tasks == plan.tasks
    assert butterfly(*command, "--only", "9")[0] == 2


@pytest.mark.slow
def test_an_orbit_can_be_swept(folder):
    control = {"target": {"amplitude": 0.9}, "duration": 12.0, "starts": [0.9, 0.6, 1.1]}
    believed = {"p1": 0.003, "p2": 0.0012, "p3": 0.045, "p4": 9.0}
    control |= {"believed": believed, "rounds": 2}
    base = {key: SINGLE[key] for key in SINGLE if key not in {"signals", "estimators"}}
    base |= {"plant": SINGLE["plant"] | {"clock": {}}, "control": control}
    grid = {"control.target.amplitude": [0.8, 1.0]}
    plan = planned(written(folder / "orbits.yaml", **base, sweep={"grid": grid}))
    assert run_sweep(plan, folder / "orbits", LocalEngine(2)).unsuccessful == 0
    for row in ResultStore(folder / "orbits").table(RUNS).to_pylist():
        assert row["orbit_amplitude"] == pytest.approx(row["orbit_target"], abs=5e-3)
        assert row["orbit_error_recalibrated"] < row["orbit_error_generic"]
