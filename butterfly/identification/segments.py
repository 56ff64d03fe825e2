"""A log simulated in segments, each from a start that is fitted to it (multiple shooting).

Where small causes grow, as about the upright, no simulation stays near a log for long, but each of
many short ones does: errors grow as in the linearised equation along the measured motion, friction
aside, which tells their horizon. The angle and velocity at which a segment starts belong to it
alone. What a change of them would take from the errors is taken from these and their derivatives:
the starts need no place among the parameters of a fit (variable projection: Golub & Pereyra,
Inverse Problems 19, 2003; Schittkowski, Numerical Data Fitting in Dynamical Systems, 2002).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import Samples, joined, take_away
from butterfly.identification.blocks import edges_of
from butterfly.identification.encoder_offset import reading_of
from butterfly.identification.levels import MOST, ROUNDING, SHOWS
from butterfly.identification.simulation import LONGEST_STEP, Begin, SimulatedMotion, Simulation
from butterfly.logs.log import InitialState, Log
from butterfly.model.parameters import AddedMass, LumpedParameters
from butterfly.progress import current_search
from butterfly.signals.spectrum import uniform_grid

_HOPEFUL = 2  # steps after which a model that is no better than a constant is given up
_SETTLED = 1e-4  # share of the squared errors that another start may still explain
_SHORTER = 0.25  # of a step that went too far
_START = ("zero", "velocity")

GROWTH = 30.0
"""Times by which an error at the start of a segment may grow within it."""

_EVERY = 5  # steps from one beginning to the next
# horizons, times powers of ten
_PREFERRED = np.array([1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0])


class Segments:
    """Simulates one log in segments with the recorded input; as `Simulation` in all that counts.

    They are no longer than the ``horizon`` in s; errors count from the sample numbered ``first``
    on, at which one begins. With ``warm`` each start is sought from the one found last, which is
    near in a descent, but depends on what was asked before; else from where the log begins.
    """

    def __init__(
        self,
        log: Log,
        parameters: LumpedParameters,
        horizon: float,
        first: int = 0,
        *,
        warm: bool = False,
    ) -> None:
        self.log = log
        horizon = math.inf if log.closed else horizon
        before, after = (
            edges_of(part, _count(part, horizon)) for part in np.split(log.time, [first])
        )
        edges = [*before, *(first + k for k in after)]
        ends = [*edges[1:], log.time.size]
        rate = log.rms_speed / (log.rms_motion or 1.0)
        self._segments = [
            _Segment(log.piece(begin, end), parameters, rate, warm=warm)
            for begin, end in zip(edges, ends, strict=True)
        ]
        self._counted = self._segments[len(before) :]

    @property
    def step(self) -> float:
        """Step of the simulation in s."""
        return self._counted[0].simulation.step

    def spend(self) -> int:
        """Return how many samples the next run simulates, and searches for starts did before it."""
        found = sum(each.spent + each.simulation.spend() for each in self._segments)
        for each in self._segments:
            each.spent = 0
        return found

    @property
    def begins(self) -> list[InitialState]:
        """Where the search for the start of each segment begins."""
        return [each.near for each in self._segments]

    @begins.setter
    def begins(self, states: Sequence[InitialState]) -> None:
        for each, own in zip(self._segments, states, strict=True):
            each.near = own

    def run(self, parameters: LumpedParameters, zero: float, _: Begin = None) -> SimulatedMotion:
        """Simulate the log (see `Simulation.run`), each segment from the start that fits best."""
        runs = [
            each.simulation.run(parameters, zero, each.begin(parameters, zero))
            for each in self._segments
        ]
        pieces = tuple(piece for run in runs for piece in run.pieces)
        return SimulatedMotion(pieces, self.log.integrated)

    def linearised(
        self, names: Sequence[str], parameters: LumpedParameters, zero: float, _: Begin = None
    ) -> tuple[Samples, Samples]:
        """Return errors and derivatives less what the starts explain (see `Simulation`)."""
        errors, rows, _directions = zip(
            *(each.expanded(names, parameters, zero) for each in self._counted), strict=True
        )
        return joined(errors), joined(rows)

    def directions(self, parameters: LumpedParameters, zero: float) -> tuple[Samples, ...]:
        """Return for each segment the (m, j) directions in which its start moves its errors."""
        return tuple(each.expanded((), parameters, zero)[2] for each in self._counted)

    @property
    def counts(self) -> NDArray[np.int64]:
        """(m,) samples over which `linearised` averages each error, one after the other."""
        return joined([each.simulation.counts for each in self._counted])

    def mean_inputs(self, parameters: LumpedParameters) -> Samples:
        """Return the (m,) means of the delivered input where `linearised` has errors."""
        return joined([each.simulation.mean_inputs(parameters) for each in self._counted])

    def middles(self) -> Samples:
        """Return the (m,) instants in s, middles of steps, for which `linearised` has errors."""
        return joined([each.simulation.middles() for each in self._counted])


class _About(NamedTuple):
    """A segment's errors and derivatives about a start (see `Simulation.linearised`)."""

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


