"""Search for the mistake that explains what is wrong with an identification, or with a refusal.

Every hypothesis is about the same equations, those of the weak form. A unit of the angle changes
its sine, one of arms or stamps the share of the added mass in inertia and gravity moment; another
mass, or a delay of one log, is one column more. So each is one linear fit. It is named where it
explains what the logs as they are do not, where no parameter that follows the added mass explains
more, and where the logs, identified again without it, are followed.

A joint that follows its input is driven by what is left to go. Averaged over test functions, in
units of the input,

    u = a th + p1' thdd + p2' thd + p3' sin th + p3_offset' cos th + friction' + bias',

where the primed values differ from log to log, as gain and mass do: a is 0 of a drive, for gravity
makes no linear spring, and 1 of a set-point, which no spring has by nature.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from butterfly.arrays import Samples
from butterfly.errors import ButterflyError, IdentifiabilityError
from butterfly.identification.blocks import CELLS, Condition
from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.findings import Finding
from butterfly.identification.diagnostics.plausibility import is_possible
from butterfly.identification.diagnostics.sensor_errors import roughness
from butterfly.identification.diagnostics.unit_errors import (
    HYPOTHESES,
    UnitError,
    unit_error,
    unit_errors_of_masses,
    unit_errors_of_omega,
)
from butterfly.identification.equations import CellEquations, Solution, scaled_least_squares
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators import Estimator, OutputError, WeakForm
from butterfly.identification.levels import CLEARLY, FEW, LOST, MATTERS, PRECISE
from butterfly.identification.problem import Start
from butterfly.identification.servo_drive import driven
from butterfly.identification.test_functions import Averaging
from butterfly.identification.weak_regression import About
from butterfly.logs.log import InputKind, Log
from butterfly.model.parameters import AddedMass
from butterfly.model.prior import NO_PRIOR, Known, Prior
from butterfly.model.terms import FrictionTerms, offered
from butterfly.progress import out_of_time
from butterfly.signals.spectrum import periodogram
from butterfly.verdict import Level

_AS_GOOD = 1.3  # times the least misfit, below which a mistake explains as much
_FITS = 4  # that are made at most
_SWINGS = (0.1, math.pi)  # rad, that the log of the largest swing may have
_SLOW = 0.05  # s from stamp to stamp, above which they may be no seconds

_NAMES = ("p1", "p2", "p3", "coulomb", "drag", "bias", "p4", "delay")
_OF_SETPOINT = ("p1", "p2", "p3", "p3_offset", "coulomb", "drag", "bias")
_ABOUT = About(names=_NAMES, known=NO_PRIOR, gain=1.0)
_NO_RIVALS = {Condition.WEIGHED, Condition.LOG}  # a mistake in one log differs from log to log
_FAILURES = (ButterflyError, np.linalg.LinAlgError, ArithmeticError)


def find_unit_errors(data: DataSet, estimator: Estimator, estimate: Estimate) -> list[Finding]:
    """Return the mistakes that explain what is wrong with an estimate; cheap where nothing is."""
    if of_omega := unit_errors_of_omega(data.logs, data.points):
        return of_omega
    misfits = 1 - data.simulations.fits(estimate) / 100
    # of each log, noise over motion by what neighbours have not in common
    angles = [log.measured for log in data.logs]
    noise = np.array([math.sqrt(roughness(each) / 6) / each.std() for each in angles])
    found: list[Finding] = []
    if estimate.level is Level.WARNING or not (misfits < CLEARLY * noise).all():
        found = _Search(data, estimator, estimate).findings()
    return found or unit_errors_of_masses(data.masses)


def find_unit_errors_of_refused(data: DataSet, estimator: Estimator) -> list[Finding]:
    """Return the mistakes but for which there would be an estimate."""
    return _Search(data, estimator).findings()


def find_unit_errors_of_clock(data: DataSet, estimator: Estimator) -> list[Finding]:
    """Return the mistake that makes stamps advance slowly, before they are simulated for ages."""
    steps = [log.mean_step for log in data.logs]
    return _Search(data, estimator, of_clock=True).findings() if np.median(steps) > _SLOW else []


def _turned(log: Log, factor: float) -> Log:
    """Return the log of an angle times a factor; a set-point that it follows is in its unit."""
    turned = replace(log, angle=factor * log.angle)
    if not log.closed or log.setpoint is None:
        return turned
    goal, kind = factor * log.setpoint, InputKind.SETPOINT
    return driven(replace(turned, input=goal, setpoint=None, lead=None, input_kind=kind))


_RIGHT: dict[str, Callable[[Log, float], Log]] = {
    "angle": _turned,
    "arm": lambda log, factor: replace(
        log, added_mass=replace(log.added_mass, arm=factor * log.added_mass.arm)
    ),
    "columns": lambda log, _: replace(log, input=log.angle, angle=log.input, lead=None),
    "delay": lambda log, early: replace(
        log, input=np.interp(log.time + early, log.time, log.input), lead=None
    ),
    "time": lambda log, factor: replace(log, time=factor * log.time, lead=None),
}
"""How a log is with a right column, by the number that makes it right."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Trial:
    """A hypothesis with a number, and the share of the torques that is left over without it."""

    error: UnitError
    number: float = 1.0  # factor; of a mass the right one in kg, of an input minus its delay in s
    misfit: float = math.inf
    log: str = ""  # name of the only one that it concerns
    wrong: AddedMass | None = None  # that is mistaken, if a mass is
    right: AddedMass | None = None  # instead of it

    def concerns(self, log: Log) -> bool:
        """Return whether the mistake is in a log."""
        return self.log in {"", log.name} and self.wrong in {None, log.added_mass}

    def undone(self, data: DataSet) -> DataSet:
        """Return the data set as it is without the mistake, held-out logs left out."""
        return replace(data, test_logs=None).corrected(self.right_log, self.finding())

    def right_log(self, log: Log) -> Log:
        """Return a log as it is without the mistake."""
        if not self.concerns(log):
            return log
        if self.right is not None:
            return replace(log, added_mass=self.right)
        return _RIGHT[HYPOTHESES[self.error].column](log, self.number)

    def finding(self, ways: int = 1, *, moves: bool = True) -> Finding:
        """Return the finding of the mistake, one of so many ways to explain masses."""
        masses = [str(self.wrong), str(1 if self.log else ways)] if self.wrong else []
        logs = (self.log,) if self.log else ()
        return unit_error(self.error, self.number, *masses, logs=logs, moves=moves)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Fit:
    """The weak form of some logs, fitted without bounds."""

    windows: tuple[Averaging, ...]  # of each log
    equations: CellEquations  # about the end, each log a cell
    misfit: float  # share of the torques that is left over; infinite where no joint has such a p1

    @classmethod
    def of(cls, windows: Sequence[Averaging], known: Mapping[str, float]) -> _Fit:
        """Return the fit of all of `_NAMES` but what is known."""
        regression = replace(_ABOUT, windows=windows, delay=known.get("delay", 0.0)).regression()
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

    def with_column(self, changes: Sequence[Sequence[float]], *names: str) -> tuple[float, float]:
        """Return the misfit, and the slope, if values change by a slope times (k, j) changes."""
        equations = self.equations
        direction = np.zeros((equations.log.size, len(_NAMES)))
        direction[:, [_NAMES.index(name) for name in names]] = np.array(changes)[equations.log]
        rest, parts = equations.apart(direction)
        information = float(parts.sum()) or math.inf
        slope = -float(np.sum(rest * equations.gradient)) / information
        explained = slope**2 * float(parts.sum() / equations.cost.sum())
        return self.misfit * math.sqrt(max(0.0, 1 - explained)), slope


