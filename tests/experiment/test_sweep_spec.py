"""Which runs an experiment file asks for."""

import math
from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from butterfly.experiment.source import Source, keep_experiment, read_experiment
from butterfly.experiment.sweep import plan_sweep
from butterfly.experiment.sweep_spec import Distribution, SweepSpec, apply
from tests.experiment.setting import planned, written


@pytest.fixture
def tasks(tmp_path):
    """List the runs of a sweep of the quick start."""

    def listed(**spec):
        path = written(tmp_path / "s.yaml", extends="quickstart", name="s", sweep=spec)
        return planned(path).tasks

    return listed


def test_grid_list_random_and_repetitions_are_combined(tasks):
    found = tasks(
        grid={"plant.encoder.noise": [0, 1e-4], "duration": [20.0, 30.0, 40.0]},
        list=[{"plant.hand.mass": 0.1, "seed": 7}, {"added_masses.1.mass": 0.06}],
        random={"count": 4, "fields": {"plant.friction.coulomb": {"log_uniform": [1e-5, 1e-3]}}},
        repetitions=2,
    )
    assert [task.number for task in found] == list(range(2 * 3 * 2 * 4 * 2))
    assert found[0].content["plant"]["encoder"]["noise"] == 0
    assert found[-1].content["added_masses"][1]["mass"] == 0.06
    assert found[0].content["seed"] == 7
    assert len({task.content["seed"] for task in found}) == 48 + 24 + 1  # 24 first repetitions: 7
    assert "sweep" not in found[0].content


def test_repetitions_of_a_swept_seed_are_all_different_and_the_first_has_the_seed(tasks):
    once = tasks(grid={"seed": [5, 6]})
    thrice = tasks(grid={"seed": [5, 6]}, repetitions=3)
    assert [task.seed for task in once] == [task.seed for task in thrice[::3]] == [5, 6]
    assert len({task.key for task in thrice}) == len({task.seed for task in thrice}) == 6


def test_derived_seeds_are_all_different_and_fit_into_a_column():
    seeds = [seed for _, _, seed in SweepSpec(repetitions=10_000).points(0)]
    assert len(set(seeds)) == 10_000
    assert 2**62 < max(seeds) < 2**63


def test_a_part_may_refine_what_an_earlier_part_sets_and_rows_are_alternatives(tasks):
    hand = {"mass": 0.1, "com_distance": 0.05, "inertia": 0.003}
    refined = tasks(grid={"plant.hand": [hand]}, list=[{"plant.hand.mass": 0.2}])
    assert refined[0].content["plant"]["hand"] == hand | {"mass": 0.2}
    rows = tasks(list=[{"plant.hand.mass": 0.3}, {"plant.hand": hand}])
    assert [task.content["plant"]["hand"]["mass"] for task in rows] == [0.3, 0.1]


def test_a_latin_hypercube_visits_every_slice_of_every_field_once(tasks):
    fields = {
        "plant.hand.mass": {"uniform": [0.1, 0.2]},
        "plant.friction.coulomb": {"log_uniform": [1e-5, 1e-3]},
        "method": {"choice": ["linear", "harmonic-balance"]},
        "plant.hand.com_distance": {"normal": [0.05, 0.001]},
    }
    found = [task.overrides for task in tasks(latin_hypercube={"count": 10, "fields": fields})]
    mass = sorted(each["plant.hand.mass"] for each in found)
    assert all(0.1 + 0.01 * k <= value <= 0.11 + 0.01 * k for k, value in enumerate(mass))
    logs = sorted(math.log10(each["plant.friction.coulomb"]) for each in found)
    assert all(-5 + 0.2 * k <= value <= -4.8 + 0.2 * k for k, value in enumerate(logs))
    assert Counter(each["method"] for each in found) == {"linear": 5, "harmonic-balance": 5}


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_quantiles_stay_within_their_limits(share):
    assert 2 <= Distribution(uniform=(2, 3)).quantile(share) <= 3
    assert 2 * (1 - 1e-12) <= Distribution(log_uniform=(2, 3)).quantile(share) <= 3 * (1 + 1e-12)
    assert Distribution(choice=["a", "b"]).quantile(share) in {"a", "b"}


def test_a_sweep_that_grows_keeps_the_runs_it_had(tasks):
    before = tasks(grid={"plant.encoder.noise": [0, 1e-4]}, repetitions=2)
    after = tasks(grid={"plant.encoder.noise": [1e-4, 0, 1e-3]}, repetitions=3)
    assert {task.key for task in before} < {task.key for task in after}


@given(st.dictionaries(st.text(min_size=1).filter(lambda s: "." not in s), st.integers()))
def test_overriding_changes_what_is_named_and_nothing_else(values):
    content = {"kept": {"deep": [1, {"x": 2}]}, "other": 3}
    changed = apply(content, {"kept.deep.1.x": 5} | {f"new.{k}": v for k, v in values.items()}, "")
    assert content == {"kept": {"deep": [1, {"x": 2}]}, "other": 3}
    assert changed["kept"] == {"deep": [1, {"x": 5}]}
    assert changed.get("new", {}) == values


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
    alone = written(tmp_path / "sub/base.yaml", **base, **({"sweep": sweep} if sweep else {}))
    child = {"extends": "sub/base.yaml", "name": "c"}
    source = Source(written(tmp_path / "child.yaml", **child))
    (task,) = plan_sweep(source).tasks
    assert task.content["signals"] == planned(alone).tasks[0].content["signals"]
    assert "sub/u.csv" in keep_experiment(source, tmp_path / "out")
    assert planned(tmp_path / "out/experiment.yaml").tasks[0].key == task.key
    own = written(tmp_path / "own.yaml", **child, signals=[SIGNAL])
    assert read_experiment(own).signals[0].table.values[0] == 0.2
