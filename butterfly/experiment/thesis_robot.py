"""The shipped experiment with the thesis's synthetic robot."""

from __future__ import annotations

from butterfly.experiment.reading import read_experiment
from butterfly.resources import shipped
from butterfly.thesis.synthetic import Synthetic


def thesis_robot() -> Synthetic:
    """Return what Tables 1 and 2 and Figures 3 to 8 rest on."""
    experiment = read_experiment(shipped("experiments/thesis/synthetic.yaml"))
    return Synthetic(
        rig=experiment.plant.rig,
        added_masses=experiment.added_masses,
        sines=experiment.excitations,
        duration=experiment.duration,
    )
