"""Logs weighed by how much friction and gain differ among them: where a fit ends, what it lacks.

From the least squares a step leads to where logs that differ (see `scatter`) are best. There every
log is simulated with friction and gain of its own, the likeliest, which tells the scatter better,
and so on until a step promises nothing; the equations about that, whitened, are those of a plain
regression (Lindstrom & Bates, Biometrics 46, 1990).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from butterfly.arrays import Samples
from butterfly.identification.blocks import Conditions
from butterfly.identification.diagnostics.findings import Finding
from butterfly.identification.equations import CellEquations
from butterfly.identification.estimators.free_run_residuals import FreeRunResiduals, tried
from butterfly.identification.estimators.gauss_newton import (
    Equations,
    LogEquations,
    Loss,
    Minimum,
    bounded_step,
    decrease,
)
from butterfly.identification.inference.agreement import lacking_term
from butterfly.identification.inference.scatter import Likelihood, LogRows, Scatter, spread_of
from butterfly.identification.inference.term_choice import BASE, RARER
from butterfly.identification.levels import FEW, LOST, MATTERS, MOST, PRECISE, ROUNDING, WEIGHED
from butterfly.model.terms import FOLLOWERS, GEAR
from butterfly.progress import out_of_time


@dataclass(frozen=True, kw_only=True, eq=False)
class WeighedLogs:
    """What logs say of (n,) scaled values of residuals, weighed by their likeliest scatter."""

    problem: FreeRunResiduals
    point: Samples
    logs: LogRows

    @classmethod
    def of(
        cls, problem: FreeRunResiduals, at: Equations, point: Samples, own: Samples | None = None
    ) -> WeighedLogs:
        """Weigh equations about values, or about what (k, n) each log has of its ``own``."""
        logs = LogRows.of((log.residuals, log.rows, log.mixture) for log in at.logs)
        logs = logs if own is None else logs.moved(-own)
        return cls(problem=problem, point=point, logs=logs)

    @cached_property
    def at(self) -> Equations:
        """The equations, whose errors are independent and of variance 1."""
        pairs = zip(*self._scatter.whitened(self.logs, self._spread), strict=True)
        identity = np.eye(self.point.size)
        logs = (LogEquations(residuals=own, rows=rows, mixture=identity) for rows, own in pairs)
        prior = self.problem.prior(self.point)
        return Equations(logs=tuple(logs), known=None if prior is None else (prior, self.point))

    @property
    def equations(self) -> CellEquations:
        """The same by log, in the scaled parameters."""
        return self.problem.about_point(self.point, self.at, 1)

    @cached_property
    def step(self) -> Samples:
        """(n,) what they ask the values to move by."""
        size = np.abs(self.point)
        # a base that is faster still shows no frequency, and costs the more steps
        shapes = [name in FOLLOWERS for name in self.problem.names]
        room = np.maximum(self.problem.initial / PRECISE - self.point, ROUNDING * size)
        highest = np.where(shapes, np.minimum(LOST * size, room), np.inf)
        lowest = np.minimum(self.problem.lower - self.point, 0.0)
        lowest = np.where(shapes, np.maximum(lowest, -LOST * size), lowest)
        return bounded_step(self.at, lowest, highest)

    @cached_property
    def promised(self) -> float:
        """Mean square of that in standard errors."""
        return 2 * decrease(self.at, self.step) / self.point.size

    @property
    def settled(self) -> bool:
        """Whether that is less than scatter tells."""
        return self.promised < WEIGHED

    def taking(self, problem: FreeRunResiduals) -> WeighedLogs:
        """Return the same of residuals in fewer parameters."""
        kept = np.flatnonzero([key in problem.keys for key in self.problem.keys])
        logs = replace(self.logs, rows=self.logs.rows[:, :, kept])
        return WeighedLogs(problem=problem, point=self.point[kept], logs=logs)

    def settled_within(self, most: int) -> WeighedLogs | None:
        """Return what logs say where no step promises much, or after so many of them."""
        found, share = self, 1.0
        for _ in range(most):
            if found.settled or share < MATTERS:
                break
            there = found.next_in(self.problem, share)
            if there is None:
                return None
            if not there.promised < found.promised:  # steps go to and fro
                share *= LOST
            found = there
        return found

    @property
    def weighed_end(self) -> Minimum:
        """Where the next step leads."""
        point = np.maximum(self.point + self.step, self.problem.lower)
        at = self.at.moved(self.step)
        return Minimum(point=point, at=at, converged=self.settled, evaluations=0)

    @cached_property
    def end(self) -> Minimum:
        """The same, as logs see it that are not weighed."""
        point = self.weighed_end.point
        at = self.problem.weighed(self.problem.equations(point), point)
        return replace(self.weighed_end, at=at)

    def next_in(self, problem: FreeRunResiduals, share: float = 1.0) -> WeighedLogs | None:
        """Return what logs say a share of the step away; None where a simulation diverges."""
        step = share * self.step
        point = self.point + step
        own = self._scatter.apart(self.logs.moved(step), self._spread)
        own = np.maximum(own, self.problem.lower - point)
        values = problem.values_of(self.problem, point)
        own = problem.values_of(self.problem, point + own) - values
        there = problem.equations(values + own)
        return WeighedLogs.of(problem, there, values, own) if there.is_finite else None

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """Which of the scatter is more than chance."""
        return tuple(self._likelihood.findings(self._scatter, self.problem.names))

    @property
    def conditions(self) -> Conditions:
        """Under which the logs were recorded: their errors are known, as of steady responses."""
        return Conditions.of([each.log for each in self.problem.simulations], 1, steady=True)

    @property
    def _spread(self) -> Samples:
        return spread_of(self.problem.names, self.point)

    @cached_property
    def _likelihood(self) -> Likelihood:
        return Likelihood(self.logs, self._spread, self.problem.prior(self.point), self.point)

    @cached_property
    def _scatter(self) -> Scatter:
        return self._likelihood.best()


def weighed_from(problem: FreeRunResiduals, at: Equations, point: Samples) -> WeighedLogs | None:
    """Weigh logs, from equations about any values; None where that says nothing."""
    # a robust loss has weights of its own
    few = len(at.logs) <= FEW or at.loss is not Loss.LINEAR
    if few or out_of_time("weighting the logs by their scatter"):
        return None
    return WeighedLogs.of(problem, at, point).next_in(problem)


def weighed_end(
    found: WeighedLogs | None, end: Minimum
) -> tuple[Minimum, tuple[Finding, ...]] | None:
    """Return the end with logs weighed, and findings; None where they cannot be followed."""
    if found is None or found.problem.inseparable(found.at):
        return None
    weighed = replace(found.weighed_end, converged=end.converged)
    told = end.at.moved(weighed.point - end.point).cost
    if not LOST * found.problem.equations(weighed.point, slopes=False).cost <= told:
        return None
    return weighed, found.findings


def chosen_by_weight(
    wide: FreeRunResiduals, found: WeighedLogs | None, end: Minimum
) -> WeighedLogs | None:
    """Return weighed logs with the rarer terms that scatter hid from the least squares."""
    chosen: WeighedLogs | None = None
    while found and found.findings and not out_of_time("the selection of terms"):
        every = wide.without(not_tried(found.problem))
        offers = [name for name, _ in {*every.keys} - {*found.problem.keys} if name in RARER]
        there = found.next_in(every)
        if not offers or there is None:
            break
        lacking = lacking_term(there.equations, offers, there.conditions)
        if lacking is None:
            break
        found = there.taking(every.without({*offers} - {lacking})).settled_within(MOST)
        if not found or not found.settled or LOST * found.end.at.cost > end.at.cost:
            break
        chosen = found
    return chosen


def not_tried(problem: FreeRunResiduals) -> set[str]:
    """Return the terms that nobody looks for beside those that are fitted."""
    fitted = {*problem.names}
    idle = {*tried([each.log for each in problem.simulations])} - fitted
    if BASE in fitted:  # on which friction of gears is not simulated
        return idle | {*GEAR}
    return idle | {BASE} if fitted & {*GEAR} else idle
