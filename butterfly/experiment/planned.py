"""The logs of an experiment that nobody has done: its inputs, from rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from butterfly.experiment.schema import Experiment
from butterfly.logs.log import Log
from butterfly.plant.excitations import initial_angle
from butterfly.plant.rig import Simulator
from butterfly.plant.rollout import simulate_runs
from butterfly.plant.sensors import Faults


def planned_logs(experiment: Experiment) -> list[Log]:
    """Return a log for each run: stamps, the input as it would be set, and the angle at the start.

    The robot of the experiment does not count: nothing is fed back, so that its inputs are what
    they are with any other.

    Parameters
    ----------
    experiment
        With excitations or signals.
    """
    plain = replace(
        experiment.plant.rig,
        robot=replace(experiment.plant.robot, clutch=None),
        simulator=Simulator.GREY_BOX,
        faults=Faults(),
    )
    runs = experiment.runs()
    starts = [initial_angle(excitation) for _, excitation in runs]
    logs = simulate_runs(plain, runs, experiment.duration, experiment.seeds())
    return [
        replace(log, angle=np.full(log.time.size, start), velocity=None, source=log.name)
        for log, start in zip(logs, starts, strict=True)
    ]
