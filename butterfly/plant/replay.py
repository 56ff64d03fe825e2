"""Drive a simulated joint with the recorded input of a log."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from butterfly.errors import InputError
from butterfly.model.parameters import compressed
from butterfly.signals import hold

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from butterfly.logs.log import Log
    from butterfly.plant.motor import Joint


def replay_input(
    joint: Joint, log: Log, delay: float = 0.0, compression: float = 0.0
) -> NDArray[np.float64]:
    """Return the (n,) true angles in rad of a joint at a log's stamps, driven with its input.

    Between two stamps the input is held at its mean there, its hold and a delay accounted for.

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
    steps = np.diff(log.time)
    inputs = compressed(log.input, compression)
    means = hold.mean(log.time, inputs, log.time - delay, log.intersample)
    angles = np.empty(log.time.size)
    angles[0] = joint.angle
    for k, (mean, step) in enumerate(zip(means.tolist(), steps.tolist(), strict=True), start=1):
        joint.advance(mean, step)
        angles[k] = joint.angle
    if not np.isfinite(angles).all():
        raise InputError(log.source, "angle", "a joint that diverged", "another model or input")
    return angles
