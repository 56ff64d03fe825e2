"""A log made ready to be simulated many times over."""

from __future__ import annotations

from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np

from butterfly.model.greybox import simulate
from butterfly.model.linear import resonance_frequency
from butterfly.model.parameters import compressed
from butterfly.signals import hold
from butterfly.signals.resample import uniform_grid

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Samples = NDArray[np.float64]

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
    first
        Number of the first sample whose error counts.
    """

    def __init__(self, log: Log, parameters: LumpedParameters, first: int = 0) -> None:
        self.log = log
        grid = uniform_grid(log.time, grid_step(log, parameters))
        self.grid = np.append(grid, log.time[-1]) if grid[-1] < log.time[-1] else grid
        self._first = first
        self._inputs = lru_cache(maxsize=4)(self._delivered)

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
        inputs = self._inputs(parameters.delay, parameters.compression)
        angle, speed = simulate(loaded, self.grid, inputs, start, velocity)
        return zero + angle, speed

    def at_stamps(
        self, parameters: LumpedParameters, zero: float, velocity: float = 0.0
    ) -> NDArray[np.float64]:
        """Return the simulated angles at the log's own stamps (see `simulate`)."""
        angle, speed = self.simulate(parameters, zero, velocity)
        begin, weights = self._at_stamps
        ends = (angle[begin], speed[begin], angle[begin + 1], speed[begin + 1])
        return np.asarray(sum(w * end for w, end in zip(weights, ends, strict=True)))

    def errors(
        self, parameters: LumpedParameters, zero: float, velocity: float = 0.0
    ) -> NDArray[np.float64]:
        """Return simulated less measured angle, averaged over the samples of each grid interval.

        The average keeps what the samples tell at a fraction of their number. Being linear in the
        ends of the interval, it takes four numbers for each, worked out beforehand.

        Parameters
        ----------
        parameters, zero, velocity
            As in `simulate`.
        """
        angle, speed = self.simulate(parameters, zero, velocity)
        begin, (from_start, start_slope, from_end, end_slope, measured) = self._averages
        end = begin + 1
        return np.asarray(
            from_start * angle[begin]
            + start_slope * speed[begin]
            + from_end * angle[end]
            + end_slope * speed[end]
            - measured
        )

    @cached_property
    def _averages(self) -> tuple[NDArray[np.intp], Samples]:
        """Average the cubic Hermite polynomials, and the measured angle, over each grid interval.

        Returns
        -------
        (m,) numbers of the intervals that hold samples, and (5, m) weights of angle and velocity at
        both ends, and mean measured angle.
        """
        cell, weights = self._hermite(self.log.time[self._first :])
        values = np.vstack([weights, self.log.angle[self._first :]])
        starts = np.flatnonzero(np.diff(cell, prepend=-1))
        counts = np.diff(starts, append=cell.size)
        return cell[starts], np.add.reduceat(values, starts, axis=1) / counts

    @cached_property
    def _at_stamps(self) -> tuple[NDArray[np.intp], Samples]:
        """The weights of `_hermite` at the log's own stamps."""
        return self._hermite(self.log.time)

    def _hermite(self, time: Samples) -> tuple[NDArray[np.intp], Samples]:
        """Interpolate between the instants of the grid by cubic Hermite polynomials.

        Returns
        -------
        (n,) numbers of the intervals that hold (n,) instants, and (4, n) weights of angle and
        velocity at their start and their end.
        """
        cell = np.searchsorted(self.grid, time, "right") - 1
        cell = np.minimum(cell, self.grid.size - 2)
        length = np.diff(self.grid)[cell]
        s = (time - self.grid[cell]) / length
        r = 1 - s
        weights = [(1 + 2 * s) * r**2, s * r**2 * length, (1 + 2 * r) * s**2, -r * s**2 * length]
        return cell, np.array(weights)

    def _delivered(self, delay: float, compression: float) -> NDArray[np.float64]:
        """(n - 1, 3) delivered input at start, middle and end of each interval, ``delay`` s late.

        The parabola that has the held input's mean and first and second moment over the interval,
        so that no impulse is lost or gained where steps fall between the instants of the grid.
        """
        log = self.log
        inputs = compressed(log.input, compression)
        mean, slope, bend = hold.moments(log.time, inputs, self.grid - delay, log.intersample)
        return np.column_stack([mean - slope + bend, mean - bend / 2, mean + slope + bend])


def grid_step(log: Log, parameters: LumpedParameters) -> float:
    """Return the longest step in s of a simulation's grid, for parameters of the bare hand."""
    drive = log.excitation.omega if log.excitation else 0.0
    fastest = max(resonance_frequency(parameters.with_added_mass(log.added_mass)), drive)
    return min(LONGEST_STEP, 1 / (_STEPS_PER_RADIAN * fastest)) if fastest else LONGEST_STEP
