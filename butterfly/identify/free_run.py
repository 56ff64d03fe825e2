"""Does the model move like the robot? Free-run simulation of whole logs, and its FIT."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from butterfly.identify.trajectory import Trajectory

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from butterfly.identify.estimate import ParameterEstimate
    from butterfly.logs.log import Log
    from butterfly.model.parameters import AddedMass, LumpedParameters


@dataclass(frozen=True, kw_only=True, eq=False)
class FreeRun:
    """A log and its simulation from the first sample on with the recorded input.

    Parameters
    ----------
    log
        The log.
    simulated
        (n,) simulated angle in rad at the log's stamps, from the encoder's zero.
    """

    log: Log
    simulated: NDArray[np.float64]

    @property
    def fit(self) -> float:
        """FIT = 100 (1 - |q - qhat| / |q - mean q|) in per cent, over the whole log."""
        angle = self.log.angle
        return float(
            100
            * (1 - np.linalg.norm(angle - self.simulated) / np.linalg.norm(angle - angle.mean()))
        )


@dataclass(frozen=True)
class FitSummary:
    """Median, mean and worst FIT over a set of logs, in per cent."""

    median: float
    mean: float
    worst: float

    @classmethod
    def of(cls, fits: NDArray[np.float64]) -> FitSummary:
        """Summarise the (n,) FIT values of n logs."""
        return cls(float(np.median(fits)), float(fits.mean()), float(fits.min()))


def free_run(log: Log, parameters: LumpedParameters, zero: float, velocity: float = 0.0) -> FreeRun:
    """Simulate a log from its first sample with the recorded input.

    Parameters
    ----------
    log
        With increasing stamps.
    parameters
        Of the bare hand; the log's added mass is put on here (78).
    zero
        Reading of the encoder in rad where the model's angle is 0.
    velocity
        At the first sample, in rad/s.
    """
    simulated = Trajectory(log, parameters).at_stamps(parameters, zero, velocity)
    return FreeRun(log=log, simulated=simulated)


def free_run_of(estimate: ParameterEstimate, log: Log, zeros: Mapping[AddedMass, float]) -> FreeRun:
    """Simulate a log with an estimate (see `free_run`).

    Parameters
    ----------
    estimate
        The parameters, and whatever else it found for this log.
    log
        With increasing stamps.
    zeros
        The encoder's reading in rad of the hand at rest, per added mass, where it found none.
    """
    parameters, own = estimate.applied(log)
    zero = own["zero"] if "zero" in own else zeros[log.added_mass]
    return free_run(log, parameters, zero, own.get("velocity", 0.0))