def _windows_of(data: DataSet) -> list[Averaging]:
    """Return averages over a third of a period of motion; IdentifiabilityError if one is still."""
    windows = []
    for log in data.logs:
        if np.ptp(log.angle) == 0:
            raise IdentifiabilityError("the joint does not move in these logs")
        omegas, power = periodogram(log.angle - log.angle.mean(), log.mean_step)
        third = 2 * math.pi / (3 * omegas[np.argmax(power)])
        width = min(max(third, 12 * log.mean_step), (log.time[-1] - log.time[0]) / 20)
        windows.append(Averaging(log, data.zero_of(log), float(width), FrictionTerms()))
    return windows


@dataclass(frozen=True, eq=False)
class _Search:
    """A data set, how it is identified, and what came of that, if anything did."""

    data: DataSet
    estimator: Estimator
    estimate: Estimate | None = None
    of_clock: bool = False

    @np.errstate(all="ignore")
    def findings(self) -> list[Finding]:
        """Return the mistakes that explain what is wrong."""
        return self._of_table() or ([] if self.of_clock else self._set_point() or self._gain())

    def _of_table(self) -> list[Finding]:
        """Return what explains the logs clearly better than they are, and what does so as well."""
        none = self._here.misfit if not self.of_clock and self._here else math.inf
        tried = sorted(self._tried(), key=lambda each: each.misfit)
        held: list[tuple[_Trial, Estimate]] = []
        for each in [each for each in tried if each.misfit < LOST * none][:_FITS]:
            late = out_of_time("the search for wrong units and masses")
            if late or (held and each.misfit > _AS_GOOD * held[0][0].misfit):
                break
            if (found := self._without(each)) is not None:
                held.append((each, found))
        ways, before = sum(bool(each.wrong) and not each.log for each, _ in held), self.estimate
        return [
            each.finding(ways, moves=before is None or _moves(before, found))
            for each, found in held
        ]

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

    def _tried(self) -> Iterator[_Trial]:
        """Yield each hypothesis with the best of its factors, then those about some logs."""
        for error in HYPOTHESES:
            trials = [_Trial(error=error, number=each) for each in self._factors(error)]
            yield from sorted(map(self._fitted, trials), key=lambda each: each.misfit)[:1]
        if not self.of_clock and self._here and math.isfinite(self._here.misfit):
            yield from self._of_some_logs(self._here)

    def _factors(self, error: UnitError) -> Sequence[float]:
        """Return the factors that are tried, those of an angle if they make a likely swing."""
        logs, (column, _, factors) = self.data.logs, HYPOTHESES[error]
        angles = () if any(log.integrated for log in logs) else ("angle", "columns")
        if column not in ({"time"} if self.of_clock else {"arm", *angles}):
            return ()
        swing = max(float(np.ptp(log.angle)) / 2 for log in logs)
        least, most = _SWINGS
        match error:
            case UnitError.SWAPPED:
                doubted = self.estimate is None or self.estimate.level is Level.WARNING
                return factors if doubted else ()
            case UnitError.COUNTS:
                recorded = (log.angle for log in self.data.recorded)
                if swing <= most or not all((each == np.rint(each)).all() for each in recorded):
                    return ()
            case UnitError.GEAR:
                ratio = self.data.given.physical.get("gear_ratio")
                if ratio is not None:
                    factors = tuple({1 / ratio.value, ratio.value} - {1})
                elif swing <= most or not any(log.closed for log in logs):
                    return ()
        if column != "angle":
            return factors
        most = most if error in {UnitError.TURNS, UnitError.COUNTS} else math.inf
        return [each for each in factors if least < each * swing <= most]

    def _fitted(self, trial: _Trial) -> _Trial:
        """Return a trial with its misfit, which is infinite if there is no fit."""
        try:
            if HYPOTHESES[trial.error].column in {"arm", "mass"} and self._here:
                right = [trial.right_log(log).added_mass for log in self._thin.logs]
                pairs = zip(self._here.windows, right, strict=True)
                windows = [each.carrying(mass) for each, mass in pairs]
            else:
                windows = _windows_of(trial.undone(self._thin))
            return replace(trial, misfit=_Fit.of(windows, self._known).misfit)
        except _FAILURES:
            return trial

    def _of_some_logs(self, here: _Fit) -> Iterator[_Trial]:
        """Yield masses that are wrong, or those of one log, and inputs of one log that are late."""
        logs = self.data.logs
        given = [log.added_mass for log in logs]
        contrasts = self.estimate.agreement if self.estimate else ()
        shares = [each.share for each in contrasts if each.condition not in _NO_RIVALS]
        rival = min(
            *(here.with_column([(mass.mass,) for mass in given], name)[0] for name in _NAMES),
            here.misfit * math.sqrt(1 - max(shares, default=0.0)),
        )
        suspects = [(log.added_mass, log.name) for log in logs if given.count(log.added_mass) > 1]
        # to call one of two the same as the other explains everything
        if len({mass.inertia_and_moment for mass in given}) >= FEW:
            suspects += [(mass, "") for mass in self.data.masses if mass.mass]
        for mass, name in suspects:
            more = replace(
                mass, mass=mass.mass + 1, arm=mass.arm or max(each.arm for each in given)
            )
            change = more.inertia - mass.inertia, more.gravity_moment - mass.gravity_moment
            trial = _Trial(error=UnitError.MASS, log=name, wrong=mass)
            changes = [change if trial.concerns(log) else (0.0, 0.0) for log in logs]
            misfit, added = here.with_column(changes, "p1", "p3")
            if misfit < rival:
                right = replace(more, mass=max(mass.mass + added, 0.0))
                yield self._fitted(replace(trial, number=right.mass, right=right))
        for log in logs if len(logs) > 1 else ():
            trial = _Trial(error=UnitError.LATE, log=log.name)
            misfit, late = here.with_column([(trial.concerns(each),) for each in logs], "delay")
            if misfit < rival:
                yield replace(trial, number=-late, misfit=misfit)

    def _without(self, trial: _Trial) -> Estimate | None:
        """Return what is quickly identified without a mistake, if a joint then follows better."""
        try:
            undone = trial.undone(self.data)
            found = WeakForm()(undone)
        except _FAILURES:
            return None
        if not (np.isfinite(found.values).all() and is_possible(found, undone.masses)):
            return None
        alone = [k for k, log in enumerate(undone.logs) if log.name == trial.log]
        logs = alone or undone.counted
        before = 1.0 if self.estimate is None else _error(self.data, self.estimate, logs)
        return found if _error(undone, found, logs) < LOST * min(1.0, before) else None

    def _set_point(self) -> list[Finding]:
        """Return that the input is a set-point, if the joint follows it, and no drive explains it.

        The share a is then clearly not 0, and 1 as far as the logs tell, or within `PRECISE`.
        """
        data = self.data
        if self._here is None or any(log.closed or log.integrated for log in data.logs):
            return []
        if self.estimate and _error(data, self.estimate, data.counted) < PRECISE:
            return []
        parts = [each for each in map(_share_of_angle, self._here.windows) if each is not None]
        if not parts:
            return []
        cells = np.array(parts)  # (n, cells, 2)
        information, pull = cells.sum(axis=(0, 1))
        share = pull / information
        scores = cells @ [-share, 1.0]
        scatter = np.sum(scores**2), np.sum(scores.sum(axis=1) ** 2)  # of cells, and of whole logs
        error = CLEARLY * np.sqrt(max(scatter)) / information
        followed = error < share and abs(share - 1) < max(PRECISE, error)
        return [unit_error(UnitError.SETPOINT, 1.0)] if followed else []

    def _gain(self) -> list[Finding]:
        """Return the factor of the P gain of a loop, if another one halves the misfit at least."""
        data, estimator, before = self.data, self.estimator, self.estimate
        if before is None or "loop_kp" in before.names or not isinstance(estimator, OutputError):
            return []
        misfit = _error(data, before)
        if misfit < MATTERS or not any(log.closed for log in data.logs):
            return []
        known = data.known | Prior({"loop_kp": Known(value=1.0, uncertainty=math.inf)})
        free = replace(estimator, terms=tuple({*before.names} & {*offered(estimator.method)}))
        try:
            found = free.of_logs(data.logs, [Start.at(before, data)], known)
        except _FAILURES:
            return []
        factor = found.parameters.loop_kp
        if abs(factor - 1) > PRECISE and _error(data, found) < LOST * misfit:
            return [unit_error(UnitError.GAIN, factor, moves=_moves(before, found))]
        return []


