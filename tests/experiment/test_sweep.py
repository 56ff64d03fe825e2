"""Sweeps survive kills and lost workers, and give the same results however they are run."""

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml

from butterfly.experiment.record import OK, REFUSED
from butterfly.experiment.source import EXPERIMENT, Source
from butterfly.experiment.store import ResultStore
from butterfly.experiment.sweep import plan_sweep, run_sweep
from butterfly.experiment.sweep_tables import ESTIMATES, RUNS
from butterfly.experiment.workers import LocalEngine
from butterfly.identification.data import read_data_set
from butterfly.logs.manifest import read_manifest
from tests.experiment.setting import SWEEP, HereEngine, small_plan, tables_of


def test_what_is_done_is_not_done_again_unless_forced(folder, undisturbed):
    plan = small_plan(folder)
    again = run_sweep(plan, folder / "one", LocalEngine(1))
    assert (again.done, again.reused) == (0, 6)
    forced = run_sweep(plan, folder / "one", LocalEngine(2), force=True, only="1,3-4")
    assert (forced.runs, forced.done) == (3, 3)
    assert tables_of(folder / "one") == undisturbed


@pytest.mark.usefixtures("undisturbed")
def test_the_tables_say_what_was_set_and_found(folder):
    store = ResultStore(folder / "one")
    runs, estimates = store.table(RUNS), store.table(ESTIMATES)
    assert runs["plant.encoder.noise"].to_pylist() == [0.0] * 3 + [1e-4] * 3
    assert runs["status"].to_pylist() == [OK] * 6
    assert estimates.num_rows == 6 * 6
    for row in estimates.to_pylist():
        assert row["estimator"] == "weak-form(no terms)"
        if row["parameter"] in {"p1", "p3", "p4"}:
            assert abs(row["deviation"]) < 0.02
    record = store.read(runs["key"][0].as_py())
    assert record.versions["butterfly"]
    assert record.seconds["total"] >= record.seconds["simulate"]


@pytest.mark.slow
def test_killed_at_random_moments_and_resumed_the_tables_are_the_same(folder, undisturbed):
    small_plan(folder)
    out = folder / "killed"
    command = [sys.executable, "-m", "butterfly", "run", str(folder / "small.yaml")]
    command += ["--out", str(out), "--jobs", "2"]
    chance = random.Random(0)  # noqa: S311 - moments, not secrets
    done = 0
    for _ in range(2):
        process = subprocess.Popen(  # noqa: S603 - our own command
            command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
        )
        deadline = time.monotonic() + 60
        while len(list(out.glob("runs/*/*.json"))) <= done and time.monotonic() < deadline:
            time.sleep(0.02)
        time.sleep(chance.uniform(0.0, 0.1))
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        done = len(list(out.glob("runs/*/*.json")))
        assert done > 0
    assert not (out / "runs.parquet").exists()
    finished = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603
    assert finished.returncode == 0, finished.stderr
    assert tables_of(out) == undisturbed


def test_a_run_that_cannot_be_identified_is_recorded_and_the_others_go_on(folder):
    one_mass = [{"mass": 0.0, "arm": 0.1}]
    plan = small_plan(
        folder, sweep={"list": [{"added_masses": one_mass}, {"plant.encoder.noise": 0.0}]}
    )
    summary = run_sweep(plan, folder / "refused", HereEngine())
    assert summary.unsuccessful == 1
    rows = ResultStore(folder / "refused").table(RUNS).to_pylist()
    assert [row["status"] for row in rows] == [REFUSED, OK]
    assert "carry no added mass" in rows[0]["error"]
    assert rows[1]["error"] == ""


def test_a_run_that_cannot_be_used_is_refused_with_its_reason(folder):
    wild = {"multisine": {"base": 0.5, "harmonics": [4], "peak": 1e200, "seed": 0}}
    plan = small_plan(folder, sweep={"list": [{"signals": [wild]}, {"plant.encoder.noise": 0.0}]})
    summary = run_sweep(plan, folder / "wild", HereEngine())
    assert summary.unsuccessful == 1
    rows = ResultStore(folder / "wild").table(RUNS).to_pylist()
    assert [row["status"] for row in rows] == [REFUSED, OK]
    assert "command: got" in rows[0]["error"]
    again = run_sweep(plan, folder / "wild", HereEngine())
    assert again.done == 0


def test_runs_are_validated_by_what_is_left_out_where_that_can_be(folder):
    two = SWEEP["added_masses"]
    three = [*two, {"mass": 0.1, "arm": 0.1}]
    plan = small_plan(
        folder,
        validation={"split": "mass"},
        sweep={"list": [{"added_masses": two}, {"added_masses": three}]},
    )
    assert run_sweep(plan, folder / "validated", HereEngine()).unsuccessful == 0
    store = ResultStore(folder / "validated")
    assert "nothing could be left out" in store.table(RUNS)["error"][0].as_py()
    rows = store.table(ESTIMATES).to_pylist()
    assert {row["held_out_median"] for row in rows if row["number"] == 0} == {None}
    assert all(row["held_out_median"] > 90 for row in rows if row["number"] == 1)


