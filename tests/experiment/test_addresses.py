"""Addresses cover all that a result depends on; seeds and streams are all different."""

import pickle

import numpy as np
import pytest
import yaml

from butterfly.errors import InputError
from butterfly.experiment import source as reading
from butterfly.experiment.record import OK
from butterfly.experiment.schema import Experiment
from butterfly.experiment.source import Source
from butterfly.experiment.store import ResultStore
from butterfly.experiment.sweep import (
    address,
    computing_sources,
    fingerprint,
    hash_of,
    plan_sweep,
    run_sweep,
)
from butterfly.experiment.sweep_spec import SweepSpec
from butterfly.result import versions
from tests.experiment.setting import SWEEP, HereEngine

ONE = "identification/estimators/output_error.py"
SINGLE = {key: value for key, value in SWEEP.items() if key != "sweep"}


def _plan(folder, content):
    path = folder / "p.yaml"
    path.write_text(yaml.safe_dump(content))
    return plan_sweep(Source(path))


def test_another_default_gives_another_address():
    class Later(Experiment):
        keep_signals: bool = True

    now, later = Experiment.model_validate(SINGLE), Later.model_validate(SINGLE)
    assert address(now, SINGLE) != address(later, SINGLE)
    assert address(now, SINGLE) == address(Experiment.model_validate(SINGLE), SINGLE)


def test_other_code_gives_another_address(tmp_path, monkeypatch):
    (before,) = _plan(tmp_path, SINGLE).tasks
    monkeypatch.setattr("butterfly.experiment.sweep.fingerprint", lambda: "other")
    (after,) = _plan(tmp_path, SINGLE).tasks
    assert before.key != after.key


@pytest.mark.parametrize("library", ["butterfly", "mujoco", "numba", "numpy", "python", "scipy"])
def test_another_version_of_what_computes_gives_another_address(tmp_path, monkeypatch, library):
    (before,) = _plan(tmp_path, SINGLE).tasks
    other = versions() | {library: "0.0.1"}
    assert other.keys() == versions().keys()
    monkeypatch.setattr("butterfly.experiment.sweep.versions", lambda: other)
    (after,) = _plan(tmp_path, SINGLE).tasks
    assert before.key != after.key


ESTIMATORS = [
    {"method": "weak-form", "terms": []},
    {"method": "weak-form", "terms": ["drag"]},
    {"method": "weak-form"},
    {"method": "harmonic-balance", "terms": []},
    {"method": "output-error", "terms": []},
    {"method": "output-error", "terms": [], "loss": "huber"},
    {"method": "output-error", "terms": [], "check": False},
]


def test_another_estimator_or_option_gives_another_address_and_its_workers_do_not(tmp_path):
    def key(*estimators):
        return _plan(tmp_path, SINGLE | {"estimators": list(estimators)}).tasks[0].key

    assert len({key(each) for each in ESTIMATORS} | {key(*ESTIMATORS[:2])}) == len(ESTIMATORS) + 1
    assert key(ESTIMATORS[4]) == key(ESTIMATORS[4] | {"workers": 2})


def test_the_fingerprint_is_of_what_a_run_computes_with_and_of_the_robots(tmp_path):
    sources = computing_sources()
    for name in (
        ONE,
        "model/greybox.py",
        "plant/mjcf.py",
        "hand.xml",
    ):
        assert any(known.endswith(name) for known in sources)
    assert not any(name.startswith(("report", "comparison")) for name in sources)
    assert hash_of(sources) == fingerprint()
    edited = tmp_path / "edited.py"
    edited.write_bytes(sources[ONE].read_bytes() + b"#")
    assert hash_of(sources | {ONE: edited}) != fingerprint()


def test_a_shorthand_and_a_list_of_one_estimator_have_the_same_address(tmp_path):
    base = {key: value for key, value in SINGLE.items() if key != "estimators"}
    (one,) = _plan(tmp_path, base | {"method": "weak-form", "terms": []}).tasks
    (other,) = _plan(tmp_path, SINGLE).tasks
    assert one.key == other.key


