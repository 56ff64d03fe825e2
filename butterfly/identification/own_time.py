"""A joint's own time, over which it is simulated where nothing holds it and no whole run follows.

A joint that nothing holds, such as a cart, an arm without gravity in somebody's loop, or a hand
about the upright, integrates twice whatever its simulation lacks: after a minute little is left to
see of its inertia. Its own time is the period of its motion, or the time in which its speed
settles, or half a period of small swings, in which an error about the upright grows e^pi-fold: the
shortest of these.
"""

from __future__ import annotations

import math

import numpy as np

from butterfly.logs.log import Log
from butterfly.model.parameters import LumpedParameters
from butterfly.signals.spectrum import dominant_period

_UPRIGHT = 0.9 * math.pi  # rad from the rest angle


def turns_over(log: Log, zero: float) -> bool:
    """Whether a hand passes near the upright, from where gravity does not bring it back.

    ``zero``: reading of the encoder in rad where the hand hangs.
    """
    angle = log.angle - zero
    turned = 2 * math.pi * round(float(np.median(angle)) / (2 * math.pi))
    return bool(np.max(np.abs(angle - turned)) > _UPRIGHT)


def falls(log: Log, joint: LumpedParameters, zero: float) -> bool:
    """Whether gravity drives the errors of a loaded joint apart, as it does about the upright."""
    return not log.closed and joint.p3 > 0 and turns_over(log, zero)


def is_held(log: Log, joint: LumpedParameters, zero: float) -> bool:
    """Whether a servo's loop, or gravity within the log, brings a loaded joint back."""
    if log.closed:
        return True
    if not (joint.p3 > 0 and joint.p1 > 0) or falls(log, joint, zero):
        return False
    back = 2 * math.pi * max(math.sqrt(joint.p1 / joint.p3), joint.p2 / joint.p3)
    return back < float(log.time[-1] - log.time[0])


def own_time(log: Log, joint: LumpedParameters) -> float:
    """Return the own time in s of a loaded joint in a log."""
    times = [dominant_period(log.time, log.angle)]
    if joint.p2 > 0:
        times.append(2 * math.pi * joint.p1 / joint.p2)
    if joint.p3 > 0:
        times.append(math.pi * math.sqrt(max(joint.p1, 0.0) / joint.p3))
    return float(f"{min(each for each in times if each > 0):.2g}")  # which hardly depends on values
