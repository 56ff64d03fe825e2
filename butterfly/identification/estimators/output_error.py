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

from butterfly.arrays import ROUNDING, Samples
from butterfly.errors import IdentifiabilityError, InputError, require_names, require_number
from butterfly.identification.agreement import Conditions
from butterfly.identification.chosen_terms import (
    TwinTerm,
    choose,
    inseparable_terms,
    offered_rows,
    separable,
    spoken_for,
    twin_terms,
)
from butterfly.identification.consistency import is_driven, prior_of_fit
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators.assumptions import (
    Begun,
    held_or_straight,
    over_shorter,
    shorter_segments,
    unsaid,
    weigh_by_scatter,
)
from butterfly.identification.estimators.base import Estimator
from butterfly.identification.estimators.start import (
    ProblemOf,
    begun_anew,
    best_local_minimum,
    on_its_grid,
    servo_start,
    starts,
    with_zero_at_rest_angle,
)
from butterfly.identification.fit import Fit, MissingTerms
from butterfly.identification.free_run import first_horizon
from butterfly.identification.infer import Basis, infer
from butterfly.identification.limits import Rival, cells_of
from butterfly.identification.loss import Loss
from butterfly.identification.problem import LOCAL, Key, Problem, ProblemOptions, Start
from butterfly.identification.stagewise import candidates
from butterfly.identification.trust import SHOWS, Finding, FindingKind
from butterfly.logs.log import Log, slow_interval
from butterfly.model.parameters import AddedMass, require_periods, value_if_absent
from butterfly.model.prior import NO_PRIOR, Prior, require_usable
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
        """Estimate the parameters (see `Estimator`); terms that are given are not judged."""
        return self._ended(*self.fit(data))

    def fit(
        self, data: DataSet, first: Sequence[Start] = (), offered: tuple[str, ...] = ()
    ) -> Begun:
        """Start from the closed form, or ``first``, and fit the terms of the start or those given.

        Logs that initial errors drive apart are left out, where there are enough of others.
        ``offered``: see `fit_of`.
        """
        asked = {*(self.terms or ()), *self.per_mass, *self.per_log}
        data.require_angles(*asked & {*OF_ANGLE, "zero"})
        first = first or starts(data, self.terms)
        calm = data.calm if len(data.counted) < len(data.logs) else data
        if len(calm.logs) == len(data.logs):
            return self.fit_of(data.logs, first, data.known, offered)
        lost = {log.name for log in data.logs} - {log.name for log in calm.logs}
        left_out = Finding(FindingKind.UNPREDICTABLE, logs=tuple(sorted(lost)))
        problem, fit = self.fit_of(calm.logs, first, data.known, offered)
        return problem, replace(fit, findings=(*fit.findings, left_out))

    def choose(self, problem: Problem, fit: Fit) -> Begun:
        """Choose terms if none are given, else name those that are missing.

        Where a fit of whole logs is no good then, it is done anew over segments of a joint's own
        time (see `shorter_segments`).
        """
        if self.terms is None:
            fit = choose(problem, fit, *self._rows(problem.logs, problem.robot))
        problem, fit = on_its_grid(problem, separable(problem, fit))
        problem, fit = self._over_own_time(problem, fit)
        return problem, fit if self.terms is None else self._with_missing(problem, fit)

    def weigh(self, problem: Problem, fit: Fit) -> Fit:
        """Weigh logs by their scatter; choose again the terms that it hides."""
        weighted = weigh_by_scatter(problem, fit)
        if self.terms is None and weighted.scatters:
            again = choose(problem, weighted, *self._rows(problem.logs, problem.robot))
            same = again.linearisation.names == weighted.linearisation.names
            weighted = again if same else weigh_by_scatter(problem, again)
        return weighted

    def near(self, estimate: Estimate) -> Callable[[DataSet], Estimate]:
        """Return the estimator, its descent begun at an estimate."""
        return lambda data: self._ended(*self.fit(data, [Start.at(estimate, data)]))

    def path(self, data: DataSet, offers: tuple[str, ...]) -> tuple[tuple[str, ...], ...]:
        """Return the terms after each round of a stagewise choice from some offers."""
        self.with_terms(offers)
        rows = candidates(offers, [log.added_mass for log in data.logs], data.known)
        problem, fit = self.with_terms(rows).fit(data, starts(data, ()), rows)
        rare = {*RARE} - {*(OF_SERVO if any(log.closed for log in problem.logs) else ())}
        return choose(problem, fit, rows, rare).path or ((),)

    def of_logs(
        self, logs: Sequence[Log], first: Sequence[Start], known: Prior = NO_PRIOR
    ) -> Estimate:
        """Fit the free-run simulation of all logs jointly, from one or more first guesses."""
        return self._ended(*self.fit_of(logs, first, known))

    def _ended(self, problem: Problem, fit: Fit) -> Estimate:
        """Return the estimate of a fit, its terms chosen if none are given."""
        if self.terms is None:
            problem, fit = self.choose(problem, fit)
        else:
            problem, fit = self._over_own_time(problem, separable(problem, fit))
        return self.infer(problem, self.weigh(problem, fit))

    def fit_of(
        self,
        logs: Sequence[Log],
        first: Sequence[Start],
        known: Prior,
        offered: tuple[str, ...] = (),
    ) -> Begun:
        """Fit logs in the terms of their start, or those given.

        Without a given horizon: whole logs, or segments where errors are driven apart.
        ``offered``: given terms that only some of the starts have.
        """
        require_usable(self.method, known)
        self._require_known_once(known)
        logs = [log.opened for log in logs] if self.servo_loop == "open" else logs
        known = prior_of_fit(logs, known)
        over = self
        if self.horizon is None:
            horizon = max(first_horizon(logs, start.parameters, start.zeros) for start in first)
            over = replace(self, horizon=horizon)
        rows, rare = (offered, set[str]()) if offered else ((), set[str]())
        if self.terms is None:
            rows, rare = self._rows(logs, known)

        def begun(logs: Sequence[Log]) -> Begun:
            """Fit logs in the terms of their start."""
            begins = [*first]
            if any(log.closed for log in logs):
                asked = self.terms, self.fixed
                begins = [servo_start(over.over, asked, logs, first[0], known), *first]
            every = [over.problem(logs, start, known) for start in begins]
            no_terms = ([n for n in rows if not getattr(problem.start, n)] for problem in every)
            bare = [problem.without(names) for problem, names in zip(every, no_terms, strict=True)]
            # a fit that is but the first need not be exact
            place, fit = best_local_minimum(bare, SHOWS if rows else ROUNDING)
            there = replace(every[place], initial=every[0].initial)
            fit = with_zero_at_rest_angle(there, begun_anew(there, fit, rows, rare))
            return on_its_grid(there, fit)

        return held_or_straight(logs, begun)

    def _over_own_time(self, problem: Problem, fit: Fit) -> Begun:
        """Fit anew over segments where fits of whole logs are no good; choose terms as before."""
        shorter = None if self.horizon is not None else shorter_segments(problem, fit)
        if shorter is None or out_of_time("segments of the logs"):
            return problem, fit
        horizon, start = shorter
        again = replace(self, horizon=horizon)
        with suppress(IdentifiabilityError):
            there, end = again.fit_of(problem.logs, [start], problem.robot)
            if self.terms is None:
                there, end = again.choose(there, end)
            kinds = (FindingKind.STRAIGHT, FindingKind.UNPREDICTABLE)
            findings = [finding for finding in fit.findings if finding.kind in kinds]
            return there, replace(end, findings=(*end.findings, *findings))
        return problem, fit

    def over(self, terms: Iterable[str], fixed: Iterable[str], horizon: float) -> ProblemOf:
        """Return what makes problems with such terms over segments of ``horizon`` s."""
        return replace(self, terms=tuple(terms), fixed=tuple(fixed), horizon=horizon).problem

    def _with_missing(self, problem: Problem, fit: Fit) -> Fit:
        """Return a fit in given terms with the significant ones that it lacks."""
        rows, rare = self._rows(problem.logs, problem.robot)
        lacking = tuple(name for name in rows if name not in problem.names)
        wider = self._wider(problem, (*(self.terms or ()), *lacking))
        tried = choose(wider, fit, lacking, rare, rounds=0)
        rivals = tuple(term.values for term in tried.missing if term.values in tried.rivals)
        return replace(fit, missing=tried.missing, rivals=rivals)

    def _wider(self, problem: Problem, terms: Iterable[str]) -> Problem:
        """Return the problem with other terms, each log simulated on the same grid."""
        wider = replace(self, terms=tuple(terms), horizon=problem.options.horizon)
        first = Start(problem.start, problem.zeros)
        every = wider.problem(problem.logs, first, problem.robot)
        return replace(every, simulations=problem.simulations)

    def infer(self, problem: Problem, fit: Fit) -> Estimate:
        """Return the estimate of a fit in some of the values of a problem.

        If chosen terms make it unidentifiable, the logs are fitted again without those that do.
        """
        try:
            return self._inferred(problem, fit)
        except IdentifiabilityError:
            chosen = {*fit.linearisation.names} & {*self._rows(problem.logs, problem.robot)[0]}
            if self.terms is not None or not chosen:
                raise
        lost = inseparable_terms(fit.linearisation) or tuple(sorted(chosen))
        finding = Finding(FindingKind.INSEPARABLE, lost)
        others = [
            reported for reported in fit.plain.findings if reported.kind is not FindingKind.SCATTER
        ]
        fewer = problem.of_fit(fit.plain).without(lost)
        bare = fewer.descend(fewer.equations(fewer.initial, fit.linearisation))
        again = replace(bare, findings=(*others, finding), path=fit.path)
        return self.infer(problem, weigh_by_scatter(problem, again))

    def _inferred(self, every: Problem, fit: Fit) -> Estimate:
        """Return the estimate of a fit (see `infer`)."""
        plain, problem, logs = fit.plain, every.of_fit(fit.plain), every.logs
        twins = self._twins(problem, plain)
        names, values = problem.labels[: problem.shared], fit.values
        others = [
            np.array([rival.get(name, value_if_absent(name)) for name in names])
            for rival in fit.rivals
        ]
        if not fit.scatters:  # which hides it
            others += unsaid(problem, plain)
        horizon = problem.options.horizon
        if self.horizon is None and horizon < math.inf:
            others += over_shorter(problem, plain)
        beyond = values + fit.linearisation.step(*problem.box.about(values, np.inf))
        basis = Basis(
            method="output error",
            shared=problem.shared,
            masses=[log.added_mass for log in logs],
            conditions=Conditions.of(logs, cells_of(len(logs), len(problem.keys))),
            known=problem.robot,
            driven=is_driven(logs),
            timed=all(log.excitation for log in logs),
            rivals=[*map(Rival, [*others, beyond[: problem.shared]]), *(t.rival for t in twins)],
            large=plain.linearisation.is_misfit,
            consider_covariance=_waits(logs, problem.names),
            fixed=self._fixed(problem),
            findings=[twin.finding for twin in twins],
        )
        estimate = infer(problem.in_cells(fit), basis)
        whole = self.horizon is None and horizon == math.inf
        local = _local(problem.keys[problem.shared :], values)
        half = (estimate.upper - estimate.lower) / 2
        missing = MissingTerms.of(fit.missing, estimate.named, half, logs)
        over = None if whole else horizon
        return replace(estimate, local=local, horizon=over, missing=missing)

    def _twins(self, problem: Problem, fit: Fit) -> list[TwinTerm]:
        """Return the terms that are not fitted, though a fitted one suggests them."""
        masses = [log.added_mass for log in problem.logs]
        rows = candidates(spoken_for(problem.names), masses, problem.robot)
        rows = tuple(name for name in rows if name not in self.fixed)
        terms = {*problem.names} & {*offered(self.method)}
        return twin_terms(self._wider(problem, (*terms, *rows)), fit, rows) if rows else []

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
        options = ProblemOptions(
            per_mass=self.per_mass,
            per_log=self.per_log,
            window=self.window,
            horizon=horizon or math.inf,
            workers=self.workers or os.cpu_count() or 1,
            loss=self.loss,
        )
        names = [name for name in every if name not in owned]
        slow = slow_interval(logs)
        begun = replace(start, cogging_periods=self.cogging_periods, slow_interval=slow)
        return Problem.of(logs, Start(begun, first.zeros), names, options, known)

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
        """Return the values that were not fitted: those held as asked, and others than defaults."""
        start, held = problem.start, {*self.fixed, "cogging_periods"}
        fitted = {*problem.names}
        if "slow_delay" not in fitted and not start.slow_delay:
            fitted.add("slow_interval")
        return {
            field.name: getattr(start, field.name)
            for field in fields(start)
            if field.name in held
            or (field.name not in fitted and getattr(start, field.name) != field.default)
        }


def _local(owned: Sequence[Key], values: Samples) -> dict[AddedMass | str | None, dict[str, float]]:
    """Return the last of some values, by owner (mass, log or all) and name."""
    local: dict[AddedMass | str | None, dict[str, float]] = {}
    tail = values[values.size - len(owned) :].tolist()
    for (name, whose), value in zip(owned, tail, strict=True):
        local.setdefault(whose, {})[name] = value
    return local


def _waits(logs: Sequence[Log], names: Sequence[str]) -> Samples | None:
    """(n, n) covariance of an unknown wait: a set-point waits for firmware up to a period."""
    periods = [log.servo.period for log in logs if log.closed and log.servo is not None]
    if not periods or "delay" not in names:
        return None
    return np.diag([max(periods) ** 2 / 12 if name == "delay" else 0.0 for name in names])