@pytest.fixture
def table(tmp_path):
    """A signal of 20,000 rows, and the number of times that it was read."""
    time = np.arange(20_000) * 1e-3
    rows = "\n".join(f"{t:.3f},{1e-3 * np.sin(3.3 * t):.9f}" for t in time)
    (tmp_path / "u.csv").write_text(f"time,input\n{rows}\n")
    return {"file": {"path": "u.csv"}}


def test_a_long_signal_is_read_once_and_travels_once(tmp_path, table, monkeypatch):
    read = []
    original = reading.read_table
    monkeypatch.setattr(reading, "read_table", lambda *args: read.append(args) or original(*args))
    sweep = {"grid": {"plant.encoder.noise": [1e-5 * k for k in range(40)]}}
    plan = _plan(tmp_path, SWEEP | {"signals": [table], "sweep": sweep})
    assert len(read) == 1
    assert len(plan.tables) == 1
    assert len(pickle.dumps(plan.tasks[0])) < 2_000
    assert len({task.key for task in plan.tasks}) == 40


def test_the_address_depends_on_what_a_file_of_signals_says_not_on_its_name(tmp_path, table):
    content = SINGLE | {"signals": [table]}
    (first,) = _plan(tmp_path, content).tasks
    text = (tmp_path / "u.csv").read_text()
    (tmp_path / "v.csv").write_text(text)
    (same,) = _plan(tmp_path, content | {"signals": [{"file": {"path": "v.csv"}}]}).tasks
    (tmp_path / "u.csv").write_text(text.replace("0.000500000", "0.000500001", 1) + "20,0\n")
    (other,) = _plan(tmp_path, content).tasks
    assert first.key == same.key != other.key


def test_runs_may_be_driven_by_different_files(tmp_path, table):
    short = "time,input\n0,0.001\n5,-0.001\n"
    (tmp_path / "w.csv").write_text(short)
    sweep = {"grid": {"signals.0.file.path": ["u.csv", "w.csv"]}}
    changes = {"signals": [table], "sweep": sweep, "plant": SWEEP["plant"]}
    plan = _plan(tmp_path, SWEEP | changes | {"keep_signals": True})
    assert len(plan.tables) == 2
    run_sweep(plan, tmp_path / "out", HereEngine())
    record = ResultStore(tmp_path / "out").read(plan.tasks[0].key)
    assert (record.status, record.logs) == (OK, 2)


def test_instants_out_of_order_are_blamed_on_their_file(tmp_path):
    (tmp_path / "u.csv").write_text("time,input\n0,1\n2,1\n1,1\n")
    with pytest.raises(InputError, match=r"u\.csv: time: got instants out of order"):
        _plan(tmp_path, SINGLE | {"signals": [{"file": {"path": "u.csv"}}]})


def test_derived_seeds_are_all_different_and_fit_into_a_column():
    seeds = [seed for _, _, seed in SweepSpec(repetitions=200_000).points(0)]
    assert len(set(seeds)) == 200_000
    assert max(seeds) < 2**63
    assert max(seeds) > 2**62


def test_a_seed_that_no_column_holds_is_refused(tmp_path):
    with pytest.raises(InputError, match="seed"):
        _plan(tmp_path, SINGLE | {"seed": 2**63})


def test_the_orbit_and_the_runs_draw_different_numbers_and_the_runs_those_they_always_drew():
    masses = [{"mass": 0.01 * k, "arm": 0.1} for k in range(30)]
    experiment = Experiment.model_validate(SINGLE | {"seed": 7, "added_masses": masses})
    seeds = [*experiment.seeds(), experiment.orbit_seed]
    drawn = [tuple(seed.generate_state(4)) for seed in seeds]
    always = [tuple(s.generate_state(4)) for s in np.random.SeedSequence(7).spawn(30)]
    assert drawn[:30] == always
    assert len(set(drawn)) == 31
