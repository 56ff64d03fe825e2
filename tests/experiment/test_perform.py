"""A single run is a run of a sweep, and nothing that is asked for is ignored."""

from dataclasses import replace

import numpy as np

from butterfly.errors import IdentifiabilityError, InputError
from butterfly.experiment import run as performing
from butterfly.experiment.record import OK, REFUSED, Task
from butterfly.experiment.run import execute, perform
from butterfly.experiment.schema import Experiment
from butterfly.experiment.source import read_experiment
from tests.experiment import setting
from tests.experiment.setting import ESTIMATORS


def test_a_run_gives_the_same_in_a_worker_and_here(folder):
    task = setting.small_plan(folder).tasks[3]
    here = perform(Experiment.model_validate(task.content)).record
    there = execute(task, {}).record
    place = {"key": "", "overrides": {}, "repetition": 0, "seconds": {}}
    assert replace(there, **place).to_json() == replace(here, **place).to_json()
    assert there.key == task.key


def _performed(**changes):
    return perform(Experiment.model_validate(setting.SINGLE | changes))


def test_a_run_in_which_every_estimator_refuses_its_masses_is_not_simulated():
    result = _performed(added_masses=setting.SINGLE["added_masses"][:1], estimators=ESTIMATORS)
    assert result.record.status == REFUSED
    assert isinstance(result.error, IdentifiabilityError)
    assert len(result.record.estimates) == 2
    assert result.record.logs == len(result.logs) == 0


def test_a_run_in_which_one_of_two_estimators_refused_has_a_result():
    result = _performed(estimators=[{"method": "harmonic-balance"}, ESTIMATORS[0]])
    assert result.record.status == OK
    assert list(result.identifications) == ["weak-form"]
    assert "harmonic-balance: " in result.record.reason


def test_intervals_mean_the_same_whether_or_not_logs_are_held_out():
    content = {"added_masses": setting.THREE_MASSES, "duration": 6.0}
    content["estimators"] = [{"method": "output-error", "terms": []}]
    (first,) = _performed(**content).record.estimates
    (second,) = _performed(**content, validation={"split": "mass"}).record.estimates
    plain = first.parameters
    assert plain == second.parameters
    assert all(row.lower <= row.least_left_out for row in plain)
    assert all(row.largest_left_out <= row.upper for row in plain)


def test_the_orbit_draws_from_a_stream_of_its_own(monkeypatch):
    drawn = []

    def stop(*_, rng, **__):
        drawn.append(rng.random(8).tolist())
        raise InputError("orbit", "x", "y", "z")

    monkeypatch.setattr(performing, "study_orbit", stop)
    control = {"target": {"amplitude": 0.9}, "starts": [0.9]}
    control["believed"] = {"p1": 0.003, "p2": 0.0012, "p3": 0.045, "p4": 9.0}
    experiment = Experiment.model_validate(setting.SINGLE | {"control": control, "duration": 2.0})
    perform(experiment)
    assert drawn == [np.random.default_rng(experiment.orbit_seed).random(8).tolist()]


def test_logs_held_out_by_name_are_foretold_and_recorded(quick):
    experiment = read_experiment(quick).model_copy(update={"holdout": ("run000*",)})
    result = perform(experiment)
    (record,) = result.record.estimates
    assert record.holdout.median > 90
    (identification,) = result.identifications.values()
    assert len(identification.data.logs) == len(result.logs) - 1
    assert list(identification.held_out) == [result.logs[0].name]


def test_a_worker_replies_with_the_record_and_the_files_of_its_task_alone():
    content = setting.SINGLE | {"keep_signals": True}
    task = Task(
        number=4, key="ab" * 12, overrides={"seed": 3}, repetition=2, seed=3, content=content
    )
    here = perform(Experiment.model_validate(content), task=task)
    assert here.logs
    assert here.sent.files.keys() == here.files.keys() != set()
    assert (here.sent.logs, here.sent.identifications) == ((), {})
    record = here.sent.record
    assert (record.key, record.overrides, record.repetition) == (task.key, {"seed": 3}, 2)
