"""A log simulated with the recorded input, as one segment or several: run and linearised.

A log is one segment from a given start, or one or more from starts that are fitted (multiple
shooting). Where small errors grow, as about the upright, no simulation stays near a log for long,
but each of many short ones does (see `segment_starts`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import Samples, joined
from butterfly.identification.inference.blocks import edges_of
from butterfly.identification.levels import MOST, ROUNDING
from butterfly.identification.segment_starts import SegmentStarts, StartEffects
from butterfly.identification.segments import LONGEST_STEP, Segments, Starts
from butterfly.identification.servo_drive import needs_loop
from butterfly.logs.log import InitialState, Log
from butterfly.model.greybox import Columns
from butterfly.model.parameters import LumpedParameters
from butterfly.progress import current_search
from butterfly.signals import hold, polynomials

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
        return joined([polynomials.interpolate(*piece, some, self.slopes) for piece, some in pairs])


class Averages(NamedTuple):
    """What m errors are averages of."""

    counts: NDArray[np.int64]  # (m,) numbers of samples
    roots: Samples  # (m,) weights of errors (see `Segments.roots`)
    middles: Samples  # (m,) of steps in s
    inputs: Samples  # (m,) mean delivered inputs


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
            states = [log.piece(*each).initial_state for each in ends]
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
            begins = self._about_best_starts((), parameters, zero)[2].begins
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
        if self.fitted or ("delay" in names and self.given_start(velocity).velocity):
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
        if not self.fitted:
            start = self.given_start(velocity)
            columns = self._columns(tuple(dict.fromkeys((*names, *_START))), parameters)
            errors, rows = self.segments.linearised(columns, zero, np.array([start]))
            by_start = self._by_start(
                rows[:, [columns.names.index(each) for each in _START]],
                self.segments.roots(columns.joint),
            )
            if "delay" in names:  # which moves the grid's begin, where a given start is not
                rows[:, columns.names.index("delay")] += (
                    self.segments.moved * start.velocity * by_start[:, 0]
                )
            bounds = np.array([0, errors.size])
            return errors, rows[:, : len(names)], StartEffects(_orthonormal(by_start), bounds)
        errors, rows, found = self._about_best_starts(names, parameters, zero)
        joint = parameters.with_added_mass(self.log.added_mass)
        bounds = self.segments.bounds(joint)[self._uncounted :]
        errors, rows = errors[bounds[0] :], rows[bounds[0] :, : len(names)]
        directions = found.effects.directions[bounds[0] :]
        effects = StartEffects(directions, bounds - bounds[0])
        effects.take_away(errors)
        effects.take_away(rows)
        return errors, rows, effects

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

    def _about_best_starts(
        self, names: Sequence[str], parameters: LumpedParameters, zero: float
    ) -> tuple[Samples, Samples, SegmentStarts]:
        """Return (m,) errors and (m, n) derivatives of all segments, and their best starts.

        The derivatives are by names, then by the starts.
        """
        by_start = self._columns(_START, parameters)
        every = by_start
        if names:
            every = self._columns(tuple(dict.fromkeys((*names, *_START))), parameters)
        whole = np.arange(len(self.begins))
        _, _, at = self._expanded(by_start, zero, self.begins, whole)
        # where the last search led astray, for what no joint has
        if (astray := np.flatnonzero(~(at.cost <= self.log.rms_measured**2))).size:
            at.replace(astray, self._expanded(by_start, zero, self.recorded[astray], astray)[2])
        begins = at.begins + np.where(at.settled[:, np.newaxis], 0.0, at.step)
        errors, rows, tried = self._expanded(every, zero, begins, whole)
        at.take(whole, tried)
        self._search(at, by_start, zero)
        if (moved := np.flatnonzero((at.begins != begins).any(axis=1))).size:
            kept = self.segments.errors_of(moved, every.joint)
            errors[kept], rows[kept], _ = self._expanded(every, zero, at.begins[moved], moved)
            tried = self._assessed(errors, rows, every, at.begins, whole)
        if self._warm:
            self.begins = at.begins
        return errors, rows, tried

    def _search(self, at: SegmentStarts, by_start: Columns, zero: float) -> None:
        """Improve starts that are not the best yet."""
        for tries in range(1, MOST):
            going = ~at.settled & (at.share >= ROUNDING)
            if tries > _HOPEFUL:
                hopeless = self._warm and current_search().over
                going &= (at.cost <= self.log.rms_measured**2) & (not hopeless)
            if not (some := np.flatnonzero(going)).size:
                break
            there = at.begins[some] + at.share[some, np.newaxis] * at.step[some]
            at.take(some, self._expanded(by_start, zero, there, some)[2])

    def _expanded(
        self, columns: Columns, zero: float, begins: Starts, some: NDArray[np.intp]
    ) -> tuple[Samples, Samples, SegmentStarts]:
        """Linearise some segments about their starts, and assess these."""
        with np.errstate(over="ignore", invalid="ignore"):
            errors, rows = self.segments.linearised(columns, zero, begins, some)
        return errors, rows, self._assessed(errors, rows, columns, begins, some)

    @np.errstate(over="ignore", invalid="ignore")
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
            self._by_start(rows[:, [columns.names.index(each) for each in _START]], roots),
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
