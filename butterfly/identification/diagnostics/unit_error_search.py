"""Look for the mistake that explains what is wrong with an identification, or with its refusal.

Every mistake is a hypothesis about the same equations, those of the weak form. A unit of the angle
changes its sine, one of arms or stamps what an added mass is beside the joint's own inertia and
gravity moment; another mass, or a delay of one log, is one column more. So each is one linear fit.
It is named where it explains what the logs as they are do not, where no parameter that follows the
added mass explains more, and where the logs, identified again without it, are followed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import Samples
from butterfly.errors import ButterflyError, IdentifiabilityError
from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.findings import Finding
from butterfly.identification.diagnostics.plausibility import LEAST_FIT, is_possible
from butterfly.identification.diagnostics.unit_errors import (
    COUNTS,
    TABLE,
    UnitError,
    unit_error,
    unit_errors_of_masses,
    unit_errors_of_omega,
)
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators import Estimator, HarmonicBalance, WeakForm
from butterfly.identification.inference.conditions import Condition
from butterfly.identification.levels import CLEARLY, FEW, LOST, PRECISE, ROUNDING
from butterfly.identification.test_functions import Averaging
from butterfly.logs.log import Log
from butterfly.logs.thinning import GLANCE, thinned
from butterfly.model.parameters import AddedMass
from butterfly.model.terms import FrictionTerms
from butterfly.signals.frequency_response import response_point
from butterfly.signals.spectrum import periodogram
from butterfly.verdict import Level

_AS_GOOD = 1.3  # times the least misfit, below which a mistake explains as much
_FITS = 4  # that are made at most
_SWINGS = (0.1, math.pi)  # rad, that the widest log may have
_SLOW = 0.05  # s from stamp to stamp, above which they may be no seconds

_NAMES = ("p1", "p2", "p3", "coulomb", "drag", "bias", "p4", "delay")
_NO_RIVALS = {Condition.WEIGHED, Condition.LOG}  # a log's own mistake differs from log to log
_FAILURES = (ButterflyError, np.linalg.LinAlgError, ArithmeticError)


def find_unit_errors(data: DataSet, estimator: Estimator, estimate: Estimate) -> list[Finding]:
    """Name the mistakes that explain what speaks against an estimate; cheap where nothing does.

    The estimate has all other findings on it.
    """
    if of_omega := unit_errors_of_omega(data.logs, data.points):
        return of_omega
    misfits = 1 - data.simulations.fits(estimate) / 100
    found: list[Finding] = []
    if estimate.level is Level.WARNING or not (misfits < CLEARLY * _noise(data)).all():
        found = _Search(data, estimator, estimate).named()
    return found or unit_errors_of_masses(data.masses)


def find_unit_errors_of_refused(data: DataSet, estimator: Estimator) -> list[Finding]:
    """Name the mistakes but for which there would be an estimate."""
    return _Search(data, estimator).named()


def find_unit_errors_of_clock(data: DataSet, estimator: Estimator) -> list[Finding]:
    """Name the mistake that makes stamps advance slowly, before they are simulated for ages."""
    steps = [log.mean_step for log in data.logs]
    return _Search(data, estimator, of_clock=True).named() if np.median(steps) > _SLOW else []


def _noise(data: DataSet) -> Samples:
    """(n,) noise of each log's angle over its motion, by what neighbours have not in common."""
    angles = [log.angle for log in data.logs]
    return np.array([np.sqrt(np.mean(np.diff(each, 2) ** 2) / 6) / each.std() for each in angles])


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
            case "angle" | UnitError.COUNTS:
                return replace(log, angle=self.number * log.angle)
            case "arm":
                mass = log.added_mass
                return replace(log, added_mass=replace(mass, arm=self.number * mass.arm))
            case UnitError.SWAPPED:
                return replace(log, input=log.angle, angle=log.input, lead=None)
        delivered = np.interp(log.time + self.number, log.time, log.input)
        return replace(log, input=delivered, lead=None)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Equations:
    """The weak form of some logs: (m, n) of what `_NAMES` multiply, and (m,) numbers of logs."""

    columns: Samples
    log: NDArray[np.intp]
    masses: tuple[AddedMass, ...]  # that each log carried
    known: dict[str, float]  # parameters

    @classmethod
    def of(cls, data: DataSet) -> _Equations:
        """Average logs over test functions; IdentifiabilityError if an angle stands still."""
        if any(np.ptp(log.angle) == 0 for log in data.logs):
            raise IdentifiabilityError("a joint that does not move")
        parts = [_averages(log, data.zero_of(log)) for log in data.logs]
        return cls(
            columns=np.concatenate(parts),
            log=np.repeat(np.arange(len(parts)), [len(part) for part in parts]),
            masses=tuple(log.added_mass for log in data.logs),
            known={name: value for name, value in data.known.fixed.items() if name in _NAMES},
        )

    @cached_property
    def misfit(self) -> float:
        """Share of the torques that is left over; infinite where no joint has such an inertia."""
        _, torques, rest = self._solved
        size = math.hypot(*torques.values(), float(np.linalg.norm(self._target)))
        least = min(mass.inertia for mass in self.masses)
        possible = size > 0 and self.value("p1") + least > 0
        return float(np.linalg.norm(rest) / size) if possible else math.inf

    def value(self, name: str) -> float:
        """Return a parameter that fits best; 0 if nothing tells it."""
        torque, column = self._solved[1].get(name, 0.0), self.columns[:, _NAMES.index(name)]
        return self.known.get(name, torque / (float(np.linalg.norm(column)) or 1.0))

    def following(self, weights: Samples, *names: str) -> Samples:
        """(m,) sum of some columns, each times a weight by log: (k, n) for n names."""
        places = [_NAMES.index(name) for name in names]
        return np.asarray(np.sum(self.columns[:, places] * weights[self.log], axis=1))

    def beside(self, column: Samples) -> tuple[float, float]:
        """Return the misfit beside one column more, and its value."""
        basis, _, rest = self._solved
        own = column - basis @ (basis.T @ column)
        length = float(own @ own)
        if not length > ROUNDING * float(column @ column):
            return self.misfit, 0.0
        value = float(own @ rest) / length
        left = max(0.0, 1 - value**2 * length / float(rest @ rest))
        return self.misfit * math.sqrt(left), value

    @cached_property
    def _target(self) -> Samples:
        """(m,) torques of what is known, with the sign turned."""
        loads = np.array([[mass.inertia, mass.gravity_moment] for mass in self.masses])
        whole = self.following(loads, "p1", "p3")
        for name, value in self.known.items():
            whole = whole + value * self.columns[:, _NAMES.index(name)]
        return -whole

    @cached_property
    def _solved(self) -> tuple[Samples, dict[str, float], Samples]:
        """A basis of the columns, the torque of each by name, and what is left over."""
        sizes = np.linalg.norm(self.columns, axis=0)
        names = [n for n, size in zip(_NAMES, sizes, strict=True) if size and n not in self.known]
        places = [_NAMES.index(name) for name in names]
        basis, factor = np.linalg.qr(self.columns[:, places] / sizes[places])
        along = basis.T @ self._target
        torques = np.linalg.lstsq(factor, along)[0]
        return basis, dict(zip(names, torques.tolist(), strict=True)), self._target - basis @ along


