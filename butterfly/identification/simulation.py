"""One log simulated with the recorded input, many times over: run and linearise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import Samples, joined
from butterfly.identification.servo_drive import loop_on_grid, needs_loop
from butterfly.logs.log import InitialState, Intersample, Log
from butterfly.model.greybox import Columns, Readings, differentiate, simulate
from butterfly.model.kernel.servo_loop import Loop
from butterfly.model.linear import resonance_frequency
from butterfly.model.parameters import LumpedParameters
from butterfly.model.terms import DRIVE, IDEAL, DriveTerms
from butterfly.signals import hold, polynomials
from butterfly.signals.spectrum import uniform_grid

Begin: TypeAlias = InitialState | float | None
"""How a simulation starts: with angle and velocity, with a velocity, or as the log does."""

LONGEST_STEP = 0.01
"""Longest integration step in s; RK4's error is then 1.5e-7 rad over 70 s of small swings."""

_ROUGH = 0.005
"""Share of noise in an input, from which on no two of its samples share a step: what it does where
the joint turns back or sticks is then no matter of its mean."""

_SIMPSON = np.array([1.0, 4.0, 1.0]) / 6  # the mean of a parabola
FINEST = 100
"""Steps in one of a log at most: what is faster no log shows."""
_DELAYS = 3  # drives before those of the terms of the drive: p4's, and those by both delays
_STEPS_PER_RADIAN = 10  # of the drive or of the resonance, whichever is faster


class SimulatedMotion(NamedTuple):
    """The motion of a log: pieces of it, and of each the grid in s, angle in rad and velocity."""

    pieces: tuple[tuple[Samples, Samples, Samples], ...]  # angles from the encoder's zero
    slopes: bool = False  # whether the log measures the velocity

    def at(self, instants: Samples) -> Samples:
        """Return what the log measures, in rad or rad/s, at increasing instants in s."""
        begins = [grid[0] for grid, *_ in self.pieces[1:]]
        groups = np.split(instants, np.searchsorted(instants, begins))
        return joined(
            [
                polynomials.interpolate(*piece, own, self.slopes)
                for piece, own in zip(self.pieces, groups, strict=True)
            ]
        )


