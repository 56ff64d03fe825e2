"""A log simulated with the recorded input, as one segment or several: run and linearised.

A log is one segment from a given start, or one or more from starts that are fitted (multiple
shooting). Where small errors grow, as about the upright, no simulation stays near a log for long,
but each of many short ones does. The effects of a segment's start are projected out of its errors
and their derivatives, so that fitted starts are no parameters of a fit (variable projection: Golub
& Pereyra, Inverse Problems 19, 2003; Schittkowski, Numerical Data Fitting in Dynamical Systems,
2002).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import Samples, joined, take_away
from butterfly.identification.inference.blocks import edges_of
from butterfly.identification.levels import MOST, ROUNDING, SHOWS
from butterfly.identification.segment import LONGEST_STEP, Segment
from butterfly.identification.servo_drive import needs_loop
from butterfly.logs.log import InitialState, Log
from butterfly.model.greybox import Columns
from butterfly.model.parameters import LumpedParameters
from butterfly.progress import current_search
from butterfly.signals import hold, polynomials

_HOPEFUL = 2  # steps after which a search is given up if the model is worse than a constant
_SETTLED = 1e-4  # share of the squared errors that another start may still explain
_SHORTER = 0.25  # of a step that went too far
_START = ("zero", "velocity")


class SimulatedMotion(NamedTuple):
    """The motion of a log in pieces, each with grid in s, angle in rad and velocity in rad/s."""

    pieces: tuple[tuple[Samples, Samples, Samples], ...]  # angles from the encoder's zero
    slopes: bool = False  # whether the log measures the velocity

    def at(self, instants: Samples) -> Samples:
        """Return the measured signal, in rad or rad/s, at increasing instants in s."""
        begins = [grid[0] for grid, *_ in self.pieces[1:]]
        groups = np.split(instants, np.searchsorted(instants, begins))
        pairs = zip(self.pieces, groups, strict=True)
        return joined([polynomials.interpolate(*piece, some, self.slopes) for piece, some in pairs])


class Simulation:
    """Simulates one log with the recorded input, in one or more segments.

    Without a ``horizon`` it is one segment, which starts as the log does (see `Log.initial_state`)
    or with a given velocity, in steps of at most ``longest`` s. Else segments are no longer than
    the ``horizon`` in s, and their starts are fitted. Errors count from the sample numbered
    ``first`` on, at which a fitted segment begins. With ``warm`` each search for a start begins at
    the last one, which is near in a descent, but depends on earlier calls; else where the log
    begins.
    """

    def __init__(
        self,
        log: Log,
        parameters: LumpedParameters,
        first: int = 0,
        horizon: float | None = None,
        *,
        warm: bool = False,
        longest: float = LONGEST_STEP,
    ) -> None:
        self.log, self.first, self._warm = log, first, warm
        self.fitted = horizon is not None
        self._uncounted = 0  # segments before `first`
        if horizon is None:
            self.segments = [Segment(log, parameters, first, longest)]
        else:
            before, after = (
                edges_of(part, _count(part, horizon)) for part in np.split(log.time, [first])
            )
            edges = [*before, *(first + k for k in after), log.time.size]
            self.segments = [Segment(log.piece(*ends), parameters) for ends in pairwise(edges)]
            self._uncounted = len(before)
        self.recorded = tuple(each.log.initial_state for each in self.segments)
        """Start of each segment as its samples show it."""
        self.begins = [*self.recorded]
        """The same, or where the search for it begins."""

    @property
    def step(self) -> float:
        """Mean step of the simulation in s."""
        return float(np.mean(np.diff(self.segments[self._uncounted].grid)))

    def spend(self) -> int:
        """Return the number of steps of all simulations since the last call."""
        return sum(each.spend() for each in self.segments)

    def given_start(self, velocity: float | None) -> InitialState:
        """Return the start of a log that is one segment, with a velocity in rad/s if given."""
        if velocity is None:
            return self.begins[0]
        return InitialState(float(self.log.angle[0]), velocity)

    def run(
        self, parameters: LumpedParameters, zero: float, velocity: float | None = None
    ) -> SimulatedMotion:
        """Simulate the log, its added mass on the bare hand (78); ``zero`` is the encoder's."""
        begins = [self.given_start(velocity)]
        if self.fitted:
            begins = [each.begin for each in self._expansions((), parameters, zero, 0)]
        joint = parameters.with_added_mass(self.log.added_mass)
        pairs = zip(self.segments, begins, strict=True)
        pieces = tuple(segment.run(joint, zero, begin) for segment, begin in pairs)
        return SimulatedMotion(pieces, self.log.integrated)

    def linearised(
        self,
        names: Sequence[str],
        parameters: LumpedParameters,
        zero: float,
        velocity: float | None = None,
    ) -> tuple[Samples, Samples]:
        """Return (m,) errors and (m, n) derivatives by n parameters (see `Segment.linearised`).

        The effects of fitted starts are projected out.
        """
        if self.fitted:
            return self.with_starts(names, parameters, zero)[:2]
        columns = self._columns(names, parameters)
        return self.segments[0].linearised(columns, zero, self.given_start(velocity))

    def with_starts(
        self,
        names: Sequence[str],
        parameters: LumpedParameters,
        zero: float,
        velocity: float | None = None,
    ) -> tuple[Samples, Samples, tuple[Samples, ...]]:
        """Return what `linearised` does, and how each segment's start moves errors.

        The latter as (m, j) orthonormal directions.
        """
        if not self.fitted:
            more = tuple(dict.fromkeys((*names, *_START)))
            errors, rows = self.linearised(more, parameters, zero, velocity)
            by_start = self._by_start(rows[:, [more.index(each) for each in _START]])
            return errors, rows[:, : len(names)], (_orthonormal(by_start),)
        parts = []
        for each in self._expansions(names, parameters, zero, self._uncounted):
            rows = each.rows[:, : len(names)]
            take_away(each.directions, rows)
            parts.append((each.errors - each.directions @ each.explained, rows, each.directions))
        every, slopes, directions = zip(*parts, strict=True)
        return joined(every), joined(slopes), directions

    def averages(self, parameters: LumpedParameters) -> tuple[NDArray[np.int64], Samples, Samples]:
        """Return for (m,) errors samples averaged, middles of steps in s, and mean inputs."""
        joint = parameters.with_added_mass(self.log.added_mass)
        counted = self.segments[self._uncounted :]
        counts, middles, inputs = zip(*(each.averages(joint) for each in counted), strict=True)
        return joined(counts), joined(middles), joined(inputs)

    def _columns(self, names: Sequence[str], parameters: LumpedParameters) -> Columns:
        """Return the columns of the derivatives, as the kernel computes them."""
        looped = needs_loop(self.log)  # which has only the exact derivative by a base
        return Columns.of(names, parameters, self.log.added_mass, exact=looped)

    def _expansions(
        self, names: Sequence[str], parameters: LumpedParameters, zero: float, first: int
    ) -> Iterator[_Expansion]:
        """Yield the expansion of each segment about its best start, by names, then by the start."""
        by_start = self._columns(_START, parameters)
        different = tuple(dict.fromkeys((*names, *_START)))
        every = self._columns(different, parameters) if names else by_start
        for number in range(first, len(self.segments)):
            near = self._expanded(number, every, zero, self.begins[number])
            found = self._searched_from(near, number, by_start, zero)
            if found is near or every is by_start:
                yield found
            else:
                yield self._expanded(number, every, zero, found.begin)

    def _searched_from(
        self, at: _Expansion, number: int, by_start: Columns, zero: float
    ) -> _Expansion:
        """Return the expansion about the best start of a segment."""
        segment = self.segments[number]
        share, variance = 1.0, segment.log.rms_measured**2
        if not at.cost <= variance:  # the last search led astray, for what no joint has
            at = self._expanded(number, by_start, zero, segment.log.initial_state)
        for tries in range(MOST):
            hopeless = at.cost > variance or (self._warm and current_search().over)
            if at.settled or share < ROUNDING or (tries > _HOPEFUL and hopeless):
                break
            there = InitialState(*(np.array(at.begin) + share * at.step).tolist())
            tried = self._expanded(number, by_start, zero, there)
            if tried.cost < at.cost:
                at, share = tried, min(share / _SHORTER, 1.0)
            else:
                share *= _SHORTER
        if self._warm:
            self.begins[number] = at.begin
        return at

    def _expanded(
        self, number: int, columns: Columns, zero: float, begin: InitialState
    ) -> _Expansion:
        """Linearise a segment about a start, with the step of the start that reduces its errors.

        Of a segment that begins at rest only the angle there is fitted: friction holds a joint at
        rest, so that derivatives by its velocity do not exist, and its acceleration determines the
        inertia.
        """
        segment = self.segments[number]
        with np.errstate(over="ignore", invalid="ignore"):
            errors, rows = segment.linearised(columns, zero, begin)
            cost = float(np.mean(errors**2))
        units = np.array([1.0, self.log.rms_speed / (self.log.rms_motion or 1.0)])  # 1 and 1/s
        moves = self._by_start(rows[:, [columns.names.index(each) for each in _START]]) * units
        if not (np.isfinite(moves).all() and np.isfinite(errors).all()):
            none = np.zeros((errors.size, 0))
            return _Expansion(begin, errors, rows, cost, none, np.zeros(0), np.zeros(2))
        sought = 1 if segment.log.initial_state.velocity == 0 else len(_START)
        left, sizes, right = np.linalg.svd(moves[:, :sought], full_matrices=False)
        kept = sizes > SHOWS * sizes[0]
        explained = left[:, kept].T @ errors
        step = np.zeros(len(_START))
        step[:sought] = -(right[kept].T @ (explained / sizes[kept]))
        return _Expansion(begin, errors, rows, cost, left[:, kept], explained, step * units)

    def _by_start(self, rows: Samples) -> Samples:
        """Return (m, 2) derivatives by the true angle and the velocity at a start.

        The ``rows`` are (m, 2) derivatives by the zero and the velocity: a start moves angles by 1
        less what the zero does.
        """
        by_zero, by_velocity = rows.T
        return np.column_stack([1 - self.log.integrated - by_zero, by_velocity])


