"""One log simulated with the recorded input, many times over: run and linearise.

A log is one segment from a given start, or one or more from starts that are fitted (multiple
shooting). Where small causes grow, as about the upright, no simulation stays near a log for long,
but each of many short ones does. What a change of a segment's start would take from its errors is
taken from these and their derivatives: fitted starts need no place among the parameters of a fit
(variable projection: Golub & Pereyra, Inverse Problems 19, 2003; Schittkowski, Numerical Data
Fitting in Dynamical Systems, 2002).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property, partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import Samples, joined, take_away
from butterfly.identification.blocks import edges_of
from butterfly.identification.levels import MOST, ROUNDING, SHOWS
from butterfly.identification.servo_drive import loop_on_grid, needs_loop
from butterfly.logs.log import InitialState, Intersample, Log
from butterfly.model.greybox import Columns, Readings, differentiate, simulate
from butterfly.model.kernel.servo_loop import Loop
from butterfly.model.linear import resonance_frequency
from butterfly.model.parameters import LumpedParameters
from butterfly.model.terms import DRIVE, IDEAL, DriveTerms
from butterfly.progress import current_search
from butterfly.signals import hold, polynomials
from butterfly.signals.spectrum import uniform_grid

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

_HOPEFUL = 2  # steps after which a model that is no better than a constant is given up
_SETTLED = 1e-4  # share of the squared errors that another start may still explain
_SHORTER = 0.25  # of a step that went too far
_START = ("zero", "velocity")


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
    """Simulates one log with the recorded input, in one or more segments.

    Without a ``horizon`` it is one segment, which starts as the log does (see `Log.initial_state`)
    or with a given velocity. Else segments are no longer than the ``horizon`` in s, and each starts
    as fits it best. Errors count from the sample numbered ``first`` on, at which a fitted segment
    begins. With ``warm`` each fitted start is sought from the one found last, which is near in a
    descent, but depends on earlier calls; else from where the log begins.
    """

    def __init__(
        self,
        log: Log,
        parameters: LumpedParameters,
        first: int = 0,
        horizon: float | None = None,
        *,
        warm: bool = False,
    ) -> None:
        self.log = log
        self.fitted = horizon is not None
        if horizon is None:
            self.segments = self._counted = [Segment(log, parameters, first)]
            return
        before, after = (
            edges_of(part, _count(part, horizon)) for part in np.split(log.time, [first])
        )
        edges = [*before, *(first + k for k in after), log.time.size]
        rate = log.rms_speed / (log.rms_motion or 1.0)
        self.segments = [
            Segment(log.piece(*ends), parameters, rate=rate, warm=warm) for ends in pairwise(edges)
        ]
        self._counted = self.segments[len(before) :]

    @property
    def step(self) -> float:
        """Step of the simulation in s."""
        grid = self._counted[0].grid
        return float(grid[1] - grid[0])

    def spend(self) -> int:
        """Return how many samples the next run simulates, and searches for starts did before it."""
        found = sum(each.spent + each.grid.size for each in self.segments)
        for each in self.segments:
            each.spent = 0
        return found

    @property
    def begins(self) -> list[InitialState]:
        """Where each segment starts, or the search for its start begins."""
        return [each.near for each in self.segments]

    @begins.setter
    def begins(self, states: Sequence[InitialState]) -> None:
        for each, state in zip(self.segments, states, strict=True):
            each.near = state

    def run(
        self, parameters: LumpedParameters, zero: float, velocity: float | None = None
    ) -> SimulatedMotion:
        """Simulate the log, its added mass on the bare hand (78); ``zero`` is the encoder's."""
        pieces = tuple(each.run(parameters, zero, velocity) for each in self.segments)
        return SimulatedMotion(pieces, self.log.integrated)

    def linearised(
        self,
        names: Sequence[str],
        parameters: LumpedParameters,
        zero: float,
        velocity: float | None = None,
    ) -> tuple[Samples, Samples]:
        """Return (m,) errors, and their (m, n) derivatives by n parameters.

        They are simulated less measured, in rad or rad/s, averaged over the samples of each grid
        interval, which keeps their information at a fraction of their number; less what a change
        of fitted starts explains.
        """
        errors, rows = zip(
            *(each.linearised(names, parameters, zero, velocity) for each in self._counted),
            strict=True,
        )
        return joined(errors), joined(rows)

    def directions(
        self, parameters: LumpedParameters, zero: float, velocity: float | None = None
    ) -> tuple[Samples, ...]:
        """Return for each segment the (m, j) directions in which its start moves its errors."""
        return tuple(each.directions(parameters, zero, velocity) for each in self._counted)

    def averages(self, parameters: LumpedParameters) -> tuple[NDArray[np.int64], Samples, Samples]:
        """Return for (m,) errors samples averaged, middles of steps in s, and mean inputs."""
        counts, middles, inputs = zip(
            *(each.averages(parameters) for each in self._counted), strict=True
        )
        return joined(counts), joined(middles), joined(inputs)


