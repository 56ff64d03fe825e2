"""Look for the mistake that explains what is wrong with an identification, or with its refusal.

Every mistake is a hypothesis about the same equations, those of the weak form. A unit of the angle
changes its sine, one of arms or stamps what an added mass is beside the joint's own inertia and
gravity moment; another mass, or a delay of one log, is one column more. So each is one linear fit.
It is named where it explains what the logs as they are do not, where no parameter that follows the
added mass explains more, and where the logs, identified again without it, are followed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from butterfly.arrays import Samples
from butterfly.errors import ButterflyError, IdentifiabilityError
from butterfly.identification.blocks import Condition
from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.findings import Finding
from butterfly.identification.diagnostics.loop_errors import follows, with_free_gain
from butterfly.identification.diagnostics.plausibility import LEAST_FIT, is_possible
from butterfly.identification.diagnostics.sensor_errors import roughness
from butterfly.identification.diagnostics.unit_errors import (
    COUNTS,
    RATIOS,
    TABLE,
    UnitError,
    unit_error,
    unit_errors_of_masses,
    unit_errors_of_omega,
)
from butterfly.identification.equations import CellEquations, Solution, scaled_least_squares
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators import Estimator, WeakForm
from butterfly.identification.levels import CLEARLY, FEW, LOST, PRECISE
from butterfly.identification.servo_drive import driven
from butterfly.identification.test_functions import Averaging
from butterfly.identification.weak_regression import About, Windows
from butterfly.logs.log import InputKind, Log
from butterfly.model.parameters import AddedMass
from butterfly.model.prior import NO_PRIOR
from butterfly.model.terms import IDEAL, FrictionTerms
from butterfly.progress import out_of_time
from butterfly.signals.frequency_response import response_point
from butterfly.signals.spectrum import periodogram
from butterfly.verdict import Level

_AS_GOOD = 1.3  # times the least misfit, below which a mistake explains as much
_FITS = 4  # that are made at most
_SWINGS = (0.1, math.pi)  # rad, that the widest log may have
_SLOW = 0.05  # s from stamp to stamp, above which they may be no seconds

_NAMES = ("p1", "p2", "p3", "coulomb", "drag", "bias", "p4", "delay")
_ABOUT = About(
    names=_NAMES,
    known=NO_PRIOR,
    slow=FrictionTerms.stribeck_velocity,
    delay=0.0,
    drive=IDEAL,
    gain=1.0,
)
_NO_RIVALS = {Condition.WEIGHED, Condition.LOG}  # a log's own mistake differs from log to log
_FAILURES = (ButterflyError, np.linalg.LinAlgError, ArithmeticError)


def find_unit_errors(data: DataSet, estimator: Estimator, estimate: Estimate) -> list[Finding]:
    """Name the mistakes that explain what was found of an estimate; cheap where nothing was."""
    if of_omega := unit_errors_of_omega(data.logs, data.points):
        return of_omega
    misfits = 1 - data.simulations.fits(estimate) / 100
    found: list[Finding] = []
    if estimate.level is Level.WARNING or not (misfits < CLEARLY * _noise(data)).all():
        search = _Search(data, estimator, estimate)
        found = search.named() or search.set_point() or search.gain()
    return found or unit_errors_of_masses(data.masses)


def find_unit_errors_of_refused(data: DataSet, estimator: Estimator) -> list[Finding]:
    """Name the mistakes but for which there would be an estimate."""
    search = _Search(data, estimator)
    return search.named() or search.set_point()


def find_unit_errors_of_clock(data: DataSet, estimator: Estimator) -> list[Finding]:
    """Name the mistake that makes stamps advance slowly, before they are simulated for ages."""
    steps = [log.mean_step for log in data.logs]
    return _Search(data, estimator, of_clock=True).named() if np.median(steps) > _SLOW else []


def _noise(data: DataSet) -> Samples:
    """(n,) noise of each log over its motion, by what neighbours have not in common."""
    angles = [log.measured for log in data.logs]
    return np.array([math.sqrt(roughness(each) / 6) / each.std() for each in angles])


@dataclass(frozen=True, kw_only=True, eq=False)
class _Mistake:
    """A hypothesis, and the share of the torques that is left over without it."""

    error: UnitError
    number: float  # factor; of a mass the right one in kg, of an input its delay in s
    misfit: float = math.inf
    logs: tuple[int, ...] = ()  # numbers of those that it concerns; none of a unit
    place: AddedMass | None = None  # where the wrong mass is
    alone: bool = False  # whether it is in one log only

    def undone(self, data: DataSet) -> DataSet:
        """Return the data set as it is without the mistake."""
        logs = self.logs_of(data)
        points = [
            response_point(log) if point is not None and log is not old else point
            for log, old, point in zip(logs, data.logs, data.points, strict=True)
        ]
        return replace(data, logs=logs, points=tuple(points))

    def logs_of(self, data: DataSet) -> tuple[Log, ...]:
        """Return the logs of a data set as they are without the mistake."""
        numbers = self.logs or range(len(data.logs))
        return tuple(self._undone(log) if k in numbers else log for k, log in enumerate(data.logs))

    def _undone(self, log: Log) -> Log:
        if self.place is not None:
            return replace(log, added_mass=replace(self.place, mass=self.number))
        match TABLE[self.error].column if self.error in TABLE else self.error:
            case "time":
                return replace(log, time=self.number * log.time, lead=None)
            case "angle" | UnitError.COUNTS | UnitError.GEAR:
                return _turned(log, self.number)
            case "arm":
                mass = log.added_mass
                return replace(log, added_mass=replace(mass, arm=self.number * mass.arm))
            case UnitError.SWAPPED:
                return replace(log, input=log.angle, angle=log.input, lead=None)
        return replace(log, input=np.interp(log.time + self.number, log.time, log.input), lead=None)


def _turned(log: Log, factor: float) -> Log:
    """Return the log of an angle times a factor; a set-point that it follows is in its unit."""
    turned = replace(log, angle=factor * log.angle)
    if not log.closed or log.setpoint is None:
        return turned
    goal, kind = factor * log.setpoint, InputKind.SETPOINT
    return driven(replace(turned, input=goal, setpoint=None, lead=None, input_kind=kind))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Fit:
    """The weak form of some logs, fitted without bounds."""

    windows: tuple[Windows, ...]  # of each log
    equations: CellEquations  # about the end, each log a cell
    misfit: float  # share of the torques that is left over; infinite where no joint has such a p1

    @classmethod
    def of(cls, windows: Sequence[Windows], known: Mapping[str, float]) -> _Fit:
        """Fit all of `_NAMES` but what is known."""
        regression = replace(_ABOUT, delay=known.get("delay", 0.0)).regression(windows)
        held, rows = np.isin(_NAMES, [*known]), regression.rows
        found = np.array([0.0 if name == "delay" else known.get(name, 0.0) for name in _NAMES])
        left = regression.target - rows @ found
        found[~held] = scaled_least_squares(rows[:, ~held], left)
        torques = (found * np.linalg.norm(rows, axis=0))[~held]
        size = math.hypot(*torques, float(np.linalg.norm(left)))
        solution = Solution(values=regression.values(found), on_bound=held)
        equations = CellEquations.of(regression, solution)
        possible = size > 0 and found[0] + min(each.added.inertia for each in windows) > 0
        misfit = float(equations.cost.sum() ** 0.5 / size) if possible else math.inf
        return cls(windows=tuple(windows), equations=equations, misfit=misfit)

    def carrying(self, masses: Sequence[AddedMass]) -> list[Windows]:
        """Return the same logs with other masses."""
        return [each._replace(added=mass) for each, mass in zip(self.windows, masses, strict=True)]

    def beside(self, changes: Samples, *names: str) -> tuple[float, float]:
        """Return the misfit if values differ from log to log as a slope times (k, j) changes."""
        own = self.equations
        direction = np.zeros((own.log.size, len(_NAMES)))
        direction[:, [_NAMES.index(name) for name in names]] = changes[own.log]
        apart, parts = own.apart(direction)
        information = float(parts.sum()) or math.inf
        slope = -float(np.sum(apart * own.gradient)) / information
        explained = slope**2 * float(parts.sum() / own.cost.sum())
        return self.misfit * math.sqrt(max(0.0, 1 - explained)), slope


def _windows_of(data: DataSet) -> list[Windows]:
    """Average logs over a third of a period of motion; IdentifiabilityError if one is still."""
    windows = []
    for log in data.logs:
        if np.ptp(log.angle) == 0:
            raise IdentifiabilityError("the joint does not move in these logs")
        omegas, power = periodogram(log.angle - log.angle.mean(), log.mean_step)
        third = 2 * math.pi / (3 * omegas[np.argmax(power)])
        width = min(max(third, 12 * log.mean_step), (log.time[-1] - log.time[0]) / 20)
        averaging = Averaging(log, data.zero_of(log), float(width), FrictionTerms())
        windows.append(Windows(log.added_mass, averaging))
    return windows


@dataclass(frozen=True, eq=False)
class _Search:
    """A data set, how it is identified, and what came of that, if anything did."""

    data: DataSet
    estimator: Estimator
    estimate: Estimate | None = None
    of_clock: bool = False

    @np.errstate(all="ignore")
    def named(self) -> list[Finding]:
        """Return what explains the logs clearly better than they are, and what does so as well."""
        none = math.inf if self.of_clock else self._here.misfit if self._here else math.inf
        tried = sorted(self._tried(), key=lambda each: each.misfit)
        likely = [each for each in tried if each.misfit < LOST * none]
        held: list[tuple[_Mistake, Estimate]] = []
        for each in likely[:_FITS]:
            if out_of_time("the search for wrong units and masses"):
                break
            if held and each.misfit > _AS_GOOD * held[0][0].misfit:
                break
            if (found := self._without(each)) is not None:
                held.append((each, found))
        ways = sum(each.place is not None and not each.alone for each, _ in held)
        return [self._finding(each, found, ways) for each, found in held]

    @np.errstate(all="ignore")
    def set_point(self) -> list[Finding]:
        """Say so if the joint follows what was told as its drive, which does not explain it."""
        if any(log.closed or log.integrated for log in self.data.logs):
            return []
        if self.estimate is not None:
            fits = self.data.simulations.fits(self.estimate, self.data.counted)
            if np.median(fits) > 100 * (1 - PRECISE):
                return []
        try:
            followed = follows(_windows_of(self._thin))
        except _FAILURES:
            return []
        return [unit_error(UnitError.SETPOINT, 1.0)] if followed else []

    @np.errstate(all="ignore")
    def gain(self) -> list[Finding]:
        """Tell by which factor the P gain of a loop was told wrongly, if that explains the logs."""
        before = self.estimate
        found = None if before is None else with_free_gain(self.data, self.estimator, before)
        if before is None or found is None:
            return []
        return [unit_error(UnitError.GAIN, found.parameters.loop_kp, moves=_moves(before, found))]

    @cached_property
    def _here(self) -> _Fit | None:
        """The fit of the logs as they are, if there is any."""
        try:
            return _Fit.of(_windows_of(self._thin), self._known)
        except _FAILURES:
            return None

    @property
    def _known(self) -> dict[str, float]:
        return {name: value for name, value in self.data.known.fixed.items() if name in _NAMES}

    @cached_property
    def _thin(self) -> DataSet:
        """The data set with as many samples as the equations need."""
        return replace(self.data, logs=self.data.glance)

    def _tried(self) -> Iterator[_Mistake]:
        """Try what may have been mistaken."""
        widest = max(float(np.ptp(log.angle)) / 2 for log in self.data.logs)
        angles = not any(log.integrated for log in self.data.logs)
        columns = {"time"} if self.of_clock else {"angle", "arm"} if angles else {"arm"}
        for error, unit in TABLE.items():
            swing = unit.factor * widest if unit.column == "angle" else _SWINGS[1] / 2
            if unit.column in columns and _SWINGS[0] < swing < max(_SWINGS[1], widest):
                yield self._fitted(error, unit.factor)
        if self.of_clock:
            return
        if angles and (self.estimate is None or self.estimate.level is Level.WARNING):
            yield self._fitted(UnitError.SWAPPED, 1.0)
        whole = all((log.angle == np.rint(log.angle)).all() for log in self.data.recorded)
        swings = {2 * math.pi / each: 2 * math.pi * widest / each for each in COUNTS}
        factors = [each for each, swing in swings.items() if _SWINGS[0] <= swing <= _SWINGS[1]]
        if angles and widest > _SWINGS[1] and whole and factors:
            counts = (self._fitted(UnitError.COUNTS, each) for each in factors)
            yield min(counts, key=lambda each: each.misfit)
        if angles:
            yield from self._geared(widest)
        if self._here and math.isfinite(self._here.misfit):
            yield from self._masses_and_logs(self._here)

    def _geared(self, widest: float) -> Iterator[_Mistake]:
        """Suppose that a gear's ratio was forgotten, or taken off twice."""
        told = self.data.given.physical.get("gear_ratio")
        factors = [] if told is None else [1 / told.value, told.value]
        if told is None and widest > _SWINGS[1] and any(log.closed for log in self.data.logs):
            factors = [1 / ratio for ratio in RATIOS]
        factors = [each for each in factors if each != 1 and _SWINGS[0] < each * widest]
        found = (self._fitted(UnitError.GEAR, each) for each in factors)
        if (best := min(found, key=lambda each: each.misfit, default=None)) is not None:
            yield best

    def _fitted(self, error: UnitError, number: float) -> _Mistake:
        """Return a mistake in all logs, and what is left over without it."""
        mistake = _Mistake(error=error, number=number)
        try:
            if error in TABLE and TABLE[error].column == "arm" and self._here:
                masses = [log.added_mass for log in mistake.logs_of(self._thin)]
                windows = self._here.carrying(masses)
            else:
                windows = _windows_of(mistake.undone(self._thin))
            return replace(mistake, misfit=_Fit.of(windows, self._known).misfit)
        except _FAILURES:
            return mistake

    def _masses_and_logs(self, here: _Fit) -> Iterator[_Mistake]:
        """Suppose that a mass is another, or that of one log, or that a log's input is late."""
        given = [each.added for each in here.windows]
        numbers, farthest = range(len(given)), max(mass.arm for mass in given)
        carried = np.array([[mass.mass] for mass in given])
        rivals = [here.beside(carried, name)[0] for name in _NAMES]
        contrasts = self.estimate.agreement if self.estimate else ()
        shares = [each.share for each in contrasts if each.condition not in _NO_RIVALS]
        rival = min(*rivals, here.misfit * math.sqrt(1 - max(shares, default=0.0)))
        groups = {m: tuple(k for k in numbers if given[k] == m) for m in self.data.masses}
        suspects: list[tuple[AddedMass, tuple[int, ...]]]
        suspects = [(m, (k,)) for m, own in groups.items() for k in own if len(own) > 1]
        # to call one of two the same as the other explains everything
        if len({mass.inertia_and_moment for mass in groups}) >= FEW:
            suspects += [(mass, own) for mass, own in groups.items() if mass.mass]
        for mass, own in suspects:
            more = replace(mass, mass=mass.mass + 1, arm=mass.arm or farthest)
            change = more.inertia - mass.inertia, more.gravity_moment - mass.gravity_moment
            misfit, value = here.beside(np.outer(np.isin(numbers, own), change), "p1", "p3")
            if misfit < rival:
                right = replace(more, mass=max(mass.mass + value, 0.0))
                masses = [right if k in own else given[k] for k in numbers]
                yield _Mistake(
                    error=UnitError.MASS,
                    number=right.mass,
                    misfit=_Fit.of(here.carrying(masses), self._known).misfit,
                    logs=own,
                    place=more,
                    alone=own != groups[mass],
                )
        for k in numbers if len(numbers) > 1 else ():
            misfit, late = here.beside(np.eye(len(numbers))[:, [k]], "delay")
            if misfit < rival:
                yield _Mistake(
                    error=UnitError.LATE, number=-late, misfit=misfit, logs=(k,), alone=True
                )

    def _without(self, mistake: _Mistake) -> Estimate | None:
        """Return what is quickly identified without a mistake, if a joint then follows better."""
        try:
            undone = mistake.undone(self.data)
            found = WeakForm()(undone)
        except _FAILURES:
            return None
        if not (np.isfinite(found.values).all() and is_possible(found, undone.masses)):
            return None
        counted = mistake.logs if mistake.alone else undone.counted
        fit = float(np.median(undone.simulations.fits(found, counted)))
        least = LEAST_FIT
        if self.estimate is not None:
            before = float(np.median(self.data.simulations.fits(self.estimate, counted)))
            least = max(least, 100 - LOST * (100 - before))
        return found if fit > least else None

    def _finding(self, mistake: _Mistake, found: Estimate, ways: int) -> Finding:
        """Name a mistake; it is grave where values move by more than they are said to be known."""
        more = []
        if mistake.place is not None:
            given = self.data.logs[mistake.logs[0]].added_mass
            more = [str(given), str(1 if mistake.alone else ways)]
        grave = self.estimate is None or _moves(self.estimate, found)
        return unit_error(
            mistake.error,
            mistake.number,
            *more,
            logs=[self.data.logs[k] for k in mistake.logs] if mistake.alone else (),
            moves=grave,
        )


def _moves(before: Estimate, found: Estimate) -> bool:
    """Whether p1 to p4 move by more than their intervals, and than what counts as known."""
    then = dict(zip(found.names, found.values, strict=True))
    rows = zip(before.names, before.values, before.lower, before.upper, strict=True)
    return any(
        abs(then[name] - value) > max((upper - lower) / 2, PRECISE * abs(value))
        for name, value, lower, upper in rows
        if name in {"p1", "p2", "p3", "p4"} & then.keys()
    )
