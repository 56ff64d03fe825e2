"""Which runs an experiment file asks for, and what is wrong with one that cannot be read."""

import json
import math
from collections import Counter

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from butterfly.errors import InputError
from butterfly.experiment.schema import Experiment
from butterfly.experiment.source import Source, keep_experiment, read_experiment
from butterfly.experiment.sweep import plan_sweep
from butterfly.experiment.sweep_spec import Distribution, SweepSpec, apply
from butterfly.files import shipped, shipped_experiments
from butterfly.identification.estimators import HarmonicBalance, Loss, OutputError, WeakForm
from butterfly.plant.rig import Simulator
from butterfly.plant.rollout import simulate_runs
from butterfly.thesis.method import Thesis


def _write(path, **content):
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    return path


def _tasks(path):
    return plan_sweep(Source(path)).tasks


@pytest.fixture
def sweep(tmp_path):
    def write(**spec):
        return _write(tmp_path / "s.yaml", extends="quickstart", name="s", sweep=spec)

    return write


def test_grid_list_random_and_repetitions_are_combined(sweep):
    path = sweep(
        grid={"plant.encoder.noise": [0, 1e-4], "duration": [20.0, 30.0, 40.0]},
        list=[{"plant.hand.mass": 0.1, "seed": 7}, {"added_masses.1.mass": 0.06}],
        random={"count": 4, "fields": {"plant.friction.coulomb": {"log_uniform": [1e-5, 1e-3]}}},
        repetitions=2,
    )
    tasks = _tasks(path)
    assert len(tasks) == 2 * 3 * 2 * 4 * 2
    assert [task.number for task in tasks] == list(range(96))
    assert tasks[0].content["plant"]["encoder"]["noise"] == 0
    assert tasks[-1].content["added_masses"][1]["mass"] == 0.06
    assert tasks[0].content["seed"] == 7
    assert len({task.content["seed"] for task in tasks}) == 48 + 24 + 1  # 24 first repetitions: 7
    assert "sweep" not in tasks[0].content


def test_repetitions_of_a_swept_seed_are_all_different_and_the_first_has_the_seed(sweep):
    once = _tasks(sweep(grid={"seed": [5, 6]}))
    tasks = _tasks(sweep(grid={"seed": [5, 6]}, repetitions=3))
    assert [task.seed for task in once] == [task.seed for task in tasks[::3]] == [5, 6]
    assert len({task.key for task in tasks}) == len({task.seed for task in tasks}) == 6


def test_a_part_may_refine_what_an_earlier_part_sets_and_rows_are_alternatives(sweep):
    hand = {"mass": 0.1, "com_distance": 0.05, "inertia": 0.003}
    tasks = _tasks(sweep(grid={"plant.hand": [hand]}, list=[{"plant.hand.mass": 0.2}]))
    assert tasks[0].content["plant"]["hand"] == hand | {"mass": 0.2}
    rows = [{"plant.hand.mass": 0.3}, {"plant.hand": hand}]
    assert [task.content["plant"]["hand"]["mass"] for task in _tasks(sweep(list=rows))] == [
        0.3,
        0.1,
    ]


def test_a_latin_hypercube_visits_every_slice_of_every_field_once(sweep):
    fields = {
        "plant.hand.mass": {"uniform": [0.1, 0.2]},
        "plant.friction.coulomb": {"log_uniform": [1e-5, 1e-3]},
        "method": {"choice": ["linear", "harmonic-balance"]},
        "plant.hand.com_distance": {"normal": [0.05, 0.001]},
    }
    tasks = _tasks(sweep(latin_hypercube={"count": 10, "fields": fields}))
    mass = sorted(task.overrides["plant.hand.mass"] for task in tasks)
    assert all(0.1 + 0.01 * k <= value <= 0.11 + 0.01 * k for k, value in enumerate(mass))
    logs = sorted(math.log10(task.overrides["plant.friction.coulomb"]) for task in tasks)
    assert all(-5 + 0.2 * k <= value <= -4.8 + 0.2 * k for k, value in enumerate(logs))
    assert Counter(task.overrides["method"] for task in tasks) == {
        "linear": 5,
        "harmonic-balance": 5,
    }