class _About(NamedTuple):
    """A segment's errors and derivatives about a start (see `Segment.linearised`)."""

    errors: Samples
    rows: Samples
    directions: Samples  # (m, j) orthonormal, in which the start moves the errors
    explained: Samples  # (j,) how far these lie along each
    step: Samples  # of angle in rad and velocity in rad/s, that takes that away to first order

    @property
    def cost(self) -> float:
        """Mean squared error in rad^2."""
        with np.errstate(over="ignore", invalid="ignore"):
            return float(np.mean(self.errors**2))

    @property
    def settled(self) -> bool:
        """Whether no other start makes the errors much smaller."""
        share = float(self.explained @ self.explained) / self.errors.size
        return share <= max(_SETTLED * self.cost, ROUNDING**2)


class Segment:
    """Simulates a stretch of a log on a fixed grid, from a given start or from one that is fitted.

    The step follows the resonance of the ``parameters`` of the bare hand and the log's drive, but
    is at most ``longest`` s. Errors count from the sample numbered ``first`` on. The start is
    fitted if there is a ``rate`` in 1/s, its velocity over its angle in size. Of a segment that
    begins at rest only the angle there is sought: friction holds a joint at rest, so that nothing
    can be differentiated by its velocity, and how it starts is evidence of its inertia.

    Between two instants of the grid the input is the parabola that has the mean and the first two
    moments of the recorded one, so that no impulse is lost or gained where steps fall between them.
    """

    def __init__(
        self,
        log: Log,
        parameters: LumpedParameters,
        first: int = 0,
        *,
        longest: float = LONGEST_STEP,
        rate: float | None = None,
        warm: bool = False,
    ) -> None:
        self.log, self.near = log, log.initial_state
        self.spent = 0  # samples simulated to find its start
        self._command = log.goal if log.closed else log.command
        step, self._every = min(grid_step(log, parameters), longest), 1
        if log.closed and log.servo is not None:
            step, self._every = log.servo.updates(step)
        grid = uniform_grid(log.time, step)
        self.grid = np.append(grid, log.time[-1]) if grid[-1] < log.time[-1] else grid
        self._first, self._warm, self._units = first, warm, np.array([1.0, rate or 0.0])
        self._sought = 0 if rate is None else 1 if self.near.velocity == 0 else len(_START)
        self._latest: tuple[tuple[float, float, float, DriveTerms], Samples] | None = None

    def begin(
        self, parameters: LumpedParameters, zero: float, velocity: float | None = None
    ) -> InitialState:
        """Return the start: a given one, or that from which the segment is followed best."""
        if not self._sought:
            angle = float(self.log.angle[0])
            return self.near if velocity is None else InitialState(angle, velocity)
        begin = self.near
        at = self._about(_START, parameters, zero, begin)
        if not math.isfinite(at.cost):
            begin = self.log.initial_state
            at = self._about(_START, parameters, zero, begin)
        reach, spread = 1.0, self.log.rms_measured**2
        for tries in range(MOST):
            hopeless = at.cost > spread or (self._warm and current_search().over)
            if at.settled or reach < ROUNDING or (tries > _HOPEFUL and hopeless):
                break
            there = InitialState(*(np.array(begin) + reach * at.step).tolist())
            tried = self._about(_START, parameters, zero, there)
            self.spent += self.grid.size
            if tried.cost < at.cost:
                begin, at, reach = there, tried, min(reach / _SHORTER, 1.0)
            else:
                reach *= _SHORTER
        if self._warm:
            self.near = begin
        return begin

    def run(
        self, parameters: LumpedParameters, zero: float, velocity: float | None
    ) -> tuple[Samples, Samples, Samples]:
        """Return the (n,) grid in s, and on it the angle in rad and the velocity in rad/s."""
        begin = self.begin(parameters, zero, velocity)
        start = begin.angle - zero, begin.velocity
        loaded = parameters.with_added_mass(self.log.added_mass)
        inputs, loop = self._inputs(parameters), self.loop(parameters, zero)
        angle, speed = simulate(loaded, self.grid, inputs[0], *start, loop)
        return self.grid, zero + angle, speed

    def linearised(
        self,
        names: Sequence[str],
        parameters: LumpedParameters,
        zero: float,
        velocity: float | None,
    ) -> tuple[Samples, Samples]:
        """Return (m,) errors and (m, n) derivatives (see `Simulation.linearised`)."""
        if not self._sought:
            begin = self.begin(parameters, zero, velocity)
            return self._differentiated(names, parameters, zero, begin)
        found = self._about_best(names, parameters, zero)
        rows = found.rows[:, : len(names)]
        take_away(found.directions, rows)
        return found.errors - found.directions @ found.explained, rows

    def directions(
        self, parameters: LumpedParameters, zero: float, velocity: float | None
    ) -> Samples:
        """Return (m, j) orthonormal directions in which the start moves the errors."""
        if self._sought:
            return self._about_best((), parameters, zero).directions
        _, rows = self.linearised(_START, parameters, zero, velocity)
        return _orthonormal(self._by_start(*rows.T))

    def averages(self, parameters: LumpedParameters) -> tuple[NDArray[np.int64], Samples, Samples]:
        """Return for (m,) errors samples averaged, middles of steps in s, and mean inputs."""
        readings, _, counts = self._averages
        middles = np.asarray((self.grid[:-1] + self.grid[1:])[readings.into >= 0] / 2)
        if needs_loop(self.log):
            alone = replace(self.log, servo=None, enabled=None)
            return counts, middles, Segment(alone, parameters, self._first).averages(parameters)[2]
        inputs = self._inputs(parameters)[0] @ _SIMPSON
        return counts, middles, np.asarray(inputs[readings.into >= 0])

    def loop(self, parameters: LumpedParameters, zero: float) -> Loop | None:
        """Return the loop of a servo that drives the joint; None where its input says all."""
        if not needs_loop(self.log):
            return None
        inputs = self._inputs(parameters)
        return loop_on_grid(self.log, parameters, zero, self.grid, inputs, self._every)

    def _about_best(
        self, names: Sequence[str], parameters: LumpedParameters, zero: float
    ) -> _About:
        """Return errors and derivatives by names, and then by the start, about the best start."""
        every = tuple(dict.fromkeys((*names, *_START)))
        found = self._about(every, parameters, zero, self.near)
        if found.settled:
            return found
        return self._about(every, parameters, zero, self.begin(parameters, zero))

    def _about(
        self, names: Sequence[str], parameters: LumpedParameters, zero: float, begin: InitialState
    ) -> _About:
        """Differentiate by names and start, which moves angles by 1 less what the zero does."""
        with np.errstate(over="ignore", invalid="ignore"):
            expansion = self._differentiated(names, parameters, zero, begin)
            errors, rows = expansion
        by_start = rows[:, [names.index(each) for each in _START]]
        columns = self._by_start(*by_start.T) * self._units
        if not (np.isfinite(columns).all() and np.isfinite(errors).all()):
            return _About(*expansion, np.zeros((errors.size, 0)), np.zeros(0), np.zeros(2))
        left, sizes, right = np.linalg.svd(columns[:, : self._sought], full_matrices=False)
        felt = sizes > SHOWS * sizes[0]
        explained = left[:, felt].T @ errors
        step = np.zeros(len(_START))
        step[: self._sought] = -(right[felt].T @ (explained / sizes[felt]))
        step *= self._units
        return _About(*expansion, left[:, felt], explained, step)

    def _differentiated(
        self, names: Sequence[str], parameters: LumpedParameters, zero: float, begin: InitialState
    ) -> tuple[Samples, Samples]:
        """Return (m,) errors and (m, n) derivatives from a start."""
        loop = self.loop(parameters, zero)
        columns = Columns.of(names, parameters, self.log.added_mass, exact=loop is not None)
        loaded = parameters.with_added_mass(self.log.added_mass)
        inputs = self._inputs(parameters, columns.drives)
        start = begin.angle - zero, begin.velocity
        readings, measured, _ = self._averages
        values, rows = differentiate(loaded, self.grid, inputs, start, readings, columns, loop)
        rise = 0 if self.log.integrated else 1  # no velocity depends on the zero
        for zero_column in np.flatnonzero(columns.initial[0] < 0):
            rows[:, zero_column] += rise  # it moves the start back, and all readings on
        return values + (rise * zero - measured), rows @ columns.mixture

    def _by_start(self, by_zero: Samples, by_velocity: Samples) -> Samples:
        """Return (m, 2) derivatives by the true angle and the velocity at the start."""
        return np.column_stack([1 - self.log.integrated - by_zero, by_velocity])

    @cached_property
    def _averages(self) -> tuple[Readings, Samples, NDArray[np.int64]]:
        """What is read off, and (m,) averages of what was measured, and of how many samples."""
        log, first = self.log, self._first
        into, weights, measured, counts = polynomials.averages(
            self.grid, log.time[first:], log.measured[first:], log.integrated
        )
        return Readings(into=into, weights=weights), measured, counts

    def _inputs(self, parameters: LumpedParameters, drives: int = 0) -> Samples:
        """(2 or more, n - 1, 3) delivered input and its derivatives; the latest are kept."""
        # by the delay (see `hold.parabolas`); by the slow delay and the drive's terms, if asked for
        looped = needs_loop(self.log)  # delivers by itself
        drive = IDEAL if looped else parameters.drive
        slow = (0.0, 0.0) if looped else (parameters.slow_delay, parameters.slow_interval)
        count = 2 if looped else max(drives, 2)
        latest, key = self._latest, (parameters.delay, *slow, drive)
        if latest is None or latest[0] != key or len(latest[1]) < count:
            commands = self._command[1]
            time = self.log.arrivals(*slow) if slow[0] else self._command[0]
            on_grid = partial(
                hold.parabolas, edges=self.grid - parameters.delay, hold=self.log.intersample
            )
            delivered = drive.delivered(commands)
            inputs = np.zeros((count, self.grid.size - 1, 3))
            inputs[:2] = on_grid(time, delivered)
            if count >= _DELAYS and slow[1]:
                inputs[2] = on_grid(time, self._slow(delivered, slow[1]))[1]
            for k, name in enumerate(DRIVE[: max(count - _DELAYS, 0)], _DELAYS):
                inputs[k] = on_grid(time, parameters.slope(name, commands))[0]
            self._latest = latest = key, inputs
        return latest[1][:count]

    def _slow(self, inputs: Samples, limit: float) -> Samples:
        """Return what the steps alone of (n,) inputs make that come while the clock is slow."""
        held = self.log.intersample is Intersample.ZERO_ORDER_HOLD
        steps = np.diff(inputs, prepend=0.0 if held else inputs[0])
        return np.cumsum(steps * self.log.is_slow(limit))


