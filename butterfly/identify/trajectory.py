"""A log made ready to be simulated many times over."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numba
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


class Trajectory:
    """Simulates one log from its first sample with the recorded input, on a fixed grid.

    Parameters
    ----------
    log
        With increasing stamps.
    parameters
        Of the bare hand; their resonance and the log's drive set the step of the grid.
    """

    def __init__(self, log: Log, parameters: LumpedParameters) -> None:
        self.log = log
        drive = log.excitation.omega if log.excitation else 0.0
        loaded = parameters.with_added_mass(log.added_mass)
        fastest = max(resonance_frequency(loaded), drive)
        step = min(LONGEST_STEP, 1 / (_STEPS_PER_RADIAN * fastest)) if fastest else LONGEST_STEP
        grid = uniform_grid(log.time, step)
        self.grid = np.append(grid, log.time[-1]) if grid[-1] < log.time[-1] else grid
        self._cell = np.minimum(np.searchsorted(self.grid, log.time, "right") - 1, grid.size - 2)
        self._inputs = lru_cache(maxsize=4)(self._delayed_input)

    def simulate(
        self, parameters: LumpedParameters, zero: float, velocity: float = 0.0
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (n,) angles from the encoder's zero and velocities on the grid.

        Parameters
        ----------
        parameters
            Of the bare hand; the log's added mass is put on here (78).
        zero
            Reading of the encoder in rad where the model's angle is 0.
        velocity
            At the first sample, in rad/s.
        """
        loaded = parameters.with_added_mass(self.log.added_mass)
        start = float(self.log.angle[0]) - zero
        inputs = self._inputs(parameters.delay)
        angle, speed = simulate(loaded, self.grid, inputs, start, velocity)
        return zero + angle, speed

    def at_stamps(
        self, parameters: LumpedParameters, zero: float, velocity: float = 0.0
    ) -> NDArray[np.float64]:
        """Return the simulated angles at the log's own stamps (see `simulate`)."""
        angle, speed = self.simulate(parameters, zero, velocity)
        return np.asarray(CubicHermiteSpline(self.grid, angle, speed)(self.log.time))

    def errors(
        self, parameters: LumpedParameters, zero: float, velocity: float = 0.0, *, first: int = 0
    ) -> NDArray[np.float64]:
        """Return simulated less measured angle, averaged over the samples of each grid interval.

        The average keeps what the samples tell at a fraction of their number.

        Parameters
        ----------
        parameters, zero, velocity
            As in `simulate`.
        first
            Number of the first sample that counts.
        """
        angle, speed = self.simulate(parameters, zero, velocity)
        log = self.log
        return _mean_errors(
            self.grid, angle, speed, log.time[first:], log.angle[first:], self._cell[first:]
        )

    def _delayed_input(self, delay: float) -> NDArray[np.float64]:
        """(n - 1, 3) input at start, middle and end of each grid interval, ``delay`` s late.

        A held input is averaged over each interval, so that no impulse is lost or gained when its
        steps fall between the instants of the grid.
        """
        log, grid = self.log, self.grid
        if log.intersample is Intersample.FIRST_ORDER_HOLD:
            ends = np.interp(grid - delay, log.time, log.input)
            middles = np.interp(grid[:-1] + np.diff(grid) / 2 - delay, log.time, log.input)
            return np.column_stack([ends[:-1], middles, ends[1:]])
        impulse = np.concatenate([[0.0], np.cumsum(log.input[:-1] * np.diff(log.time))])
        means = np.diff(np.interp(grid - delay, log.time, impulse)) / np.diff(grid)
        return np.repeat(means[:, None], 3, axis=1)


@numba.njit(cache=True, nogil=True)
def _mean_errors(grid, angle, speed, time, measured, cell):
    """Interpolate by cubic Hermite polynomials, subtract, and average over each cell."""
    means = np.empty(cell[-1] - cell[0] + 1)
    count, total, filled = 0, 0.0, 0
    for k in range(time.size):
        i = cell[k]
        h = grid[i + 1] - grid[i]
        s = (time[k] - grid[i]) / h
        r = 1.0 - s
        value = (1.0 + 2.0 * s) * r * r * angle[i] + s * r * r * h * speed[i]
        value += (1.0 + 2.0 * r) * s * s * angle[i + 1] - r * s * s * h * speed[i + 1]
        total += value - measured[k]
        count += 1
        if k + 1 == time.size or cell[k + 1] != i:
            means[filled] = total / count
            count, total, filled = 0, 0.0, filled + 1
    return means[:filled]