def test_a_sweep_that_grows_keeps_the_runs_it_had(sweep):
    before = _tasks(sweep(grid={"plant.encoder.noise": [0, 1e-4]}, repetitions=2))
    after = _tasks(sweep(grid={"plant.encoder.noise": [1e-4, 0, 1e-3]}, repetitions=3))
    assert {task.key for task in before} < {task.key for task in after}


def test_the_address_depends_on_what_is_asked_and_on_nothing_else(tmp_path):
    base = {"extends": "quickstart", "name": "a"}
    (first,) = _tasks(_write(tmp_path / "a.yaml", **base))
    (same,) = _tasks(_write(tmp_path / "b.yaml", **(base | {"name": "b", "description": "x"})))
    (default,) = _tasks(_write(tmp_path / "c.yaml", **base, method="harmonic-balance"))
    (other,) = _tasks(_write(tmp_path / "d.yaml", **base, duration=59.0))
    assert first.key == same.key == default.key
    assert first.key != other.key


@given(st.dictionaries(st.text(min_size=1).filter(lambda s: "." not in s), st.integers()))
def test_overriding_changes_what_is_named_and_nothing_else(values):
    content = {"kept": {"deep": [1, {"x": 2}]}, "other": 3}
    changed = apply(content, {"kept.deep.1.x": 5} | {f"new.{k}": v for k, v in values.items()}, "")
    assert content == {"kept": {"deep": [1, {"x": 2}]}, "other": 3}
    assert changed["kept"] == {"deep": [1, {"x": 5}]}
    assert changed.get("new", {}) == values


def test_what_extends_is_changed_key_by_key_and_kinds_are_replaced(tmp_path):
    path = _write(
        tmp_path / "e.yaml",
        extends="quickstart",
        name="e",
        plant={"drive": {"torque": {"gain": 2.0}}, "friction": {"drag": 1e-4}},
    )
    experiment = read_experiment(path)
    assert experiment.plant.drive.chosen.gain == 2.0
    assert experiment.plant.friction.drag == 1e-4
    assert experiment.plant.friction.coulomb == 3e-4
    child = _write(tmp_path / "f.yaml", extends="e.yaml", name="f", seed=9)
    assert read_experiment(child).plant == experiment.plant


SIGNAL = {"file": {"path": "u.csv"}}