def segment_length(
    log: Log,
    parameters: LumpedParameters,
    horizon: float,
    *,
    first: int = 0,
    velocity_known: bool,
    free: bool = False,
) -> float | None:
    """Return how long segments with fitted starts are at most, in s; None if the start is given.

    It is given if a log no longer than the horizon begins at rest, its beginning does not count,
    or its velocity there is known, and gravity or a servo's loop brings the joint back. With
    ``free`` the start of one at rest is fitted too, as noise of its first sample is of weight.
    """
    loaded = parameters.with_added_mass(log.added_mass)
    begins_in_motion = first == 0 and log.initial_state.velocity != 0
    if log.closed and log.servo is not None:
        longer, doubtful = False, begins_in_motion or log.servo.of_speed
    else:
        longer = log.time[-1] - log.time[0] > horizon
        doubtful = loaded.p3 == 0 or begins_in_motion or (free and first == 0)
    fitted = (longer or (doubtful and not velocity_known)) and loaded.p1 > 0
    return (math.inf if log.closed else horizon) if fitted else None


def _count(time: Samples, horizon: float) -> int:
    """Return the fewest segments no longer than a horizon in s."""
    span = float(time[-1] - time[0]) if time.size else 0.0
    return max(math.ceil(span / horizon * (1 - 1e-9)), 1)


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


def _orthonormal(columns: Samples) -> Samples:
    """Return (m, j) orthonormal columns that span those of (m, k) that are felt at all."""
    sizes = np.linalg.norm(columns, axis=0)
    felt = sizes > ROUNDING * columns.shape[0] ** 0.5
    left, singular, _ = np.linalg.svd(columns[:, felt] / sizes[felt], full_matrices=False)
    return np.asarray(left[:, singular > ROUNDING * singular.max(initial=0.0)])


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
