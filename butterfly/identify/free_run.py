"""Does the model move like the robot? Free-run simulation of whole logs, and its FIT."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from butterfly.logs.log import Intersample
from butterfly.model.greybox import simulate
from butterfly.model.harmonic import resonance_frequency
from butterfly.signals.resample import uniform_grid

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from butterfly.logs.log import Log
    from butterfly.model.parameters import LumpedParameters

LONGEST_STEP = 0.01
"""Longest integration step in s; RK4's error is then 1.5e-7 rad over 70 s of small swings."""

_STEPS_PER_RADIAN = 10  # of the drive or of the resonance, whichever is faster


@dataclass(frozen=True, kw_only=True, eq=False)
class FreeRun:
    """A log and its simulation from the first sample on, at rest, with the recorded input.

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


def free_run(log: Log, parameters: LumpedParameters, equilibrium: float) -> FreeRun:
    """Simulate a log from its first sample, at rest, with the recorded input.

    Parameters
    ----------
    log
        With increasing stamps.
    parameters
        Of the bare hand; the log's added mass is put on here (78).
    equilibrium
        Reading of the encoder in rad when the hand hangs at rest.
    """
    loaded = parameters.with_added_mass(log.added_mass)
    drive = log.excitation.omega if log.excitation else 0.0
    fastest = max(resonance_frequency(loaded), drive)
    step = min(LONGEST_STEP, 1 / (_STEPS_PER_RADIAN * fastest)) if fastest > 0 else LONGEST_STEP
    grid = uniform_grid(log.time, step)
    if grid[-1] < log.time[-1]:
        grid = np.append(grid, log.time[-1])
    angle, velocity = simulate(
        loaded,
        grid,
        _delayed_input(log, grid, parameters.delay),
        float(log.angle[0]) - equilibrium,
    )
    return FreeRun(
        log=log, simulated=equilibrium + CubicHermiteSpline(grid, angle, velocity)(log.time)
    )


def _delayed_input(log: Log, grid: NDArray[np.float64], delay: float) -> NDArray[np.float64]:
    """(n - 1, 3) input at start, middle and end of each interval of ``grid``, ``delay`` s late.

    A held input is averaged over each interval, so that no impulse is lost or gained when its
    steps fall between the instants of the grid.
    """
    if log.intersample is Intersample.FIRST_ORDER_HOLD:
        ends = np.interp(grid - delay, log.time, log.input)
        middles = np.interp(grid[:-1] + np.diff(grid) / 2 - delay, log.time, log.input)
        return np.column_stack([ends[:-1], middles, ends[1:]])
    impulse = np.concatenate([[0.0], np.cumsum(log.input[:-1] * np.diff(log.time))])
    means = np.diff(np.interp(grid - delay, log.time, impulse)) / np.diff(grid)
    return np.repeat(means[:, None], 3, axis=1)