@pytest.mark.parametrize(
    "sweep",
    [
        None,
        {"grid": {"signals.0.file.path": ["u.csv"]}},
        {"list": [{"signals": [SIGNAL]}]},
        {"random": {"count": 1, "fields": {"signals.0.file": {"choice": [SIGNAL["file"]]}}}},
    ],
)
def test_what_is_extended_finds_its_files_beside_itself(tmp_path, sweep):
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub/u.csv").write_text("time,input\n0,0.1\n1,-0.1\n")
    (tmp_path / "u.csv").write_text("time,input\n0,0.2\n1,-0.2\n")
    base = {"extends": "quickstart", "name": "b", "excitations": [], "signals": [SIGNAL]}
    alone = _write(tmp_path / "sub/base.yaml", **base, **({"sweep": sweep} if sweep else {}))
    child = _write(tmp_path / "child.yaml", extends="sub/base.yaml", name="c")
    source = Source(child)
    (task,) = plan_sweep(source).tasks
    assert task.content["signals"] == _tasks(alone)[0].content["signals"]
    written = keep_experiment(source, tmp_path / "out")
    assert "sub/u.csv" in written
    assert _tasks(tmp_path / "out/experiment.yaml")[0].key == task.key
    own = _write(tmp_path / "own.yaml", extends="sub/base.yaml", name="o", signals=[SIGNAL])
    assert read_experiment(own).signals[0].table.values[0] == 0.2


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"extends": "s.yaml"}, "lead back here"),
        ({"extends": "../elsewhere.yaml"}, "below|beside"),
        ({"extends": "/etc/passwd"}, "below|beside"),
        ({"extends": 3}, "the path of an experiment file"),
        ({"extends": "nowhere.yaml"}, "no such file"),
        ({"plant": {"hand": {"mas": 1}}}, r"s\.yaml:6: plant.hand.mas: got an unknown key"),
        ({"sweep": {"grd": {}}}, r"s\.yaml:5: sweep.grd: got an unknown key; expected 'grid'"),
        ({"sweep": {"grid": {"plant.hand.mass": []}}}, "sweep.grid.plant.hand.mass"),
        ({"sweep": {"grid": {"plant.hand.mass": [-1.0]}}}, "plant.hand.mass: got -1.0"),
        ({"sweep": {"grid": {"plant.hnd.mass": [1.0]}}}, "plant.hnd: got an unknown key"),
        ({"sweep": {"grid": {"added_masses.7.mass": [1.0]}}}, "a number from 0 to 2"),
        ({"sweep": {"grid": {"seed.x": [1.0]}}}, "a path to a field"),
        ({"sweep": {"grid": {"sweep.repetitions": [1]}}}, "a field of the experiment"),
        ({"sweep": {"repetitions": 0}}, "sweep.repetitions: got 0"),
        (
            {"sweep": {"grid": {"duration": [20.0]}, "list": [{"seed": 1}, {"duration": 30.0}]}},
            r"s\.yaml:4: sweep\.duration: got duration set before; expected each field in one of",
        ),
        (
            {"sweep": {"grid": {"plant.hand.mass": [0.1]}, "list": [{"plant.hand": {}}]}},
            r"sweep\.plant\.hand: got plant\.hand\.mass set before",
        ),
        (
            {"sweep": {"random": {"count": 2, "fields": {"duration": {"uniform": [2, 1]}}}}},
            "lower first",
        ),
        (
            {"sweep": {"random": {"count": 2, "fields": {"duration": {"log_uniform": [0, 1]}}}}},
            "positive limits",
        ),
        ({"method": "linear", "estimators": [{"method": "linear"}]}, "either estimators"),
        ({"signals": [{"file": {"path": "../../x.csv"}}]}, "a path below"),
        ({"method": "linear", "terms": ["drag"]}, r"terms: got \['drag'\]; expected no option"),
        ({"terms": ["drg"]}, r"s\.yaml:4: terms: got \['drg'\]; expected 'drag'"),
        (
            {"estimators": [{"method": "linear", "terms": ["drag"]}]},
            r"s\.yaml:5: estimators\.0\.terms: got an option it has not; expected one of 'check'",
        ),
        (
            {"estimators": [{"method": "output-error", "per_masss": ["zero"]}]},
            r"per_masss: got an option it has not; expected 'per_mass'",
        ),
        (
            {"estimators": [{"method": "magic"}]},
            r"estimators\.0\.method: got magic; expected one of 'harmonic-balance'",
        ),
        ({"estimators": [{"method": "output-error", "terms": ["x"]}]}, "terms: got x"),
        ({"estimators": ["linear"]}, r"estimators\.0: got 'linear'"),
        ({"estimators": 2 * [{"method": "linear"}]}, "estimators that differ"),
    ],
)
def test_a_slip_is_one_error_with_file_and_field(tmp_path, content, message):
    base = {"extends": "quickstart", "name": "s", "seed": 1} | content
    with pytest.raises(InputError, match=message):
        _tasks(_write(tmp_path / "s.yaml", **base))


