"""Addresses cover all that a result depends on, and nothing else."""

import pickle

import numpy as np
import pytest

from butterfly.experiment import source as reading
from butterfly.experiment.record import OK
from butterfly.experiment.schema import Experiment
from butterfly.experiment.store import ResultStore
from butterfly.experiment.sweep import (
    address,
    computing_sources,
    fingerprint,
    hash_of,
    run_sweep,
    versions,
)
from tests.experiment.setting import SINGLE, SWEEP, HereEngine, planned, written

ONE = "identification/estimators/output_error.py"


@pytest.fixture
def key(tmp_path):
    """Return the address of the one run of an experiment."""
    return lambda **changes: planned(written(tmp_path / "p.yaml", **SINGLE | changes)).tasks[0].key


def test_another_default_gives_another_address():
    class Later(Experiment):
        keep_signals: bool = True

    now, later = Experiment.model_validate(SINGLE), Later.model_validate(SINGLE)
    assert address(now, SINGLE) != address(later, SINGLE)
    assert address(now, SINGLE) == address(Experiment.model_validate(SINGLE), SINGLE)


def test_the_address_depends_on_what_is_asked_and_on_nothing_else(key):
    assert key() == key(name="b", description="x") == key(keep_signals=False)
    assert key() != key(duration=59.0)


def test_other_code_and_other_versions_give_other_addresses(key, monkeypatch):
    known = versions()
    assert known.keys() == {"butterfly", "mujoco", "numba", "numpy", "python", "scipy"}
    found = {key()}
    for library in known:
        other = known | {library: "0.0.1"}
        monkeypatch.setattr("butterfly.experiment.sweep.versions", lambda other=other: other)
        found.add(key())
    monkeypatch.undo()
    monkeypatch.setattr("butterfly.experiment.sweep.fingerprint", lambda: "other")
    assert len(found | {key()}) == len(known) + 2


WEAK, OUTPUT = {"method": "weak-form"}, {"method": "output-error", "terms": []}
ESTIMATORS = [WEAK, WEAK | {"terms": ["drag"]}, WEAK | {"half_width": 0.2}]
ESTIMATORS += [{"method": "harmonic-balance", "terms": []}, OUTPUT]
ESTIMATORS += [OUTPUT | {"loss": "huber"}, OUTPUT | {"window": 15.0}]


def test_another_estimator_or_option_gives_another_address_and_its_workers_do_not(key, tmp_path):
    several = [[each] for each in ESTIMATORS] + [ESTIMATORS[:2]]
    assert len({key(estimators=each) for each in several}) == len(several)
    with_workers = ESTIMATORS[4] | {"workers": 2}
    assert key(estimators=[ESTIMATORS[4]]) == key(estimators=[with_workers])
    base = {name: value for name, value in SINGLE.items() if name != "estimators"}
    short = written(tmp_path / "short.yaml", **base | {"method": "weak-form", "terms": []})
    assert planned(short).tasks[0].key == key()


def test_the_fingerprint_is_of_what_a_run_computes_with_and_of_the_robots(tmp_path):
    sources = computing_sources()
    for name in (ONE, "model/greybox.py", "plant/mjcf.py", "hand.xml"):
        assert any(known.endswith(name) for known in sources)
    assert not any(name.startswith(("report", "comparison")) for name in sources)
    assert hash_of(sources) == fingerprint()
    edited = tmp_path / "edited.py"
    edited.write_bytes(sources[ONE].read_bytes() + b"#")
    assert hash_of(sources | {ONE: edited}) != fingerprint()


@pytest.fixture
def table(tmp_path):
    """A signal of 2,000 rows."""
    time = np.arange(2_000) * 1e-3
    rows = "\n".join(f"{t:.3f},{1e-3 * np.sin(3.3 * t):.9f}" for t in time)
    (tmp_path / "u.csv").write_text(f"time,input\n{rows}\n")
    return {"file": {"path": "u.csv"}}


def test_a_long_signal_is_read_once_and_travels_once(tmp_path, table, monkeypatch):
    read = []
    original = reading.read_table
    monkeypatch.setattr(reading, "read_table", lambda *args: read.append(args) or original(*args))
    sweep = {"grid": {"plant.encoder.noise": [1e-5 * k for k in range(9)]}}
    plan = planned(written(tmp_path / "p.yaml", **SWEEP | {"signals": [table], "sweep": sweep}))
    assert (len(read), len(plan.tables)) == (1, 1)
    assert len(pickle.dumps(plan.tasks[0])) < 2_000
    assert len({task.key for task in plan.tasks}) == 9


def test_the_address_depends_on_what_a_file_of_signals_says_not_on_its_name(key, tmp_path, table):
    first = key(signals=[table])
    text = (tmp_path / "u.csv").read_text()
    (tmp_path / "v.csv").write_text(text)
    assert key(signals=[{"file": {"path": "v.csv"}}]) == first
    (tmp_path / "u.csv").write_text(text.replace("0.000003300", "0.000003301", 1) + "20,0\n")
    assert key(signals=[table]) != first


def test_runs_may_be_driven_by_different_files(tmp_path, table):
    (tmp_path / "w.csv").write_text("time,input\n0,0.001\n5,-0.001\n")
    sweep = {"grid": {"signals.0.file.path": ["u.csv", "w.csv"]}}
    changes = {"signals": [table], "sweep": sweep, "keep_signals": True}
    plan = planned(written(tmp_path / "p.yaml", **SWEEP | changes))
    assert len(plan.tables) == 2
    run_sweep(plan, tmp_path / "out", HereEngine(), only="0")
    record = ResultStore(tmp_path / "out").read(plan.tasks[0].key)
    assert (record.status, record.logs) == (OK, 2)
