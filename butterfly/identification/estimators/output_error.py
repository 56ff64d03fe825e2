"""Output error: the parameters whose free-run simulation follows all logs best, jointly.

Every log is simulated from its first sample with the recorded input alone; the difference to the
measured angle is averaged over each step of the simulation, divided by the log's own rms motion,
and its sum of squares minimised over the parameters that all logs share, and over those of one
added mass or of one log (Ljung, System Identification, 2nd ed. 1999, section 7.2).
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from typing import ClassVar, Literal

import numpy as np

from butterfly.arrays import Samples
from butterfly.errors import IdentifiabilityError, InputError, require_number
from butterfly.identification.chosen_terms import Fitted, offered_rows, separable, stagewise_fit
from butterfly.identification.data import DataSet
from butterfly.identification.estimators.base import Estimator, require_names, require_usable
from butterfly.identification.estimators.between_samples import (
    Begun,
    held_or_straight,
    unsaid,
)
from butterfly.identification.estimators.shorter_segments import over_shorter, shorter_segments
from butterfly.identification.estimators.start import (
    ProblemOf,
    begun_anew,
    hanging,
    lowest_end,
    servo_start,
    starts,
)
from butterfly.identification.findings import Finding, FindingKind
from butterfly.identification.fit import Loss
from butterfly.identification.free_run import first_horizon
from butterfly.identification.inference.blocks import Conditions, cells_of
from butterfly.identification.inference.estimate import Estimate
from butterfly.identification.inference.identifiability import is_driven, prior_of_fit
from butterfly.identification.inference.infer import SolvedFit, infer
from butterfly.identification.inference.linear_terms import candidates
from butterfly.identification.levels import FEW, ROUNDING, SHOWS
from butterfly.identification.problem import LOCAL, Key, Problem, ProblemOptions, Start
from butterfly.identification.twin_terms import TwinTerm, spoken_for, twin_terms
from butterfly.identification.weighed_logs import (
    WeighedLogs,
    stagewise_weighed,
    weighed_end,
    weighed_from,
)
from butterfly.logs.log import Log, slow_interval
from butterfly.model.parameters import AddedMass, require_periods
from butterfly.model.prior import NO_PRIOR, Prior
from butterfly.model.terms import OF_ANGLE, OF_SERVO, PARAMETERS, RARE, companions, offered
from butterfly.progress import out_of_time
from butterfly.signals.frequency_response import STEADY_SECONDS


@dataclass(frozen=True, kw_only=True)
class OutputError(Estimator):
    """Fit the parameters so that free-run simulations match all logs best.

    Needs at least two different added masses (none counts as one), or enough known values. Logs
    whose friction or gain differ are weighted by these random effects. The covariance is
    cluster-robust over logs; the intervals also hold the leave-one-mass-out estimates, and rival
    models that predict as well.

    Parameters
    ----------
    terms
        Terms fitted besides p1..p4, coulomb and delay, the others keeping their initial values; if
        not given, those that improve the prediction of held-out logs. Stribeck friction includes
        its velocity.
    fixed
        Parameters held at their initial values.
    per_mass
        Fitted separately for each added mass: zero (of the encoder), bias, velocity (initial).
    per_log
        Fitted separately for each log. Without either, all logs share the encoder's zero.
    window
        Length in s at the end of each sine log that is fitted, as a start from rest depends on how
        the joint came to rest. Other logs are fitted from their start.
    horizon
        Longest segment in s that is simulated at once; 0 for whole logs. If not given, whole logs,
        unless nothing holds the joint and no run of whole logs stays near: then its own time. The
        initial state of each segment is fitted.
    loss
        Loss of the residuals: linear, or robust with soft_l1, huber or cauchy.
    cogging_periods
        Periods of the cogging torque per turn; must be known. One period would be the same as p3.
    servo_loop
        How servo logs are simulated: closed, in the servo's loop from the set-point, or open, from
        the recorded or reconstructed drive alone.
    workers
        Number of threads; 0 for one per core.
    """

    method: Literal["output-error"] = "output-error"
    terms: tuple[str, ...] | None = None
    fixed: tuple[str, ...] = ()
    per_mass: tuple[str, ...] = ()
    per_log: tuple[str, ...] = ()
    window: float = STEADY_SECONDS
    horizon: float | None = None
    loss: Loss = Loss.LINEAR
    cogging_periods: float = 1.0
    servo_loop: Literal["closed", "open"] = "closed"
    workers: int = 0

    summary: ClassVar[str] = "nonlinear fit of free-run simulations, for any input"

    def __post_init__(self) -> None:
        known = offered(self.method)
        require_names(self.method, "terms", self.terms or (), known)
        require_names(self.method, "fixed", self.fixed, (*PARAMETERS, *known))
        require_names(self.method, "per_mass", self.per_mass, LOCAL)
        require_names(self.method, "per_log", self.per_log, LOCAL)
        require_number(self.method, positive=True, unit="s", window=self.window)
        if self.horizon is not None and self.horizon != math.inf:
            require_number(self.method, unit="s", horizon=self.horizon)
        require_periods(self.method, self.cogging_periods)
        require_names(self.method, "servo_loop", (self.servo_loop,), ("closed", "open"))
        if self.workers < 0:
            raise InputError(self.method, "workers", self.workers, "0 or more")

    def __call__(self, data: DataSet) -> Estimate:
        """Fit from the closed form's estimate on that is nearest (see `Estimator`)."""
        return self._of_calm(data, starts(data, self.terms))

    def near(self, found: Estimate) -> Callable[[DataSet], Estimate]:
        """Return the estimator, its descent begun at an estimate."""
        return lambda data: self._of_calm(data, [Start.at(found, data)])

    def path(self, data: DataSet, offers: tuple[str, ...]) -> tuple[tuple[str, ...], ...]:
        """Return the terms after each round of a stagewise choice from some offers."""
        self.with_terms(offers)
        rows = candidates(offers, [log.added_mass for log in data.logs], data.known)
        first = starts(data, ())
        offering, logs = self.with_terms(rows), self.taken(data.logs)
        known = prior_of_fit(logs, data.known)
        rare = {*RARE} - {*(OF_SERVO if any(log.closed for log in logs) else ())}
        return offering.chosen(logs, first, known, (rows, rare))[0].path or ((),)

    def _of_calm(self, data: DataSet, first: Sequence[Start]) -> Estimate:
        """Fit the logs that initial errors do not drive apart, where there are enough of them."""
        asked = {*(self.terms or ()), *self.per_mass, *self.per_log}
        data.require_angles(*asked & {*OF_ANGLE, "zero"})
        calm = data.take(data.counted)
        few = len(calm.masses) <= 1 or len(calm.logs) <= FEW  # to stand for all
        if few or len(calm.logs) == len(data.logs):
            return self.of_logs(data.logs, first, data.known)
        lost = {log.name for log in data.logs} - {log.name for log in calm.logs}
        left_out = Finding(FindingKind.UNPREDICTABLE, logs=tuple(sorted(lost)))
        return self.of_logs(calm.logs, first, data.known).with_findings(left_out)

    def taken(self, logs: Sequence[Log]) -> Sequence[Log]:
        """Return logs as they are simulated."""
        return [log.opened for log in logs] if self.servo_loop == "open" else logs

    def of_logs(
        self, logs: Sequence[Log], first: Sequence[Start], known: Prior = NO_PRIOR
    ) -> Estimate:
        """Fit the free-run simulation of all logs jointly, from one or more first guesses."""
        require_usable(self.method, known)
        self._require_known_once(known)
        logs = self.taken(logs)
        known = prior_of_fit(logs, known)
        rows, rare = self._rows(logs, known) if self.terms is None else ((), set[str]())
        while True:
            fitted, weighed = self.chosen(logs, first, known, (rows, rare))
            try:
                found = self.inferred(fitted, weighed, known)
                break
            except IdentifiabilityError:  # no term that was not asked for refuses an answer
                fewer = tuple(name for name in rows if name not in fitted.problem.names)
                if fewer == rows:
                    raise
                rows, rare = fewer, rare.intersection(fewer)
        whole = self.horizon is None and found.horizon == math.inf
        return replace(found, horizon=None) if whole else found

    def chosen(
        self,
        logs: Sequence[Log],
        first: Sequence[Start],
        known: Prior,
        rows: tuple[tuple[str, ...], set[str]],
    ) -> tuple[Fitted, WeighedLogs | None]:
        """Start, fit, choose from rows of the table of terms (some of them rare), weigh logs.

        If nobody says over which time, whole logs, or segments where no run of them stays near.
        """
        if self.horizon is None:
            return self._over_own_time(logs, first, known, rows)
        absent = {*self._rows(logs, known)[0]} - {*rows[0]} if self.terms is None else set[str]()

        def begun(logs: Sequence[Log]) -> Begun:
            """Fit logs in the terms of their start."""
            begins = [*first]
            if any(log.closed for log in logs):
                asked = self.terms, self.fixed
                begins = [servo_start(self._over, asked, logs, first[0], known), *first]
            every = [self.problem(logs, each, known).without(absent) for each in begins]
            no_terms = ([n for n in rows[0] if not getattr(each.start, n)] for each in every)
            bare = [each.without(names) for each, names in zip(every, no_terms, strict=True)]
            # a fit that is but the first need not be exact
            fitted = hanging(lowest_end(bare, SHOWS if rows[0] else ROUNDING))
            return every[0], begun_anew(every[0], fitted, *rows)

        every, fitted = held_or_straight(logs, begun)
        choosing = bool(rows[0]) and not out_of_time("the selection of terms")
        fitted = separable(stagewise_fit(every, fitted, *rows) if choosing else fitted)
        weighed = weighed_from(fitted.problem, fitted.end)
        if choosing and weighed and weighed.findings:
            fitted, weighed = stagewise_weighed(every, fitted, weighed, *rows)
        return fitted, weighed

    def _over_own_time(
        self,
        logs: Sequence[Log],
        first: Sequence[Start],
        known: Prior,
        rows: tuple[tuple[str, ...], set[str]],
    ) -> tuple[Fitted, WeighedLogs | None]:
        """Do so over whole logs if that is right, else over segments (see `shorter_segments`)."""
        horizon = max(first_horizon(logs, each.parameters, each.zeros) for each in first)
        fitted, weighed = replace(self, horizon=horizon).chosen(logs, first, known, rows)
        shorter = shorter_segments(fitted)
        if shorter is None or out_of_time("segments of the logs"):
            return fitted, weighed
        horizon, start = shorter
        lines = [each for each in fitted.findings if each.kind is FindingKind.STRAIGHT]
        with suppress(IdentifiabilityError):
            again, taken = replace(self, horizon=horizon), fitted.problem.logs
            fitted, weighed = again.chosen(taken, [start], known, rows)
            fitted = replace(fitted, findings=(*fitted.findings, *lines))
        return fitted, weighed

    def _over(self, terms: Iterable[str], fixed: Iterable[str], horizon: float) -> ProblemOf:
        """Return what makes problems with such terms over segments of ``horizon`` s."""
        return replace(self, terms=tuple(terms), fixed=tuple(fixed), horizon=horizon).problem

    def inferred(self, fitted: Fitted, weighed: WeighedLogs | None, known: Prior) -> Estimate:
        """Return the estimate of a fit, its logs weighed if they scatter."""
        problem, end, findings = fitted.problem, fitted.end, fitted.findings
        logs = problem.logs
        solved = cells = problem.solved(end)
        if weighed and (with_scatter := weighed_end(weighed, end)):
            end, findings = with_scatter, (*findings, *weighed.findings)
            solved = problem.solved(end, cells=1)
        owned = problem.keys[problem.shared :]
        twins = self._twins(fitted, known)
        beyond = end.values + end.at.step(*problem.box.about(end.values, np.inf))
        scattering = weighed is not None and bool(weighed.findings)  # which hides it
        others = [] if scattering else unsaid(problem, fitted.end)
        horizon = problem.options.horizon
        if self.horizon is None and horizon < math.inf:
            others += over_shorter(problem, fitted.end)
        rivals = (*fitted.rivals, *others, beyond[: problem.shared])
        found = SolvedFit(
            method="output error",
            equations=solved,
            unweighted=cells,
            shared=problem.shared,
            masses=[log.added_mass for log in logs],
            conditions=Conditions.of(logs, cells_of(len(logs), len(problem.keys))),
            known=known,
            driven=is_driven(logs),
            timed=all(log.excitation for log in logs),
            rivals=rivals,
            wider=[each.rival for each in twins],
            consider_covariance=_waits(logs, solved.names),
            fixed=self._fixed(problem),
            findings=(*findings, *(each.finding for each in twins)),
        )
        local = _local(owned, solved.values)
        return replace(infer(found), local=local, horizon=horizon)

    def _twins(self, fitted: Fitted, known: Prior) -> list[TwinTerm]:
        """Return the terms that are not fitted and that those which are speak for."""
        problem, logs = fitted.problem, fitted.problem.logs
        masses, terms = [log.added_mass for log in logs], {*problem.names} & {*offered(self.method)}
        rows = candidates(spoken_for(problem.names), masses, known)
        rows = tuple(name for name in rows if name not in self.fixed)
        if not rows:
            return []
        horizon = fitted.problem.options.horizon
        wider = replace(self, terms=(*terms, *rows), horizon=horizon)
        every = wider.problem(logs, Start(problem.start, problem.zeros), known)
        return twin_terms(every, fitted, rows)

    def _require_known_once(self, known: Prior) -> None:
        """Raise InputError for what is known of the robot and yet fixed, or of mass or log."""
        for name in self.fixed:
            if name in known.uncertain:
                expected = "a parameter without a prior (an uncertain known value)"
                raise InputError(self.method, "fixed", name, expected)
        if self.servo_loop == "open" and any(name.startswith("loop_") for name in known.uncertain):
            expected = "closed, as a gain is uncertain and the drive alone does not determine it"
            raise InputError(self.method, "servo_loop", "open", expected)
        for field in ("per_mass", "per_log"):
            for name in getattr(self, field):
                if name in known.parameters:
                    expected = "a parameter that is not among the known values"
                    raise InputError(self.method, field, name, expected)

    def problem(self, logs: Sequence[Log], first: Start, known: Prior = NO_PRIOR) -> Problem:
        """Return the problem that is solved."""
        start, horizon = first.parameters, self.horizon
        if horizon is None:
            horizon = first_horizon(logs, start, first.zeros)
        every = known.fitted((*PARAMETERS, *self._names(logs, known)))
        owned = {*self.fixed, *self.per_mass, *self.per_log}
        settings = {"cogging_periods": self.cogging_periods, "slow_interval": slow_interval(logs)}
        options = ProblemOptions(
            per_mass=self.per_mass,
            per_log=self.per_log,
            window=self.window,
            horizon=horizon or math.inf,
            workers=self.workers or os.cpu_count() or 1,
            loss=self.loss,
        )
        names = [name for name in every if name not in owned]
        begun = Start(replace(start, **settings), first.zeros)
        return Problem.of(logs, begun, names, options, known)

    def _rows(self, logs: Sequence[Log], known: Prior) -> tuple[tuple[str, ...], set[str]]:
        """Return the terms that are tried, and which of them are rare."""
        (rows, rare), held = offered_rows(logs, known), {*self.fixed, *self.per_mass, *self.per_log}
        return tuple(name for name in rows if name not in held), rare

    def _names(self, logs: Sequence[Log], known: Prior) -> tuple[str, ...]:
        """Return the terms that are fitted, or tried."""
        terms = self.terms
        if terms is None:
            terms, _ = offered_rows(logs, known)
        else:
            terms = tuple(name for name in terms if name not in known.uncertain)
        brought = companions({*terms, *known.uncertain}) - {*terms, *self.fixed, *known.parameters}
        return (*(name for name in terms if name not in self.fixed), *sorted(brought))

    def _fixed(self, problem: Problem) -> dict[str, float]:
        """Return what kept the start's value: what was to, and what is no default of the model."""
        start, told = problem.start, {*self.fixed, "cogging_periods"}
        fitted = {*problem.names}
        if "slow_delay" not in fitted and not start.slow_delay:
            fitted.add("slow_interval")
        return {
            each.name: getattr(start, each.name)
            for each in fields(start)
            if each.name in told
            or (each.name not in fitted and getattr(start, each.name) != each.default)
        }


def _local(owned: Sequence[Key], values: Samples) -> dict[AddedMass | str | None, dict[str, float]]:
    """Return the last of some values by whose they are."""
    local: dict[AddedMass | str | None, dict[str, float]] = {}
    own = values[values.size - len(owned) :].tolist()
    for (name, whose), value in zip(owned, own, strict=True):
        local.setdefault(whose, {})[name] = value
    return local


def _waits(logs: Sequence[Log], names: Sequence[str]) -> Samples | None:
    """(n, n) covariance of what nobody tells: a set-point waits for firmware up to a period."""
    periods = [log.servo.period for log in logs if log.closed and log.servo is not None]
    if not periods or "delay" not in names:
        return None
    return np.diag([max(periods) ** 2 / 12 if name == "delay" else 0.0 for name in names])
