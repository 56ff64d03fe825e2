"""What a run of a sweep costs in the grey box; a 'kernel' is the bare integration of its logs."""

from pathlib import Path

import numpy as np
import pytest

from butterfly.experiment.perform import execute
from butterfly.experiment.record import OK
from butterfly.experiment.schema import Experiment
from butterfly.experiment.simulate import simulate as simulated_logs
from butterfly.experiment.source import Source
from butterfly.experiment.sweep import plan_sweep
from butterfly.model.greybox import simulate
from tests.benchmarks.bars import SHORT, measured
from tests.benchmarks.cpu_time import least_seconds


def _task(folder, simulator):
    """The first run of large-sweep.yaml."""
    path = Path(folder) / f"{simulator}.yaml"
    path.write_text(f"extends: large-sweep\nname: {simulator}\nplant: {{simulator: {simulator}}}\n")
    plan = plan_sweep(Source(path))
    return plan.tasks[0], plan.tables


@pytest.fixture(scope="module")
def grey_box(tmp_path_factory):
    return _task(tmp_path_factory.mktemp("sweep"), "grey-box")


@pytest.fixture(scope="module")
def kernels(grey_box):
    """The integration of all logs of that run, each input at hand on its own grid."""
    task, _ = grey_box
    experiment = Experiment.model_validate(task.content)
    jobs = []
    for added, excitation in experiment.runs():
        stamps = experiment.plant.clock.step * np.arange(70_001)
        inputs = np.repeat(excitation.sample(stamps[:-1])[:, None], 3, axis=1)
        jobs.append((experiment.plant.robot.loaded(added), stamps, inputs, 0.0))

    def integrate():
        for job in jobs:
            simulate(*job)

    integrate()
    return integrate


def test_the_logs_of_a_grey_box_run_cost_little_more_than_their_integration(grey_box, kernels):
    task, _ = grey_box
    experiment = Experiment.model_validate(task.content)
    bare, logs = least_seconds(kernels, lambda: list(simulated_logs(experiment, threads=1)))
    measured("logs of a grey-box run of large-sweep.yaml", logs / bare)


def test_a_grey_box_run_of_a_sweep_costs_a_few_kernels(grey_box, kernels):
    execute(*grey_box)
    bare, whole = least_seconds(kernels, lambda: execute(*grey_box))
    measured("the whole run, identified and recorded", whole / bare)


def test_a_sweep_is_several_times_faster_in_the_grey_box_than_in_mujoco(grey_box, tmp_path):
    tasks = _task(tmp_path, "mujoco"), grey_box
    found = []
    slow, fast = least_seconds(
        *(lambda task=task: found.append(execute(*task)) for task in tasks),
        repeats=1 if SHORT else 3,
    )
    assert {each.record.status for each in found} == {OK}
    measured("the same run in MuJoCo", slow / fast)