def _averages(log: Log, zero: float) -> Samples:
    """(m, n) means of what `_NAMES` multiply in a log, the rms inertial term being 1/sqrt(m).

    The test functions are as wide as a third of a period of the motion, whatever the stamps' unit.
    """
    span = log.time[-1] - log.time[0]
    omegas, power = periodogram(log.angle - log.angle.mean(), log.mean_step)
    third = 2 * math.pi / (3 * omegas[np.argmax(power)])
    width = float(min(max(third, 12 * log.mean_step), span / 20))
    signals = Averaging(log, zero, width, FrictionTerms()).signals(_NAMES)
    means = np.column_stack([signals.mean[name] for name in _NAMES])[signals.moving]
    return np.asarray(means / (float(np.linalg.norm(means[:, 0])) or 1.0))


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
            if held and each.misfit > _AS_GOOD * held[0][0].misfit:
                break
            if (found := self._without(each)) is not None:
                held.append((each, found))
        ways = sum(each.place is not None and not each.alone for each, _ in held)
        return [self._finding(each, found, ways) for each, found in held]

    @cached_property
    def _here(self) -> _Equations | None:
        """The equations of the logs as they are, if there are any."""
        try:
            return _Equations.of(self._thin)
        except _FAILURES:
            return None

    @cached_property
    def _thin(self) -> DataSet:
        """The data set with as many samples as the equations need."""
        logs = tuple(thinned(log, GLANCE) for log in self.data.logs)
        return replace(self.data, logs=logs)

    def _tried(self) -> Iterator[_Mistake]:
        """Try what may have been mistaken."""
        widest = max(float(np.ptp(log.angle)) / 2 for log in self.data.logs)
        columns = {"time"} if self.of_clock else {"angle", "arm"}
        for error, unit in TABLE.items():
            swing = unit.factor * widest if unit.column == "angle" else _SWINGS[1] / 2
            if unit.column in columns and _SWINGS[0] < swing < max(_SWINGS[1], widest):
                yield self._fitted(error, unit.factor)
        if self.of_clock:
            return
        if self.estimate is None or self.estimate.level is Level.WARNING:
            yield self._fitted(UnitError.SWAPPED, 1.0)
        whole = all((log.angle == np.rint(log.angle)).all() for log in self.data.recorded)
        swings = {2 * math.pi / each: 2 * math.pi * widest / each for each in COUNTS}
        factors = [each for each, swing in swings.items() if _SWINGS[0] <= swing <= _SWINGS[1]]
        if widest > _SWINGS[1] and whole and factors:
            counts = (self._fitted(UnitError.COUNTS, each) for each in factors)
            yield min(counts, key=lambda each: each.misfit)
        if self._here and math.isfinite(self._here.misfit):
            yield from self._masses_and_logs(self._here)

    def _fitted(self, error: UnitError, number: float) -> _Mistake:
        """Return a mistake in all logs, and what is left over without it."""
        mistake = _Mistake(error=error, number=number)
        try:
            if error in TABLE and TABLE[error].column == "arm" and self._here:
                logs = mistake.logs_of(self._thin)
                equations = replace(self._here, masses=tuple(log.added_mass for log in logs))
            else:
                equations = _Equations.of(mistake.undone(self._thin))
            return replace(mistake, misfit=equations.misfit)
        except _FAILURES:
            return mistake

    def _masses_and_logs(self, here: _Equations) -> Iterator[_Mistake]:
        """Suppose that a mass is another, or that of one log, or that a log's input is late."""
        numbers, farthest = range(len(here.masses)), max(mass.arm for mass in here.masses)
        carried = np.array([[mass.mass] for mass in here.masses])
        rivals = [here.beside(here.following(carried, name))[0] for name in _NAMES]
        contrasts = self.estimate.agreement if self.estimate else ()
        shares = [each.share for each in contrasts if each.condition not in _NO_RIVALS]
        rival = min(*rivals, here.misfit * math.sqrt(1 - max(shares, default=0.0)))
        groups = {m: tuple(k for k in numbers if here.masses[k] == m) for m in self.data.masses}
        suspects: list[tuple[AddedMass, tuple[int, ...]]]
        suspects = [(m, (k,)) for m, own in groups.items() for k in own if len(own) > 1]
        # to call one of two the same as the other explains everything
        if len({mass.inertia_and_moment for mass in groups}) >= FEW:
            suspects += [(mass, own) for mass, own in groups.items() if mass.mass]
        for mass, own in suspects:
            more = replace(mass, mass=mass.mass + 1, arm=mass.arm or farthest)
            change = more.inertia - mass.inertia, more.gravity_moment - mass.gravity_moment
            weights = np.array([change if k in own else (0.0, 0.0) for k in numbers])
            misfit, value = here.beside(here.following(weights, "p1", "p3"))
            if misfit < rival:
                right = replace(more, mass=max(mass.mass + value, 0.0))
                masses = tuple(right if k in own else here.masses[k] for k in numbers)
                yield _Mistake(
                    error=UnitError.MASS,
                    number=right.mass,
                    misfit=replace(here, masses=masses).misfit,
                    logs=own,
                    place=more,
                    alone=own != groups[mass],
                )
        for k in numbers if here.value("p4") else ():
            misfit, value = here.beside(here.following(np.eye(len(numbers))[:, [k]], "delay"))
            if misfit < rival and len(numbers) > 1:
                late = value / here.value("p4")
                yield _Mistake(
                    error=UnitError.LATE, number=-late, misfit=misfit, logs=(k,), alone=True
                )

    def _without(self, mistake: _Mistake) -> Estimate | None:
        """Return what is quickly identified without a mistake, if a joint then follows better."""
        sines = all(log.excitation for log in self.data.logs)
        quick: Estimator = HarmonicBalance() if sines else WeakForm()
        if isinstance(self.estimator, HarmonicBalance | WeakForm):
            quick = self.estimator
        try:
            undone = mistake.undone(self.data)
            found = quick(undone)
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
