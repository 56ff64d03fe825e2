"""For how long a simulation stays near a log of a joint that nothing brings back.

What a model lacks acts as a force, and where no gravity answers it, all that it moved the joint by
stays: the error of a free run grows with the time to the power 3/2, until it says more of that
force than of the parameters. Over stretches that are short enough it is no larger than the noise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from butterfly.identification.diagnostics.sensor_errors import encoder_step
from butterfly.identification.estimate import Estimate
from butterfly.identification.segments import simulation
from butterfly.logs.log import Log

HORIZONS = (math.inf, 10.0, 5.0, 2.0, 1.0, 0.5)
"""Longest stretches in s that are tried, one after the other."""

_MORE = 3.0  # times the noise, above which something else is left over


def lasting_horizon(logs: Sequence[Log], estimate: Estimate) -> float:
    """Return the longest stretch in s over which simulations leave little but noise; else 0.5 s.

    Parameters
    ----------
    logs
        Of a joint without gravity moment.
    estimate
        The parameters.
    """
    for horizon in HORIZONS[:-1]:
        if lasts(logs, estimate, horizon):
            return horizon
    return HORIZONS[-1]


def lasts(logs: Sequence[Log], estimate: Estimate, horizon: float) -> bool:
    """Whether simulations over stretches of a horizon in s leave little but noise."""
    return float(np.median([_excess(log, estimate, horizon) for log in logs])) <= _MORE


def _excess(log: Log, estimate: Estimate, horizon: float) -> float:
    """Errors over stretches, each from a fitted start, in units of the noise."""
    parameters, own = estimate.applied(log)
    stretches = simulation(log, parameters, horizon)
    errors = stretches.linearised((), parameters, own.get("zero", 0.0))[0]
    noise = max(
        float(np.std(np.diff(errors))) / math.sqrt(2), encoder_step(log.angle) / math.sqrt(12)
    )
    return float(np.sqrt(np.mean(errors**2))) / (noise or 1.0)