class _Expansion(NamedTuple):
    """A segment's errors and derivatives about a start (see `Segment.linearised`)."""

    begin: InitialState
    errors: Samples
    rows: Samples
    cost: float  # mean squared error in rad^2
    directions: Samples  # (m, j) orthonormal, in which the start moves the errors
    explained: Samples  # (j,) components of the errors along each
    step: Samples  # of angle in rad and velocity in rad/s, that removes these to first order

    @property
    def settled(self) -> bool:
        """Whether no other start makes the errors much smaller."""
        share = float(self.explained @ self.explained) / self.errors.size
        return share <= max(_SETTLED * self.cost, ROUNDING**2)


def segment_length(
    log: Log,
    parameters: LumpedParameters,
    horizon: float,
    *,
    first: int = 0,
    velocity_known: bool,
    free: bool = False,
) -> float | None:
    """Return the longest segment with fitted starts in s; None if the start is given.

    It is given if a log no longer than the horizon begins at rest, its beginning does not count,
    or its velocity there is known, and gravity or a servo's loop restores the joint. With ``free``,
    as in a fit, the start of one at rest is fitted too: it is known no better than noise allows.
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


def _orthonormal(columns: Samples) -> Samples:
    """Return (m, j) orthonormal columns that span (m, k) columns, negligible ones omitted."""
    sizes = np.linalg.norm(columns, axis=0)
    kept = sizes > ROUNDING * columns.shape[0] ** 0.5
    left, singular, _ = np.linalg.svd(columns[:, kept] / sizes[kept], full_matrices=False)
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
    hold.mean(time, time, time, log.between_samples)
    hold.for_sums(time, time, time, log.between_samples)
    polynomials.slope(time, 2, 2, 0.01)
    simulation.run(robot, 0.0).at(time)
