"""Drive a simulated joint with the recorded input of a log."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from butterfly.errors import InputError
from butterfly.logs.log import Log
from butterfly.model.parameters import compressed
from butterfly.plant.motor import Joint
from butterfly.signals import hold

_LONGEST_STEP = 5e-4  # s


def replay_input(
    joint: Joint, log: Log, delay: float = 0.0, compression: float = 0.0
) -> NDArray[np.float64]:
    """Return the (n,) true angles in rad of a joint at a log's stamps, driven with its input.

    The input is held at its mean over each step, its hold and a delay accounted for. Steps are
    short: MuJoCo's Coulomb friction, which creeps at rest, is the sharper the shorter they are.

    Parameters
    ----------
    joint
        At rest where it is to start.
    log
        With increasing stamps.
    delay
        From recorded input to joint, in s.
    compression
        Of the drive, see `butterfly.model.parameters.LumpedParameters`.

    Raises
    ------
    InputError
        If the joint diverges.
    """
    joint.reset()
    counts = np.ceil(np.diff(log.time) / _LONGEST_STEP * (1 - 1e-9)).astype(np.intp)
    numbers = np.concatenate([[0], np.cumsum(counts)])
    instants = np.interp(np.arange(numbers[-1] + 1), numbers, log.time)
    inputs = compressed(log.input, compression)
    means = hold.mean(log.time, inputs, instants - delay, log.intersample)
    reached = [joint.angle]
    for mean, step in zip(means.tolist(), np.diff(instants).tolist(), strict=True):
        joint.advance(mean, step)
        reached.append(joint.angle)
    angles = np.array(reached)[numbers]
    if not np.isfinite(angles).all():
        raise InputError(log.source, "angle", "a joint that diverged", "another model or input")
    return np.asarray(angles)