def _share_of_angle(each: Averaging) -> Samples | None:
    """Return the (cells, 2) information on a, and its pull, of parts of a log; None if undriven."""
    names = ("spring", "p4", *_OF_SETPOINT)
    signals = each.signals(names)
    spring, drive, *others = (signals.mean[name][signals.moving] for name in names)
    if spring.size <= len(names) or not drive.any():
        return None
    columns = np.column_stack(others)
    columns /= np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
    basis = np.linalg.qr(columns)[0]
    angle, inputs = (rest - basis @ (basis.T @ rest) for rest in (spring, -drive))
    left = inputs - angle * (angle @ inputs) / (angle @ angle)
    variance = float(left @ left) / (left.size - len(names) + 1)
    cells = zip(*(np.array_split(each, CELLS) for each in (angle, inputs)), strict=True)
    return np.array([(part @ part, part @ goal) for part, goal in cells]) / variance


def _error(data: DataSet, estimate: Estimate, logs: Sequence[int] | None = None) -> float:
    """Return the median error of free runs of all logs, or some, over the motion."""
    return 1 - float(np.median(data.simulations.fits(estimate, logs))) / 100


def _moves(before: Estimate, found: Estimate) -> bool:
    """Return whether p1 to p4 move by more than their intervals, and than counts as known."""
    then = dict(zip(found.names, found.values, strict=True))
    rows = zip(before.names, before.values, before.lower, before.upper, strict=True)
    return any(
        abs(then[name] - value) > max((upper - lower) / 2, PRECISE * abs(value))
        for name, value, lower, upper in rows
        if name in {"p1", "p2", "p3", "p4"} & then.keys()
    )
