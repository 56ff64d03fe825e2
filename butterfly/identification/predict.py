"""Does the model move like the robot? Free-run simulation of whole logs, and its FIT."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from butterfly.identification.data import DataSet
from butterfly.identification.divergence import horizon_of
from butterfly.identification.estimate import Estimate
from butterfly.identification.free_run import Trajectory, grid_step
from butterfly.identification.segments import Segments, simulation
from butterfly.logs.log import Log
from butterfly.model.parameters import LumpedParameters


@dataclass(frozen=True, kw_only=True, eq=False)
class FreeRun:
    """A log and its simulation with the recorded input, from the first sample on or in segments.

    Parameters
    ----------
    log
        The log.
    simulated
        (n,) simulated angle in rad at the log's stamps, from the encoder's zero.
    horizon
        Longest segment in s, each from a start of its own; infinite for none.
    """

    log: Log
    simulated: NDArray[np.float64]
    horizon: float = math.inf

    @cached_property
    def fit(self) -> float:
        """FIT = 100 (1 - |q - qhat| / |q - mean q|) in per cent, over the whole log."""
        with np.errstate(over="ignore", invalid="ignore"):  # of a simulation that diverged
            error = float(np.sum((self.simulated - self.log.angle) ** 2))
        return fit_of(error, _spread(self.log))

    @property
    def rms(self) -> float:
        """Rms error in rad."""
        return float(np.sqrt(np.mean((self.simulated - self.log.angle) ** 2)))


@dataclass(frozen=True)
class FitSummary:
    """Median, mean and worst FIT over a set of logs, in per cent.

    ``horizon`` is the longest segment in s that was simulated at a time; None for whole logs.
    """

    median: float
    mean: float
    worst: float
    horizon: float | None = None

    @classmethod
    def of(cls, fits: NDArray[np.float64], horizon: float | None = None) -> FitSummary:
        """Summarise the (n,) FIT values of n logs; an infinite horizon is one of whole logs."""
        finite = horizon if horizon is not None and math.isfinite(horizon) else None
        return cls(float(np.median(fits)), float(fits.mean()), float(fits.min()), finite)

    @property
    def over(self) -> str:
        """Over what logs are simulated, to be said after the word FIT; nothing of whole logs."""
        return "" if self.horizon is None else f" over segments of {self.horizon:g} s"

    def numbers(self) -> dict[str, float]:
        """Return it for programs."""
        said = {"median": self.median, "mean": self.mean, "worst": self.worst}
        return said if self.horizon is None else said | {"horizon": self.horizon}


@dataclass(frozen=True, kw_only=True)
class Setting:
    """What a log is simulated with.

    Parameters
    ----------
    parameters
        Of the bare hand.
    zero
        Reading of the encoder in rad where the model's angle is 0.
    velocity
        At the first sample, in rad/s; None where the log's own beginning tells it.
    horizon
        Longest stretch in s that is simulated at a time, infinite for the whole log (see
        `butterfly.identification.segments`).
    """

    parameters: LumpedParameters
    zero: float
    velocity: float | None = None
    horizon: float = math.inf

    def simulation(self, log: Log, first: int = 0) -> Trajectory | Segments:
        """Return what simulates a log, of which the samples from number ``first`` on count."""
        told = self.velocity is not None
        return simulation(log, self.parameters, self.horizon, first, told=told)


class Predictor:
    """Simulates the logs of a data set with any parameters; keeps what does not depend on them.

    The encoder's zero is what an estimate has found for the log; where it found none, what the data
    set tells (see `DataSet.zero_of`).

    Parameters
    ----------
    data
        The logs.
    """

    def __init__(self, data: DataSet) -> None:
        self.data = data
        self._trajectories: dict[tuple[int, float, float, bool], Trajectory | Segments] = {}
        self._horizon: float | None = None
        self._spreads = [_spread(log) for log in data.logs]

    def setting(self, number: int, estimate: Estimate) -> Setting:
        """Return what an estimate says of one log, by its number."""
        log = self.data.logs[number]
        parameters, own = estimate.applied(log)
        zero = own["zero"] if "zero" in own else self.data.zero_of(log)
        return Setting(
            parameters=parameters,
            zero=zero,
            velocity=own.get("velocity"),
            horizon=self.horizon(estimate),
        )

    def horizon(self, estimate: Estimate) -> float:
        """Return the longest stretch in s over which logs are simulated with an estimate.

        One that says nothing has that of the logs in which the hand stays away from the upright,
        where there are any.
        """
        if estimate.horizon is not None:
            return estimate.horizon
        if self._horizon is None:
            logs = [self.data.logs[k] for k in self.data.counted]
            self._horizon = horizon_of(logs, estimate.parameters, self.data.equilibria)
        return self._horizon

    def settled(self, estimate: Estimate) -> Estimate:
        """Return an estimate that says over what horizon these logs are simulated, if any."""
        horizon = self.horizon(estimate)
        return replace(estimate, horizon=horizon) if math.isfinite(horizon) else estimate

    def run(self, number: int, estimate: Estimate) -> FreeRun:
        """Simulate one log, by its number, with an estimate."""
        return self.run_with(number, self.setting(number, estimate))

    def run_with(self, number: int, setting: Setting) -> FreeRun:
        """Simulate one log, by its number, with the recorded input."""
        trajectory = self._trajectory(number, setting)
        simulated = trajectory.at_stamps(setting.parameters, setting.zero, setting.velocity)
        return FreeRun(log=self.data.logs[number], simulated=simulated, horizon=setting.horizon)

    def fits(self, estimate: Estimate, numbers: Iterable[int] | None = None) -> NDArray[np.float64]:
        """(n,) FIT in per cent of all logs, or some, with an estimate."""
        chosen = range(len(self.data.logs)) if numbers is None else numbers
        return np.array([self._fit_of(k, self.setting(k, estimate)) for k in chosen])

    def fits_with(
        self, parameters: LumpedParameters, horizon: float = math.inf
    ) -> NDArray[np.float64]:
        """(n,) FIT in per cent of all logs with parameters of the bare hand, over a horizon."""
        settings = [
            Setting(parameters=parameters, zero=self.data.zero_of(log), horizon=horizon)
            for log in self.data.logs
        ]
        return np.array([self._fit_of(k, each) for k, each in enumerate(settings)])

    def _fit_of(self, number: int, setting: Setting) -> float:
        """FIT of one log, as that of its free run, without keeping the angles."""
        trajectory = self._trajectory(number, setting)
        error = trajectory.squared_error(setting.parameters, setting.zero, setting.velocity)
        return fit_of(error, self._spreads[number])

    def _trajectory(self, number: int, setting: Setting) -> Trajectory | Segments:
        log, parameters = self.data.logs[number], setting.parameters
        told = setting.velocity is not None
        key = (number, grid_step(log, parameters), setting.horizon, told)
        if key not in self._trajectories:
            self._trajectories[key] = setting.simulation(log)
        return self._trajectories[key]


def fit_of(squared_error: float, spread: float) -> float:
    """Return FIT in per cent; none of an angle that stands still, or of one that diverges.

    Parameters
    ----------
    squared_error
        Sum of squares in rad^2 of simulated less measured angles.
    spread
        The same of the measured angles about their mean.
    """
    if not spread or not math.isfinite(squared_error):
        return -math.inf
    return 100 * (1 - math.sqrt(squared_error / spread))


def _spread(log: Log) -> float:
    """Sum of squares in rad^2 of the measured angle about its mean."""
    return float(np.sum((log.angle - log.angle.mean()) ** 2))


def free_run(log: Log, setting: Setting) -> FreeRun:
    """Simulate one log that belongs to no data set (see `Predictor.run_with`).

    Parameters
    ----------
    log
        With increasing stamps.
    setting
        Parameters of the bare hand (the log's added mass is put on here (78)), and its start.
    """
    trajectory = setting.simulation(log)
    simulated = trajectory.at_stamps(setting.parameters, setting.zero, setting.velocity)
    return FreeRun(log=log, simulated=simulated, horizon=setting.horizon)