class Simulation:
    """Simulates one log from its first sample with the recorded input, on a fixed grid.

    It starts as the log does (see `Log.initial_state`). The step follows the resonance of the
    ``parameters`` of the bare hand and the log's drive, but is at most ``longest`` s. Errors count
    from the sample numbered ``first`` on.

    Between two instants of the grid the input is the parabola that has the mean and the first two
    moments of the recorded one, so that no impulse is lost or gained where steps fall between them.
    """

    def __init__(
        self, log: Log, parameters: LumpedParameters, first: int = 0, longest: float = LONGEST_STEP
    ) -> None:
        self.log = log
        self._command = log.goal if log.closed else log.command
        step, self._every = min(grid_step(log, parameters), longest), 1
        if log.closed and log.servo is not None:
            step, self._every = log.servo.updates(step)
        grid = uniform_grid(log.time, step)
        self.grid = np.append(grid, log.time[-1]) if grid[-1] < log.time[-1] else grid
        self._first = first
        self._latest: tuple[tuple[float, float, float, DriveTerms], Samples] | None = None

    @property
    def step(self) -> float:
        """Step of the simulation in s."""
        return float(self.grid[1] - self.grid[0])

    def spend(self) -> int:
        """Return how many samples the next run simulates."""
        return self.grid.size

    def run(
        self, parameters: LumpedParameters, zero: float, begin: Begin = None
    ) -> SimulatedMotion:
        """Simulate the log, its added mass on the bare hand (78); ``zero`` is the encoder's."""
        loaded = parameters.with_added_mass(self.log.added_mass)
        inputs, loop = self._inputs(parameters), self.loop(parameters, zero)
        angle, speed = simulate(loaded, self.grid, inputs[0], *self.start(zero, begin), loop)
        return SimulatedMotion(((self.grid, zero + angle, speed),), self.log.integrated)

    def linearised(
        self, names: Sequence[str], parameters: LumpedParameters, zero: float, begin: Begin = None
    ) -> tuple[Samples, Samples]:
        """Return (m,) errors, and their (m, n) derivatives by n parameters.

        They are simulated less measured, in rad or rad/s, averaged over the samples of each grid
        interval: that keeps what they tell at a fraction of their number.
        """
        columns = Columns.of(names, parameters, self.log.added_mass)
        loaded = parameters.with_added_mass(self.log.added_mass)
        inputs = self._inputs(parameters, columns.drives)
        start = self.start(zero, begin)
        readings, measured, _ = self._averages
        loop = self.loop(parameters, zero)
        values, rows = differentiate(loaded, self.grid, inputs, start, readings, columns, loop)
        rise = 0 if self.log.integrated else 1  # no velocity depends on the zero
        for zero_column in np.flatnonzero(columns.initial[0] < 0):
            rows[:, zero_column] += rise  # it moves the start back, and all readings on
        return values + (rise * zero - measured), rows @ columns.mixture

    @property
    def counts(self) -> NDArray[np.int64]:
        """(m,) samples over which `linearised` averages each error, one after the other."""
        return self._averages[2]

    def mean_inputs(self, parameters: LumpedParameters) -> Samples:
        """Return the (m,) means of the delivered input where `linearised` has errors."""
        if needs_loop(self.log):
            alone = replace(self.log, servo=None, enabled=None)
            return Simulation(alone, parameters, self._first).mean_inputs(parameters)
        return np.asarray((self._inputs(parameters)[0] @ _SIMPSON)[self._averages[0].into >= 0])

    def middles(self) -> Samples:
        """Return the (m,) instants in s, middles of steps, for which `linearised` has errors."""
        return np.asarray((self.grid[:-1] + self.grid[1:])[self._averages[0].into >= 0] / 2)

    def start(self, zero: float, begin: Begin) -> tuple[float, float]:
        """Return angle, from the hanging position, and velocity at the first sample."""
        if begin is None:
            begin = self.log.initial_state
        elif not isinstance(begin, InitialState):
            begin = InitialState(float(self.log.angle[0]), begin)
        return begin.angle - zero, begin.velocity

    @cached_property
    def _averages(self) -> tuple[Readings, Samples, NDArray[np.int64]]:
        """What is read off, and (m,) averages of what was measured, and of how many samples."""
        log, first = self.log, self._first
        into, weights, measured, counts = polynomials.averages(
            self.grid, log.time[first:], log.measured[first:], log.integrated
        )
        return Readings(into=into, weights=weights), measured, counts

    def loop(self, parameters: LumpedParameters, zero: float) -> Loop | None:
        """Return the loop of a servo that drives the joint; None where its input says all."""
        if not needs_loop(self.log):
            return None
        inputs = self._inputs(parameters)
        return loop_on_grid(self.log, parameters, zero, self.grid, inputs, self._every)

    def _inputs(self, parameters: LumpedParameters, drives: int = 0) -> Samples:
        """(2 or more, n - 1, 3) delivered input and its derivatives; the latest are kept."""
        # by the delay (see `hold.parabolas`); by the slow delay and the drive's terms, if asked for
        looped = needs_loop(self.log)  # delivers by itself
        drive = IDEAL if looped else parameters.drive
        slow = (0.0, 0.0) if looped else (parameters.slow_delay, parameters.slow_interval)
        latest, key = self._latest, (parameters.delay, *slow, drive)
        if latest is not None and latest[0] == key and max(drives, 2) <= len(latest[1]):
            return latest[1][: max(drives, 2)]
        commands = self._command[1]
        time = self.log.arrivals(*slow) if slow[0] else self._command[0]
        if latest is None or latest[0] != key:
            delivered = self._parabolas(time, drive.delivered(commands), parameters.delay)
            self._latest = latest = key, delivered
        if drives > len(latest[1]) and not looped:
            more = np.zeros((drives, *latest[1].shape[1:]))
            more[:2] = latest[1][:2]
            if slow[1]:
                late = self._slow(drive.delivered(commands), slow[1])
                more[2] = self._parabolas(time, late, parameters.delay)[1]
            for k, name in enumerate(DRIVE[: drives - _DELAYS], _DELAYS):
                own = parameters.slope(name, commands)
                more[k] = self._parabolas(time, own, parameters.delay)[0]
            self._latest = latest = key, more
        return latest[1][: max(drives, 2)]

    def _slow(self, inputs: Samples, limit: float) -> Samples:
        """Return what the steps alone of (n,) inputs make that come while the clock is slow."""
        held = self.log.intersample is Intersample.ZERO_ORDER_HOLD
        steps = np.diff(inputs, prepend=0.0 if held else inputs[0])
        return np.cumsum(steps * self.log.is_slow(limit))

    def _parabolas(self, time: Samples, inputs: Samples, delay: float) -> Samples:
        return hold.parabolas(time, inputs, self.grid - delay, self.log.intersample)


def grid_step(log: Log, parameters: LumpedParameters) -> float:
    """Return the longest step in s of a grid; no log shows a resonance a hundred times its rate."""
    drive = log.excitation.omega if log.excitation else 0.0
    loaded = parameters.with_added_mass(log.added_mass)
    fastest = max(resonance_frequency(loaded), drive)
    longest = LONGEST_STEP if log.roughness < _ROUGH else min(LONGEST_STEP, log.mean_step / 2)
    if loaded.p2 * longest > loaded.p1:
        longest = min(longest, log.mean_step)
    if not fastest:
        return longest
    return max(min(longest, 1 / (_STEPS_PER_RADIAN * fastest)), log.mean_step / FINEST)


def rehearse() -> None:
    """Call all that numba compiles of an identification, so that it is on disk from then on.

    What a simulated experiment compiles itself comes last: by then that is on disk.
    """
    time = np.arange(0.0, 0.2, 0.01)
    robot = LumpedParameters(p1=1.0, p2=1.0, p3=1.0, p4=1.0)
    log = Log(time, time, time)
    simulation = Simulation(log, robot)
    for each in (robot, replace(robot, base_compliance=1e-3)):
        simulation.linearised(("p1",), each, 0.0)
    hold.mean(time, time, time, log.intersample)
    hold.for_sums(time, time, time, log.intersample)
    polynomials.slope(time, 2, 2, 0.01)
    simulation.run(robot, 0.0).at(time)
