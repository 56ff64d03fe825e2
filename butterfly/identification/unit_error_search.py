"""Search for the mistake that explains what is wrong with an identification, or with a refusal.

Every hypothesis of the table is one weak-form fit of the logs as they would be without the mistake.
What the table leaves open, another mass or the delay of one log, is first scored: it is one column
more in the fit of the logs as they are, and has to explain more than any parameter that may follow
the added mass. A hypothesis is named if its fit leaves clearly less than that of the logs as they
are, and if a joint that is identified without the mistake follows.

A joint that follows a set-point is driven by what is left to go: the input less the angle.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

from butterfly.arrays import Samples
from butterfly.errors import ButterflyError, IdentifiabilityError
from butterfly.identification.agreement import Condition
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators import Estimator, OutputError, WeakForm
from butterfly.identification.linearisation import Linearisation, Solution
from butterfly.identification.physical import is_possible
from butterfly.identification.problem import Start
from butterfly.identification.residuals import residuals_of
from butterfly.identification.test_functions import HALF_WIDTH, Averaging
from butterfly.identification.trust import CLEARLY, FEW, Finding
from butterfly.identification.unit_errors import (
    RIGHT,
    SAME_FACTOR,
    UnitError,
    unit_error,
    unit_errors_of_masses,
    unit_errors_of_omegas,
)
from butterfly.identification.weak_regression import About
from butterfly.logs.log import Log
from butterfly.model.parameters import AddedMass
from butterfly.model.prior import NO_PRIOR, Known, Prior
from butterfly.model.terms import OF_ANGLE, PARAMETERS, PLAIN, FrictionTerms, offered
from butterfly.progress import out_of_time
from butterfly.signals.frequency_response import periodogram, white_variance
from butterfly.verdict import Level

_AS_GOOD = 1.3  # times the least misfit, below which a mistake explains as much
_CLEARLY_LESS = 0.5  # of a misfit, which a mistake that explains it leaves at most
_FOLLOWED = 0.01  # of the motion, an error below which no gain is looked for
_FITS = 4  # that are made at most
_SWINGS = (0.1, math.pi)  # rad, that the log of the largest swing may have
_SLOW = 0.05  # s from stamp to stamp, above which they may be no seconds

_NAMES = (*PARAMETERS, *(name for name in PLAIN if name not in OF_ANGLE))
_OF_ANGLE = {"angle", "columns", "input"}  # columns that are none of logs of velocities
_NO_RIVALS = {Condition.WEIGHED, Condition.LOG}  # a mistake in one log differs from log to log
_FAILURES = (ButterflyError, np.linalg.LinAlgError, ArithmeticError)


@np.errstate(all="ignore")
def find_unit_errors(
    data: DataSet, estimator: Estimator, estimate: Estimate | None = None
) -> list[Finding]:
    """Return the mistakes that explain a refusal, or else what is wrong with an estimate."""
    known = [(log, point) for log, point in zip(data.logs, data.points, strict=True) if point]
    ratios = np.array([1 + point.detuning for _, point in known])
    mistakes = unit_errors_of_omegas([log for log, _ in known], ratios)
    if not mistakes and (estimate is None or _is_doubtful(data, estimate)):
        search = _Search(data, estimate)
        mistakes = search.of_table() or search.of_gain(estimator)
    answered = "mass_scale" in data.known.values
    return mistakes or ([] if answered else unit_errors_of_masses(data.masses))


@np.errstate(all="ignore")
def find_slow_clock(data: DataSet) -> list[Finding]:
    """Return the unit of stamps that are too far apart to be simulated as seconds."""
    if np.median([log.mean_step for log in data.logs]) <= _SLOW:
        return []
    search = _Search(data)
    return search.named([search.best(error) for error in UnitError if error.column == "time"])


def _is_doubtful(data: DataSet, estimate: Estimate) -> bool:
    """Return whether a joint does not follow its logs, or leaves more than noise of one."""
    misfits = 1 - data.simulations.fits(estimate) / 100
    # of each log, noise over motion by what neighbours have not in common
    angles = [log.measured for log in data.logs]
    noise = np.array([math.sqrt(white_variance(angle)) / angle.std() for angle in angles])
    return estimate.level is Level.WARNING or not (misfits < CLEARLY * noise).all()


def _weighed(wrong: AddedMass, right: AddedMass, log: Log) -> Log:
    """Return the log with the right added mass, if it has the wrong one."""
    return replace(log, added_mass=right) if log.added_mass == wrong else log


class _Trial(NamedTuple):
    """A hypothesis with a number, and how well one weak-form fit without the mistake does."""

    error: UnitError
    number: float  # factor; of a mass the right one in kg, of an input minus its delay in s
    right: Callable[[Log], Log]  # returns a log as it is without the mistake
    log: str = ""  # name of the only one that it concerns
    mass: str = ""  # label of the mass that is mistaken
    unit: str = ""  # of a column with the wrong sign, if its log says one
    misfit: float = math.inf  # share of the torques that the fit leaves; infinite if there is none

    def righted(self, log: Log) -> Log:
        """Return a log as it is without the mistake."""
        return self.right(log) if self.log in {"", log.name} else log

    def undone(self, data: DataSet) -> DataSet:
        """Return the data set as it is without the mistake, held-out logs left out."""
        return replace(data, test_logs=None).corrected(self.righted, self.finding())

    def tried(self, data: DataSet) -> _Trial:
        """Return the trial with its misfit on a data set."""
        try:
            if self.error.column == "columns":  # the rest angle is not known either
                return self._replace(misfit=_Fit.of(self.undone(data)).misfit)
            scale = self.number if self.error.column == "angle" else 1.0
            zeros = [scale * data.zero_of(log) for log in data.logs]
            right = replace(data, logs=tuple(map(self.righted, data.logs)))
            return self._replace(misfit=_Fit.of(right, zeros).misfit)
        except _FAILURES:
            return self

    def finding(self, ways: int = 1, *, moves: bool = True) -> Finding:
        """Return the finding of the mistake, one of so many ways to explain masses."""
        more = [self.mass, str(1 if self.log else ways)] if self.mass else [self.unit]
        logs = [self.log] if self.log else []
        return unit_error(self.error, self.number, *filter(None, more), logs=logs, moves=moves)


class _Fit(NamedTuple):
    """The weak form of some logs."""

    equations: Linearisation  # about the end, each log a cell
    misfit: float  # share of the torques that is left over; infinite where no joint has such a p1

    @classmethod
    def of(cls, data: DataSet, zeros: Iterable[float] | None = None) -> _Fit:
        """Return the fit of all of `_NAMES` but what is known exactly, about (k,) zeros in rad.

        What alone sets the scale counts as known exactly.
        """
        known, (first, *others) = data.known.within(_NAMES), data.masses
        if not others and (scale := known.reference(first)):
            known = known.holding(scale)
        origins = map(data.zero_of, data.logs) if zeros is None else zeros
        windows = [_windows_of(*pair) for pair in zip(data.logs, origins, strict=True)]
        about = About(
            windows=windows,
            names=known.open(_NAMES),
            known=known,
            delay=known.fixed.get("delay", 0.0),
            gain=known.fixed.get("p4", 1.0),
            variance=0.0,
        )
        solved = about.regression().solve().values
        named = known.fixed | dict(zip(about.names, solved, strict=True))
        values, held = np.array([named[name] for name in _NAMES]), np.isin(_NAMES, [*known.fixed])
        regression = replace(about, names=_NAMES, known=NO_PRIOR).regression()
        equations = regression.linearised(Solution(values=values, on_bound=held))
        torques = np.linalg.norm(regression.rows, axis=0) * regression.unknowns(values)
        size = math.hypot(*torques, float(np.linalg.norm(regression.target)))
        possible = size > 0 and named["p1"] + min(window.added.inertia for window in windows) > 0
        return cls(
            equations, float(np.linalg.norm(equations.residuals)) / size if possible else math.inf
        )

    def score(self, changes: Mapping[str, Sequence[float] | Samples]) -> tuple[float, float]:
        """Return misfit and slope if values change by the slope times (k,) changes of logs."""
        direction = np.zeros((self.equations.log.size, len(_NAMES)))
        for name, change in changes.items():  # logs without windows have no cell
            direction[:, _NAMES.index(name)] = np.asarray(change)[self.equations.log]
        rest, parts = self.equations.orthogonalised(direction)
        information = float(parts.sum()) or math.inf
        slope = -float(np.sum(rest * self.equations.gradients)) / information
        explained = slope**2 * float(parts.sum() / self.equations.squares.sum())
        return self.misfit * math.sqrt(max(0.0, 1 - explained)), slope


def _windows_of(log: Log, zero: float) -> Averaging:
    """Return averages of a log over a third of its period of motion, about a zero in rad."""
    if np.ptp(log.angle) == 0:
        raise IdentifiabilityError("the joint does not move in these logs")
    omegas, power = periodogram(log.angle - log.angle.mean(), log.mean_step)
    third = 2 * math.pi / (3 * omegas[np.argmax(power)])
    width = min(max(third, 12 * log.mean_step), (log.time[-1] - log.time[0]) / 20)
    return Averaging(log, zero, float(width), FrictionTerms())


@dataclass(frozen=True, eq=False)
class _Search:
    """A data set, and what came of its identification, if anything did."""

    data: DataSet
    estimate: Estimate | None = None

    def of_table(self) -> list[Finding]:
        """Return what explains the logs clearly better than they are, and what does so as well."""
        trials, here = map(self.best, UnitError), self._here
        if here is None or not math.isfinite(here.misfit):
            return self.named(trials)
        return self.named([*trials, *self._scored(here)], _CLEARLY_LESS * here.misfit)

    def named(self, trials: Iterable[_Trial | None], bar: float = math.inf) -> list[Finding]:
        """Return the mistakes of least misfit, below a bar, without which a joint follows."""
        tried = sorted((trial for trial in trials if trial), key=lambda trial: trial.misfit)
        held: list[tuple[_Trial, Estimate]] = []
        for trial in [trial for trial in tried if trial.misfit < bar][:_FITS]:
            late = out_of_time("the search for wrong units and masses")
            if late or (held and trial.misfit > _AS_GOOD * held[0][0].misfit):
                break
            estimate = self._without(trial)
            if estimate is not None and (not trial.log or self._others_fit(trial.log)):
                held.append((trial, estimate))
        ways, before = sum(bool(trial.mass) and not trial.log for trial, _ in held), self.estimate
        return [
            trial.finding(ways, moves=before is None or _moves(before, estimate))
            for trial, estimate in held
        ]

    @cached_property
    def _here(self) -> _Fit | None:
        """The fit of the logs as they are, if there is any."""
        try:
            return _Fit.of(self._thin)
        except _FAILURES:
            return None

    @cached_property
    def _thin(self) -> DataSet:
        """The data set with as many samples as the equations need."""
        return replace(self.data, logs=self.data.glance)

    @cached_property
    def _some(self) -> DataSet:
        """Some of these logs, in which a mistake that all share shows too."""
        count = len(self._thin.logs)
        return self._thin.take(range(0, count, -(-count // (2 * FEW))))

    def best(self, error: UnitError) -> _Trial | None:
        """Return the trial of a hypothesis with the best of its factors, if it has any."""
        trials = [
            _Trial(error, factor, partial(RIGHT[error.column], factor)).tried(self._some)
            for factor in self._factors(error)
        ]
        best = min(trials, key=lambda trial: trial.misfit, default=None)
        if error is UnitError.SIGN and best is not None:
            read = self.data.recorded[0].reading.columns.get("input")
            return best._replace(unit=read.unit.removeprefix("-") if read else "")
        stiffer = error is UnitError.SETPOINT and best is not None and best.number != 1
        return None if stiffer else best  # a spring is no set-point

    def _factors(self, error: UnitError) -> Sequence[float]:
        """Return the factors that are tried, those of an angle if they make a likely swing."""
        logs, ratio = self.data.logs, self.data.given.physical.get("gear_ratio")
        swing, (least, most) = max(float(np.ptp(log.angle)) / 2 for log in logs), _SWINGS
        closed, before = any(log.closed for log in logs), self.estimate
        excluded = {
            UnitError.SWAPPED: before is not None and before.level is not Level.WARNING,
            UnitError.COUNTS: any((log.angle % 1).any() for log in self.data.recorded),
            UnitError.SETPOINT: closed,
            UnitError.SIGN: closed or "p4" not in self.data.known.parameters,  # else p4 takes it
            UnitError.GEAR: ratio is None and not (closed and swing > most),
        }
        blind = any(log.integrated for log in logs) and error.column in _OF_ANGLE
        if error.column not in RIGHT or excluded.get(error) or blind:
            return ()
        if error.column != "angle":
            return error.factors
        if error not in {UnitError.TURNS, UnitError.COUNTS}:
            most = math.inf
        factors = error.factors
        if ratio is not None and error is UnitError.GEAR:
            factors = tuple({1 / ratio.value, ratio.value} - {1})
        return [factor for factor in factors if least < factor * swing <= most]

    def _scored(self, here: _Fit) -> Iterator[_Trial]:
        """Yield other masses, in all logs or in one, and delays of one log that score best.

        They explain more than any parameter that follows the added mass.
        """
        logs = self.data.logs
        given = [log.added_mass for log in logs]
        contrasts = self.estimate.agreement if self.estimate else ()
        shares = [contrast.share for contrast in contrasts if contrast.condition not in _NO_RIVALS]
        rival = min(
            *(here.score({name: [mass.mass for mass in given]})[0] for name in _NAMES),
            here.misfit * math.sqrt(max(0.0, 1 - max(shares, default=0.0))),
        )
        suspects = [(log.added_mass, log.name) for log in logs if given.count(log.added_mass) > 1]
        # to call one of two the same as the other explains everything
        if len({mass.inertia_and_moment for mass in given}) >= FEW:
            suspects += [(mass, "") for mass in self.data.masses if mass.mass]
        for mass, name in suspects:
            more = replace(
                mass, mass=mass.mass + 1, arm=mass.arm or max(other.arm for other in given)
            )
            wrong = np.array([log.added_mass == mass and name in {"", log.name} for log in logs])
            inertia, moment = more.inertia - mass.inertia, more.gravity_moment - mass.gravity_moment
            misfit, added = here.score({"p1": inertia * wrong, "p3": moment * wrong})
            if misfit < min(rival, _CLEARLY_LESS * here.misfit):
                right = replace(more, mass=max(mass.mass + added, 0.0))
                change = partial(_weighed, mass, right)
                yield _Trial(UnitError.MASS, right.mass, change, name, str(mass)).tried(self._thin)
        for log in logs if len(logs) > 1 else ():
            misfit, late = here.score({"delay": [other is log for other in logs]})
            if misfit < rival:
                change = partial(RIGHT["delay"], -late)
                yield _Trial(UnitError.LATE, -late, change, log.name).tried(self._thin)

    def _without(self, trial: _Trial) -> Estimate | None:
        """Return what is quickly identified without a mistake, if a joint then follows better.

        In windows of the data's own time every unit of time fits.
        """
        width = HALF_WIDTH if trial.error.column == "time" else None
        try:
            undone = trial.undone(self.data)
            estimate = WeakForm(half_width=width)(undone)
        except _FAILURES:
            return None
        possible = np.isfinite(estimate.values).all() and is_possible(estimate, undone.masses)
        alone = [k for k, log in enumerate(undone.logs) if log.name == trial.log]
        return (
            estimate
            if possible and self._follows(undone, estimate, alone or undone.counted)
            else None
        )

    def _others_fit(self, name: str) -> bool:
        """Return whether the same terms leave no more than noise of the logs without one."""
        others = self.data.take([k for k, log in enumerate(self.data.logs) if log.name != name])
        before, usable = self.estimate, offered(OutputError.method)
        terms = None if before is None else tuple(n for n in before.names if n in usable)
        try:
            return not residuals_of(others, OutputError(terms=terms)(others)).beyond_sensors
        except _FAILURES:
            return False

    def _follows(self, data: DataSet, estimate: Estimate, logs: Sequence[int]) -> bool:
        """Return whether free runs of some logs leave clearly less of their motion than before."""
        before = 1.0 if self.estimate is None else _error(self.data, self.estimate, logs)
        return _error(data, estimate, logs) < _CLEARLY_LESS * min(1.0, before)

    def of_gain(self, estimator: Estimator) -> list[Finding]:
        """Return the factor of the P gain of a loop, if another one halves the misfit at least."""
        data, before = self.data, self.estimate
        if before is None or "loop_kp" in before.names or not isinstance(estimator, OutputError):
            return []
        if _error(data, before) < _FOLLOWED or not any(log.closed for log in data.logs):
            return []
        known = data.known | Prior({"loop_kp": Known(value=1.0, uncertainty=math.inf)})
        free = replace(estimator, terms=tuple({*before.names} & {*offered(estimator.method)}))
        try:
            estimate = free.of_logs(data.logs, [Start.at(before, data)], known)
        except _FAILURES:
            return []
        factor = estimate.parameters.loop_kp
        if abs(factor - 1) > SAME_FACTOR and self._follows(data, estimate, range(len(data.logs))):
            return [unit_error(UnitError.GAIN, factor, moves=_moves(before, estimate))]
        return []


def _error(data: DataSet, estimate: Estimate, logs: Sequence[int] | None = None) -> float:
    """Return the median error of free runs of all logs, or some, over the motion."""
    return 1 - float(np.median(data.simulations.fits(estimate, logs))) / 100


def _moves(before: Estimate, after: Estimate) -> bool:
    """Return whether p1 to p4 move by more than counts as known, and intervals that may be used."""
    if before.level is Level.WARNING:
        return True
    then = after.named
    rows = zip(before.names, before.values, before.lower, before.upper, strict=True)
    return any(
        abs(then[name] - value) > max((upper - lower) / 2, SAME_FACTOR * abs(value))
        for name, value, lower, upper in rows
        if name in {"p1", "p2", "p3", "p4"} & then.keys()
    )