def test_estimators_have_the_options_of_their_method_and_a_shorthand_for_one(tmp_path):
    listed = [
        {"method": "output-error", "terms": ["drag"], "per_mass": ["zero"], "loss": "huber"},
        {"method": "thesis", "decimation": 5},
        {"terms": ["load"]},
    ]
    base = {"extends": "quickstart", "name": "e"}
    several = read_experiment(_write(tmp_path / "e.yaml", **base, estimators=listed))
    assert several.all_estimators == (
        OutputError(terms=("drag",), per_mass=("zero",), loss=Loss.HUBER),
        Thesis(decimation=5),
        HarmonicBalance(terms=("load",)),
    )
    short = read_experiment(_write(tmp_path / "f.yaml", **base, method="weak-form", terms=[]))
    assert short.all_estimators == (WeakForm(terms=()),)


def test_a_key_said_twice_is_refused(tmp_path):
    path = tmp_path / "s.yaml"
    path.write_text("extends: quickstart\nname: s\nseed: 1\nseed: 2\n")
    with pytest.raises(InputError, match=r"s\.yaml:4: seed: got the same key twice"):
        read_experiment(path)


def test_a_slip_in_the_file_that_is_extended_is_blamed_on_it(tmp_path):
    _write(tmp_path / "base.yaml", extends="quickstart", name="b", duration=-1.0)
    path = _write(tmp_path / "child.yaml", extends="base.yaml", name="c")
    with pytest.raises(InputError, match=r"base\.yaml:3: duration"):
        read_experiment(path)


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_quantiles_stay_within_their_limits(share):
    assert 2 <= Distribution(uniform=(2, 3)).quantile(share) <= 3
    assert 2 * (1 - 1e-12) <= Distribution(log_uniform=(2, 3)).quantile(share) <= 3 * (1 + 1e-12)
    assert Distribution(choice=["a", "b"]).quantile(share) in {"a", "b"}


def test_every_shipped_experiment_is_read_and_the_schema_covers_it():
    properties = Experiment.model_json_schema(by_alias=True)["properties"]
    for name in shipped_experiments():
        content = yaml.safe_load(shipped(name).read_text())
        if "logs" in content:
            continue
        assert plan_sweep(Source(shipped(name))).tasks
        assert set(content) <= set(properties)
    assert "list" in json.dumps(SweepSpec.model_json_schema())


def test_a_plant_may_be_lumped_and_simulated_by_either(tmp_path):
    lumped = {"p1": 0.003, "p2": 1e-3, "p3": 0.05, "p4": 10.0, "coulomb": 1e-4}
    base = {"name": "l", "duration": 12.0, "added_masses": [{"mass": 0.05, "arm": 0.1}]}
    base["excitations"] = [{"omega": 3.0, "amplitude": 1e-3}]
    logs = {}
    for simulator in Simulator:
        plant = {"lumped": lumped, "simulator": str(simulator)}
        experiment = read_experiment(_write(tmp_path / "l.yaml", **base, plant=plant))
        assert experiment.plant.robot.lumped.p3 == pytest.approx(0.05)
        seeds = np.random.SeedSequence(0).spawn(1)
        (logs[simulator],) = simulate_runs(
            experiment.plant.rig, experiment.runs(), experiment.duration, seeds
        )
    both = [log.angle for log in logs.values()]
    assert np.abs(both[0] - both[1]).max() < 2e-3
    assert logs[Simulator.GREY_BOX].source == "grey box"


@pytest.mark.parametrize(
    ("plant", "message"),
    [
        ({}, "hand and drive, or lumped"),
        ({"lumped": {"p1": 1, "p2": 1, "p3": 1, "p4": 1}, "friction": {}}, "either lumped, or"),
        ({"lumped": {"p1": 3e-3, "p2": 1, "p3": 0.05, "p4": 1, "delay": 0.1}}, "under path"),
        ({"lumped": {"p1": 0.0, "p2": 1, "p3": 1, "p4": 1}}, "p1: got 0"),
    ],
)
def test_a_plant_that_cannot_be_is_refused(tmp_path, plant, message):
    base = {"name": "l", "duration": 2.0, "added_masses": [{}], "plant": plant}
    base["excitations"] = [{"omega": 3.0, "amplitude": 1e-3}]
    with pytest.raises(InputError, match=message):
        read_experiment(_write(tmp_path / "l.yaml", **base))
