"""Run an experiment's ``control:`` on the simulated robot, and keep its logs."""

from __future__ import annotations

from functools import partial

import numpy as np

from butterfly.errors import InputError
from butterfly.experiment.control import ControlSpec
from butterfly.experiment.schema import Experiment
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.identify import judged
from butterfly.orbit.study import OrbitStudy, study_orbit
from butterfly.progress import Track, untracked


def hold_orbit(
    experiment: Experiment,
    data: DataSet | None,
    found: Estimate | None = None,
    *,
    track: Track = untracked,
) -> OrbitStudy:
    """Hold the orbit and re-calibrate as ``control`` says.

    Parameters
    ----------
    experiment
        With ``control``.
    data
        The small swings that tell the parameters to begin with, if the experiment does not.
    found
        What its first estimator makes of them, if that is known already.
    track
        Shows progress.

    Raises
    ------
    InputError
        If the experiment has no ``control``, or its orbit does not exist.
    IdentifiabilityError
        If the logs cannot tell the parameters apart.
    """
    control = experiment.control
    if control is None:
        raise InputError(experiment.name, "control", "nothing", "an orbit to hold (control: ...)")
    believed, zero = control.believed, 0.0
    small_swings = None
    if believed is None:
        if data is None:
            raise InputError(experiment.name, "control.believed", "nothing", "parameters, or logs")
        first = experiment.all_estimators[0]
        small_swings = found or judged(data, first.unchecked())
        believed = small_swings.parameters
        zero = _zero(control, data)
    rng = np.random.default_rng(experiment.orbit_seed)
    return study_orbit(
        partial(experiment.plant.rig.run, rng=rng),
        believed,
        zero,
        control,
        control.recalibration,
        amplitudes=control.cross_check,
        small_swings=small_swings,
        rng=rng,
        name=experiment.name,
        description=experiment.description,
        track=track,
    )


def _zero(control: ControlSpec, data: DataSet) -> float:
    """Return the encoder reading in rad of the hand at rest, with its first mass if known."""
    known = data.equilibria
    return known.get(control.added_masses[0], float(np.mean(list(known.values()))))