class _Segment:
    """One segment, and where the search for its start begins.

    Of one that begins at rest only the angle there is sought: friction holds a joint at rest, so
    that nothing can be differentiated by its velocity, and how it starts tells of its inertia.
    """

    def __init__(self, log: Log, parameters: LumpedParameters, rate: float, *, warm: bool) -> None:
        self.simulation = Simulation(log, parameters)
        self._units = np.array([1.0, rate])
        self._warm, self.near = warm, log.initial_state
        self.spent = 0  # samples simulated to find its start
        self._spread = log.rms_measured**2
        self._sought = 1 if log.initial_state.velocity == 0 else len(_START)

    def expanded(
        self, names: Sequence[str], parameters: LumpedParameters, zero: float
    ) -> tuple[Samples, Samples, Samples]:
        """Return errors, derivatives and directions at the best start (see `_About`)."""
        every = tuple(dict.fromkeys((*names, *_START)))
        found = self._about(every, parameters, zero, self.near)
        if not found.settled:
            found = self._about(every, parameters, zero, self.begin(parameters, zero))
        directions, rows = found.directions, found.rows[:, : len(names)]
        errors = found.errors - directions @ found.explained
        take_away(directions, rows)
        return errors, rows, directions

    def begin(self, parameters: LumpedParameters, zero: float) -> InitialState:
        """Return the start from which a simulation follows the segment best."""
        begin = self.near
        at = self._about(_START, parameters, zero, begin)
        if not math.isfinite(at.cost):
            begin = self.simulation.log.initial_state
            at = self._about(_START, parameters, zero, begin)
        reach = 1.0
        for tries in range(MOST):
            hopeless = at.cost > self._spread or (self._warm and current_search().over)
            if at.settled or reach < ROUNDING or (tries > _HOPEFUL and hopeless):
                break
            there = InitialState(*(np.array(begin) + reach * at.step).tolist())
            tried = self._about(_START, parameters, zero, there)
            self.spent += self.simulation.spend()
            if tried.cost < at.cost:
                begin, at, reach = there, tried, min(reach / _SHORTER, 1.0)
            else:
                reach *= _SHORTER
        if self._warm:
            self.near = begin
        return begin

    def _about(
        self, names: Sequence[str], parameters: LumpedParameters, zero: float, begin: InitialState
    ) -> _About:
        """Differentiate by names and start, which moves angles by 1 less what the zero does."""
        with np.errstate(over="ignore", invalid="ignore"):
            expansion = self.simulation.linearised(names, parameters, zero, begin)
            errors, rows = expansion
            by_zero, by_velocity = rows[:, [names.index(each) for each in _START]].T
        lifted = 1 - self.simulation.log.integrated - by_zero
        columns = np.column_stack([lifted, by_velocity]) * self._units
        if not (np.isfinite(columns).all() and np.isfinite(errors).all()):
            return _About(*expansion, np.zeros((errors.size, 0)), np.zeros(0), np.zeros(2))
        left, sizes, right = np.linalg.svd(columns[:, : self._sought], full_matrices=False)
        felt = sizes > SHOWS * sizes[0]
        explained = left[:, felt].T @ errors
        step = np.zeros(len(_START))
        step[: self._sought] = -(right[felt].T @ (explained / sizes[felt]))
        step *= self._units
        return _About(*expansion, left[:, felt], explained, step)


