"""A log simulated with the recorded input, as one segment or several: run and linearised.

A log is one segment from a given start, or one or more from starts that are fitted (multiple
shooting). Where small errors grow, as about the upright, no simulation stays near a log for long,
but each of many short ones does.

The effects of a segment's start are projected out of its errors and their derivatives, so that
fitted starts are no parameters of a fit (variable projection: Golub & Pereyra, Inverse Problems 19,
2003; Schittkowski, Numerical Data Fitting in Dynamical Systems, 2002). All segments of a log are
treated at once.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import ROUNDING, Samples, joined
from butterfly.identification.fit import MOST
from butterfly.identification.limits import edges_of
from butterfly.identification.segments import LONGEST_STEP, Segments, Starts, needs_loop
from butterfly.identification.trust import SHOWS
from butterfly.logs.initial_state import InitialState
from butterfly.logs.log import Log
from butterfly.model.greybox import Columns
from butterfly.model.parameters import LumpedParameters
from butterfly.progress import current_search
from butterfly.signals import hold

_SETTLED = 1e-4  # share of the squared errors that another start may still explain
_SHORTER = 0.25  # of a step that went too far
_HOPEFUL = 2  # steps after which a search is given up if the model is worse than a constant
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
        return joined([hold.interpolate(*piece, some, self.slopes) for piece, some in pairs])


class Averages(NamedTuple):
    """What m errors are averages of."""

    counts: NDArray[np.int64]  # (m,) numbers of samples
    roots: Samples  # (m,) weights of errors (see `Segments.roots`)
    middles: Samples  # (m,) of steps in s
    inputs: Samples  # (m,) mean delivered inputs


@dataclass(frozen=True, eq=False)
class StartEffects:
    """Directions in which the starts of s segments move m errors."""

    directions: Samples  # (m, j) orthonormal within each segment; 0 where one has fewer
    bounds: NDArray[np.int64]  # (s + 1,) numbers of the first error of each segment, and of all

    def take_away(self, rows: Samples) -> None:
        """Take from (m, ...) rows, in place, what other starts explain."""
        for column in rows.reshape(len(rows), -1).T:  # one at a time, which takes little memory
            for direction in self.directions.T:
                along = _spread(_sums(direction * column, self.bounds), self.bounds)
                np.subtract(column, direction * along, out=column)


@dataclass(eq=False)
class SegmentStarts:
    """Starts of s segments, how good they are, and how they are improved."""

    begins: Samples  # (s, 2) angle in rad from the encoder's zero, velocity in rad/s
    cost: Samples  # (s,) mean squared errors
    step: Samples  # (s, 2) to where these are least to first order
    settled: NDArray[np.bool_]  # (s,) whether no other start makes them much smaller
    effects: StartEffects
    share: Samples  # (s,) of the step that is tried next

    @classmethod
    def of(
        cls,
        begins: Samples,
        errors: Samples,
        moves: Samples,
        bounds: NDArray[np.int64],
        *,
        at_rest: NDArray[np.bool_],
        unit: float,
    ) -> SegmentStarts:
        """Assess starts by (m,) errors and their (m, 2) derivatives by angle and velocity.

        Of a segment that begins ``at_rest`` only the angle there is fitted: friction holds a joint
        at rest, so that derivatives by its velocity do not exist, and its acceleration determines
        the inertia. ``unit``: of velocities over that of angles, in 1/s.
        """
        a, b = moves[:, 0], unit * moves[:, 1]
        aa, ab, bb, squares = (_sums(x, bounds) for x in (a * a, a * b, b * b, errors**2))
        finite = np.isfinite(aa + ab + bb + squares)
        aa, ab, bb = (np.where(finite, x, 0.0) for x in (aa, ab, bb))
        # squared singular values of both columns, and the direction of the larger
        middle, half = (aa + bb) / 2, np.hypot((aa - bb) / 2, ab)
        largest = middle + half
        smallest = np.divide(aa * bb - ab**2, largest, out=np.zeros_like(aa), where=largest > 0)
        both = ~at_rest & (smallest > SHOWS**2 * largest)
        x, y = np.where(aa > bb, [largest - bb, ab], [ab, largest - aa])
        alone = at_rest | both
        x, y = np.where(alone, 1.0, x), np.where(alone, 0.0, y)
        size = np.hypot(x, y)
        x, y = (
            np.divide(component, size, out=np.zeros_like(x), where=size > 0) for component in (x, y)
        )
        first, length = _unit(a * _spread(x, bounds) + b * _spread(y, bounds), bounds, finite)
        along = _sums(first * b, bounds)
        second, rest = _unit(b - first * _spread(along, bounds), bounds, finite & both)
        explained = np.array([_sums(direction * errors, bounds) for direction in (first, second)])
        explained[:, ~finite] = 0.0
        across = -_over(explained[1], rest)
        forth = -_over(explained[0] + np.where(both, along, 0.0) * across, length)
        counts = np.maximum(np.diff(bounds), 1)
        cost = squares / counts
        gain = np.sum(explained**2, axis=0) / counts
        return cls(
            begins=begins.copy(),
            cost=cost,
            step=np.column_stack([x * forth, unit * (y * forth + across)]),
            settled=~finite | (gain <= np.maximum(_SETTLED * cost, ROUNDING**2)),
            effects=StartEffects(np.column_stack([first, second]), bounds),
            share=np.ones(len(begins)),
        )

    def replace(
        self,
        which: NDArray[np.intp],
        others: SegmentStarts,
        taken: NDArray[np.bool_] | None = None,
    ) -> None:
        """Take other starts in place of those numbered ``which``, or those of a mask alone."""
        mask = np.ones(which.size, dtype=bool) if taken is None else taken
        for name in ("begins", "cost", "step", "settled"):
            getattr(self, name)[which[mask]] = getattr(others, name)[mask]

    def take(self, which: NDArray[np.intp], tried: SegmentStarts) -> None:
        """Take those of tried starts in place of those numbered ``which`` that are better."""
        better = tried.cost < self.cost[which]
        self.share[which] *= np.where(better, 1 / _SHORTER, _SHORTER)
        np.minimum(self.share, 1.0, out=self.share)
        self.replace(which, tried, better)


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
            self.segments = Segments(log, parameters, first=first, longest=longest)
            states = [log.initial_state]
        else:
            before, after = (
                edges_of(part, _count(part, horizon)) for part in np.split(log.time, [first])
            )
            edges = [*before, *(first + k for k in after)]
            self.segments = Segments(log, parameters, edges=edges)
            self._uncounted = len(before)
            ends = pairwise([*edges, log.time.size])
            states = [log.piece(*pair).initial_state for pair in ends]
        self.recorded: Starts = np.array(states)
        """Start of each segment as its samples show it."""
        self.begins = self.recorded
        """The same, or where the search for it begins."""

    @property
    def step(self) -> float:
        """Mean step of the simulation in s."""
        return float(np.mean(np.diff(self.segments.grid)))

    def spend(self) -> int:
        """Return the number of steps of all simulations since the last call."""
        return self.segments.spend()

    def given_start(self, velocity: float | None) -> InitialState:
        """Return the start of a log that is one segment, with a velocity in rad/s if given."""
        if velocity is None:
            return InitialState(*self.begins[0].tolist())
        return InitialState(float(self.log.angle[0]), velocity)

    def run(
        self, parameters: LumpedParameters, zero: float, velocity: float | None = None
    ) -> SimulatedMotion:
        """Simulate the log, its added mass on the bare hand (78); ``zero`` is the encoder's."""
        begins = np.array([self.given_start(velocity)])
        if self.fitted:
            begins = self._about_best_starts((), parameters, zero)[3]
        joint = parameters.with_added_mass(self.log.added_mass)
        return SimulatedMotion(self.segments.run(joint, zero, begins), self.log.integrated)

    def linearised(
        self,
        names: Sequence[str],
        parameters: LumpedParameters,
        zero: float,
        velocity: float | None = None,
    ) -> tuple[Samples, Samples]:
        """Return (m,) errors and (m, n) derivatives by n parameters (see `Segments.linearised`).

        The effects of fitted starts are projected out.
        """
        if self.fitted:
            return self._about_best_starts(names, parameters, zero)[:2]
        if "delay" in names and self.given_start(velocity).velocity:
            return self.with_starts(names, parameters, zero, velocity)[:2]
        columns = self._columns(names, parameters)
        return self.segments.linearised(columns, zero, np.array([self.given_start(velocity)]))

    def with_starts(
        self,
        names: Sequence[str],
        parameters: LumpedParameters,
        zero: float,
        velocity: float | None = None,
    ) -> tuple[Samples, Samples, StartEffects]:
        """Return what `linearised` does, and how each segment's start moves errors."""
        if self.fitted:
            return self._about_best_starts(names, parameters, zero)[:3]
        start = self.given_start(velocity)
        columns = self._columns(tuple(dict.fromkeys((*names, *_START))), parameters)
        errors, rows = self.segments.linearised(columns, zero, np.array([start]))
        by_start = self._by_start(
            rows[:, [columns.names.index(name) for name in _START]],
            self.segments.roots(columns.joint),
        )
        if "delay" in names:  # which moves the grid's begin, where a given start is not
            rows[:, columns.names.index("delay")] += (
                self.segments.moved * start.velocity * by_start[:, 0]
            )
        bounds = np.array([0, errors.size])
        return errors, rows[:, : len(names)], StartEffects(_orthonormal(by_start), bounds)

    def averages(self, parameters: LumpedParameters) -> Averages:
        """Return what (m,) errors are averages of."""
        joint = parameters.with_added_mass(self.log.added_mass)
        first = self.segments.bounds(joint)[self._uncounted]
        counts, middles, inputs = self.segments.averages(joint)
        roots = self.segments.roots(joint)
        return Averages(counts[first:], roots[first:], middles[first:], inputs[first:])

    def _columns(self, names: Sequence[str], parameters: LumpedParameters) -> Columns:
        """Return the columns of the derivatives, as the kernel computes them."""
        looped = needs_loop(self.log)  # which has only the exact derivative by a base
        return Columns.of(names, parameters, self.log.added_mass, exact=looped)

    @np.errstate(over="ignore", invalid="ignore")
    def _about_best_starts(
        self, names: Sequence[str], parameters: LumpedParameters, zero: float
    ) -> tuple[Samples, Samples, StartEffects, Starts]:
        """Return what `with_starts` does about the best starts of all segments, and these."""
        by_start = self._columns(_START, parameters)
        every = by_start
        if names:
            every = self._columns(tuple(dict.fromkeys((*names, *_START))), parameters)
        whole, linearised = np.arange(len(self.begins)), self.segments.linearised
        at = self._assessed(*linearised(by_start, zero, self.begins), by_start, self.begins, whole)
        # where the last search led astray, for what no joint has
        if (astray := np.flatnonzero(~(at.cost <= self.log.rms_measured**2))).size:
            begins = self.recorded[astray]
            expansion = linearised(by_start, zero, begins, astray)
            at.replace(astray, self._assessed(*expansion, by_start, begins, astray))
        tried = at.begins + np.where(at.settled[:, np.newaxis], 0.0, at.step)
        errors, rows = linearised(every, zero, tried)
        about = self._assessed(errors, rows, every, tried, whole)
        at.take(whole, about)
        for tries in range(1, MOST):  # to improve those that are not the best yet
            going = ~at.settled & (at.share >= ROUNDING)
            if tries > _HOPEFUL:
                hopeless = self._warm and current_search().over
                going &= (at.cost <= self.log.rms_measured**2) & (not hopeless)
            if not (some := np.flatnonzero(going)).size:
                break
            begins = at.begins[some] + at.share[some, np.newaxis] * at.step[some]
            expansion = linearised(by_start, zero, begins, some)
            at.take(some, self._assessed(*expansion, by_start, begins, some))
        if (moved := np.flatnonzero((at.begins != tried).any(axis=1))).size:
            mask = self.segments.errors_of(moved, every.joint)
            errors[mask], rows[mask] = linearised(every, zero, at.begins[moved], moved)
            about = self._assessed(errors, rows, every, at.begins, whole)
        if self._warm:
            self.begins = at.begins
        bounds = self.segments.bounds(every.joint)[self._uncounted :]
        errors, rows = errors[bounds[0] :], rows[bounds[0] :, : len(names)]
        effects = StartEffects(about.effects.directions[bounds[0] :], bounds - bounds[0])
        effects.take_away(errors)
        effects.take_away(rows)
        return errors, rows, effects, at.begins

    def _assessed(
        self,
        errors: Samples,
        rows: Samples,
        columns: Columns,
        begins: Starts,
        some: NDArray[np.intp],
    ) -> SegmentStarts:
        """Assess the starts of some segments by the expansion about them."""
        roots = self.segments.roots(columns.joint)[self.segments.errors_of(some, columns.joint)]
        return SegmentStarts.of(
            begins,
            errors,
            self._by_start(rows[:, [columns.names.index(name) for name in _START]], roots),
            np.append(0, np.cumsum(np.diff(self.segments.bounds(columns.joint))[some])),
            at_rest=self.recorded[some, 1] == 0,
            unit=self.log.rms_speed / (self.log.rms_motion or 1.0),
        )

    def _by_start(self, rows: Samples, roots: Samples) -> Samples:
        """Return (m, 2) derivatives by the true angle and the velocity at a start.

        The ``rows`` are (m, 2) derivatives by the zero and the velocity: a start moves angles by 1,
        weighted by ``roots``, less what the zero does.
        """
        by_zero, by_velocity = rows.T
        return np.column_stack([(1 - self.log.integrated) * roots - by_zero, by_velocity])


