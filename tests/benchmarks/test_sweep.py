"""Logs of experiments in the grey box; a 'kernel' is their bare integration."""

import numpy as np
import pytest

from butterfly.experiment.record import OK
from butterfly.experiment.run import data_set_of, execute
from butterfly.experiment.run import simulate as simulated_logs
from butterfly.experiment.schema import Experiment
from butterfly.experiment.source import Source
from butterfly.experiment.sweep import plan_sweep
from butterfly.identification.estimators import HarmonicBalance, WeakForm
from butterfly.identification.identify import identify
from butterfly.model.greybox import simulate
from tests.benchmarks.bars import SHORT, measured
from tests.benchmarks.cpu_time import compare, least_seconds
from tests.benchmarks.page import COSTS

GREY_BOX, MUJOCO = "plant: {simulator: grey-box}", "plant: {simulator: mujoco}"
SHORT_LOGS = "plant: {simulator: grey-box, clock: {jitter: 0.0}}\nduration: 10.0"


def _task(folder, shipped, changes):
    """The first run of an experiment that is shipped, as what `execute` is given."""
    path = folder / "changed.yaml"
    path.write_text(f"extends: {shipped}\nname: changed\n{changes}\n", encoding="utf-8")
    plan = plan_sweep(Source(path))
    return plan.tasks[0], plan.tables


def _kernels(experiment):
    """Return what integrates an experiment's logs, each input at hand on its own grid."""
    step = experiment.plant.clock.step
    stamps = step * np.arange(round(experiment.duration / step) + 1)
    jobs = []
    for added, excitation in experiment.runs():
        inputs = np.repeat(excitation.sample(stamps[:-1])[:, None], 3, axis=1)
        jobs.append((experiment.plant.robot.loaded(added), stamps, inputs, 0.0))
    return lambda: [simulate(*job) for job in jobs]


@pytest.fixture(scope="module")
def grey_box(tmp_path_factory):
    return _task(tmp_path_factory.mktemp("grey"), "large-sweep", GREY_BOX)


def test_a_grey_box_run_of_a_sweep_costs_a_few_kernels(grey_box):
    """Of the weak form's integrations one is its own: the motion that frees it of noise's bias."""
    task, _ = grey_box
    experiment = Experiment.model_validate(task.content)
    logs = list(simulated_logs(experiment))
    zeros = dict.fromkeys((log.added_mass for log in logs), 0.0)
    wholes = {
        "logs of a grey-box run of large-sweep.yaml": lambda: list(
            simulated_logs(experiment, threads=1)
        ),
        "the whole run, identified and recorded": lambda: execute(*grey_box),
        "weak form of two logs of 70 s": lambda: WeakForm(terms=()).of_logs(logs, zeros),
    }
    for each in wholes.values():  # compiles
        each()
    compare(_kernels(experiment), wholes)


def test_a_sweep_in_mujoco_beside_the_grey_box(grey_box, tmp_path):
    tasks = _task(tmp_path, "large-sweep", MUJOCO), grey_box
    found = []
    slow, fast = least_seconds(
        *(lambda task=task: found.append(execute(*task)) for task in tasks),
        repeats=1 if SHORT else 3,
    )
    assert {each.record.status for each in found} == {OK}
    COSTS.append(("a run of `large-sweep` in MuJoCo", slow, None))
    COSTS.append(("the same in the grey box", fast, None))
    measured({"the same run in MuJoCo": slow / fast})


def test_a_short_log_s_sample_costs_at_most_two_microseconds(tmp_path):
    """Some 25 steps of the kernel: what every log costs by itself weighs most there."""
    task, _ = _task(tmp_path, "quickstart", SHORT_LOGS)
    experiment = Experiment.model_validate(task.content)
    logs = list(simulated_logs(experiment, threads=1))
    method = HarmonicBalance()  # for which the bar was set: it simulates little besides
    identify(data_set_of(experiment, logs), method)
    whole = {"identify 24 logs of 10 s": lambda: identify(data_set_of(experiment, logs), method)}
    compare(_kernels(experiment), whole)