def is_segmented(
    log: Log,
    parameters: LumpedParameters,
    horizon: float,
    *,
    first: int = 0,
    velocity_known: bool,
    free: bool = False,
) -> bool:
    """Whether a log is simulated in segments, or as a single one, whose start is fitted.

    A log no longer than the horizon is simulated whole if it begins at rest, its beginning does not
    count, or its velocity there is known, and gravity or a servo's loop brings the joint back. With
    ``free`` the start of one at rest is fitted too, as noise of its first sample is of weight.
    """
    loaded = parameters.with_added_mass(log.added_mass)
    begins_in_motion = first == 0 and log.initial_state.velocity != 0
    if log.closed and log.servo is not None:
        longer, doubtful = False, begins_in_motion or log.servo.of_speed
    else:
        longer = log.time[-1] - log.time[0] > horizon
        doubtful = loaded.p3 == 0 or begins_in_motion or (free and first == 0)
    return bool((longer or (doubtful and not velocity_known)) and loaded.p1 > 0)


def _count(time: Samples, horizon: float) -> int:
    """Return the fewest segments no longer than a horizon in s."""
    span = float(time[-1] - time[0]) if time.size else 0.0
    return max(math.ceil(span / horizon * (1 - 1e-9)), 1)


def horizon_of(
    logs: Iterable[Log], parameters: LumpedParameters, zeros: Mapping[AddedMass, float]
) -> float:
    """Return the longest time in s within which no small error grows by more than `GROWTH`.

    Rounded down, so that little depends on the parameters; infinite where none grows so.
    """
    free = [log for log in logs if not log.closed]
    found = min(
        (_horizon(log, parameters, reading_of(log, zeros)) for log in free), default=math.inf
    )
    if not math.isfinite(found):
        return math.inf
    decade = 10.0 ** math.floor(math.log10(found))
    fits = _PREFERRED[_PREFERRED * decade <= found * (1 + 1e-9)]
    return float(f"{fits[-1] * decade:.2g}")


def _horizon(log: Log, parameters: LumpedParameters, zero: float) -> float:
    loaded = parameters.with_added_mass(log.added_mass)
    if not (loaded.p1 > 0 and loaded.p3 > 0):
        return math.inf
    angle = log.angle - zero
    if max(angle.max(), -angle.min()) <= math.pi / 2 or np.cos(angle).min() >= 0:
        return math.inf  # gravity pulls back wherever the hand is
    grid = uniform_grid(log.time, LONGEST_STEP)
    falling = -loaded.p3 / loaded.p1 * np.cos(np.interp(grid, log.time, angle))
    damping = max(loaded.p2, 0.0) / loaded.p1
    steps = _soonest(falling, damping, math.sqrt(loaded.p1 / loaded.p3))
    return steps * LONGEST_STEP if steps else math.inf


def _soonest(falling: Samples, damping: float, slowest: float) -> int:
    """Fewest steps in which an error grows `GROWTH`-fold, from any beginning on; 0 if none does."""
    begins = np.arange(0, falling.size - 1, _EVERY)
    angle = np.repeat([[1.0], [0.0]], begins.size, axis=1)  # of errors of angle, and of velocity
    velocity = 1 - angle
    for count in range(1, falling.size):
        begins = begins[begins + count < falling.size]
        angle, velocity = angle[:, : begins.size], velocity[:, : begins.size]
        velocity += LONGEST_STEP * (falling[begins + count] * angle - damping * velocity)
        angle += LONGEST_STEP * velocity
        sizes = np.abs(angle) / [[1.0], [max(count * LONGEST_STEP, slowest)]]
        if sizes.max(initial=0.0) > GROWTH:
            return count
    return 0