def _sums(rows: Samples, bounds: NDArray[np.int64]) -> Samples:
    """(s, ...) sums of (m, ...) rows over segments, some of which may have none."""
    full = np.diff(bounds) > 0
    sums = np.zeros((full.size, *rows.shape[1:]))
    sums[full] = np.add.reduceat(rows, bounds[:-1][full], axis=0)
    return sums


def _spread(values: Samples, bounds: NDArray[np.int64]) -> Samples:
    """(m, ...) values of (s, ...) segments, each at all its errors."""
    return np.repeat(values, np.diff(bounds), axis=0)


def _unit(
    column: Samples, bounds: NDArray[np.int64], wanted: NDArray[np.bool_]
) -> tuple[Samples, Samples]:
    """Return an (m,) column of length 1 in each wanted segment, 0 in others, and (s,) lengths."""
    lengths = np.where(wanted, np.sqrt(_sums(column**2, bounds)), 0.0)
    scale = _over(np.ones_like(lengths), lengths)
    spread = _spread(scale, bounds)
    return np.where(spread > 0, column, 0.0) * spread, lengths


def _over(values: Samples, sizes: Samples) -> Samples:
    """(s,) values over sizes; 0 where these are 0."""
    return np.divide(values, sizes, out=np.zeros_like(values), where=sizes > 0)


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
    significant = sizes > ROUNDING * columns.shape[0] ** 0.5
    basis, singular, _ = np.linalg.svd(
        columns[:, significant] / sizes[significant], full_matrices=False
    )
    return np.asarray(basis[:, singular > ROUNDING * singular.max(initial=0.0)])


def rehearse() -> None:
    """Call what numba compiles of every identification; its cache on disk then has it.

    A fit of a moving base, or of a servo in its loop, compiles their equations when it comes to it.
    What a simulated experiment compiles itself comes last: by then that is on disk.
    """
    time = np.arange(0.0, 0.2, 0.01)
    robot = LumpedParameters(p1=1.0, p2=1.0, p3=1.0, p4=1.0)
    log = Log(time, time, time)
    simulation = Simulation(log, robot)
    simulation.linearised(("p1",), robot, 0.0)
    hold.mean(time, time, time, log.between_samples)
    hold.for_sums(time, time, time, log.between_samples)
    hold.slope(time, 2, 2, 0.01)
    simulation.run(robot, 0.0).at(time)
    simulation.linearised(("base_compliance",), robot, 0.0)