def test_logs_are_kept_where_asked_and_read_back_as_a_data_set(folder):
    plan = small_plan(folder, keep_signals=True, sweep={"repetitions": 1})
    run_sweep(plan, folder / "kept", LocalEngine(1))
    store = ResultStore(folder / "kept")
    manifest = store.files_path(plan.tasks[0].key) / "manifest.yaml"
    data = read_data_set(read_manifest(manifest))
    assert len(data.logs) == 2
    assert data.logs[1].added_mass.mass == 0.05
    assert data.logs[0].time.size == 12_001


@pytest.mark.usefixtures("undisturbed")
def test_results_are_listed_shown_tabulated_exported_and_compared(butterfly, folder, tmp_path):
    one = folder / "one"
    code, out, _ = butterfly("results", "list", folder)
    assert (code, "encoder noise" in out) == (0, True)
    code, out, _ = butterfly("results", "show", one, "4")
    assert (code, "weak-form" in out) == (0, True)
    chosen = ("--columns", "number,status")
    for name in ("plant.encoder.noise", "noise"):
        code, out, _ = butterfly("results", "table", one, "--filter", f"{name}=1e-4", *chosen)
        assert (code, out.split().count("ok")) == (0, 3)
    exported = tmp_path / "e.csv"
    code, out, _ = butterfly(
        *("results", "table", one, "--out", exported, "--filter", "parameter=p1"),
        *("--columns", "number,value"),
    )
    assert code == 0
    lines = exported.read_text().splitlines()
    assert (lines[0], len(lines)) == ('"number","value"', 7)
    seed = ResultStore(one).sweep().runs[2].seed
    code, out, _ = butterfly("results", "table", one, "--filter", f"seed={seed}")
    assert (code, out.split().count("ok")) == (0, 1)
    code, out, _ = butterfly("compare", one / "0", one / "3")
    assert (code, "encoder noise" in out) == (0, True)
    code, out, _ = butterfly("results", "clean", one)
    assert (code, out.strip()) == (0, "0 removed.")


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (("table", "ONE", "--filter", "nois=1"), "an unknown column"),
        (("table", "ONE", "--table", "runz"), '"runs"'),
        (("table", "ONE", "--filter", "logs=x"), "a number"),
        (("show", "ONE", "9999"), "a number from 0 to 5"),
        (("table", "ONE", "--out", "x.xls"), ".csv or .parquet"),
        (("show", "NOWHERE", "0"), "a folder of results"),
    ],
)
@pytest.mark.usefixtures("undisturbed")
def test_a_slip_about_results_is_one_line(butterfly, folder, arguments, part):
    places = {"ONE": folder / "one", "NOWHERE": folder / "nowhere"}
    code, _, err = butterfly("results", *(places.get(a, a) for a in arguments))
    assert code == 2
    assert part in err
    assert err.count("\n") == 1


@pytest.mark.usefixtures("undisturbed")
def test_a_sweep_is_run_and_reported_from_the_command_line(butterfly, folder):
    small_plan(folder)
    code, out, err = butterfly("run", folder / "small.yaml", "--out", folder / "one", "--figures")
    assert code == 0, err
    assert "6 found done" in out
    page = (folder / "one/report.html").read_text(encoding="utf-8")
    assert "Against encoder noise" in page
    numbers = json.loads((folder / "one/report.json").read_text())
    assert numbers["ok"] == 6
    told = butterfly("run", folder / "small.yaml", "--out", folder / "one", "--json", "-")[1]
    assert json.loads(told) == numbers
    assert plan_sweep(Source(folder / "one" / EXPERIMENT)).tasks == small_plan(folder).tasks
    said = json.loads(butterfly("compare", folder / "one/0", folder / "one/1", "--json", "-")[1])
    assert said["schema"] == "butterfly.runs"
    for run in said["runs"]:
        (estimate,) = run["estimates"]
        assert estimate["parameters"]["p1"]["unit"] == "kg m²"
    assert (folder / "one/report-figures/axis-0.png").exists()
    code, _, _ = butterfly("run", folder / "small.yaml", "--out", folder / "one", "--only", "9")
    assert code == 2


def test_the_schema_is_written_for_editors(butterfly, tmp_path):
    code, out, _ = butterfly("schema")
    assert code == 0
    assert "sweep" in json.loads(out)["properties"]
    assert butterfly("schema", "manifest", "--out", tmp_path / "m.json")[0] == 0
    assert "logs" in json.loads((tmp_path / "m.json").read_text())["properties"]


@pytest.mark.slow
def test_an_orbit_can_be_swept(folder):
    control = {
        "target": {"amplitude": 0.9},
        "believed": {"p1": 0.003, "p2": 0.0012, "p3": 0.045, "p4": 9.0},
        "duration": 12.0,
        "starts": [0.9, 0.6, 1.1],
        "rounds": 2,
    }
    base = {key: value for key, value in SWEEP.items() if key not in {"signals", "estimators"}}
    path = Path(folder / "orbits.yaml")
    grid = {"control.target.amplitude": [0.8, 1.0]}
    base["plant"] = base["plant"] | {"simulator": "grey-box"}
    path.write_text(yaml.safe_dump(base | {"control": control, "sweep": {"grid": grid}}))
    summary = run_sweep(plan_sweep(Source(path)), folder / "orbits", LocalEngine(2))
    assert summary.unsuccessful == 0
    for row in ResultStore(folder / "orbits").table(RUNS).to_pylist():
        assert row["orbit_amplitude"] == pytest.approx(row["orbit_target"], abs=5e-3)
        assert row["orbit_error_recalibrated"] < row["orbit_error_generic"]
