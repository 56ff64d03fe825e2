"""Logs weighed by how much friction and gain differ among them: where a fit ends.

From the least squares a step leads to where logs that differ (see `scatter`) are best. There every
log is simulated with its likeliest friction and gain, which tells the scatter better, and so on;
the equations about the end, whitened, are plain ones (Lindstrom & Bates, Biometrics 46, 1990).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from butterfly.arrays import Samples
from butterfly.errors import IdentifiabilityError
from butterfly.identification.chosen_terms import Fitted, FreeRunModel, conditioning_of, fitted_of
from butterfly.identification.findings import Finding
from butterfly.identification.fit import Equations, LogEquations, Loss, Minimum
from butterfly.identification.inference.scatter import Likelihood, LogRows, Scatter, spread_of
from butterfly.identification.inference.stagewise import stagewise
from butterfly.identification.levels import FEW, LOST, MATTERS, MOST, PASSES
from butterfly.identification.problem import Problem
from butterfly.progress import out_of_time


@dataclass(frozen=True, kw_only=True, eq=False)
class WeighedLogs:
    """What logs say about (n,) values of a problem, weighed by their likeliest scatter."""

    problem: Problem
    values: Samples
    own: Samples  # (k, n) what each log is simulated with besides
    logs: LogRows
    about: Equations  # not weighed
    fixed: Scatter | None = None  # if it is not the likeliest

    @classmethod
    def of(
        cls,
        problem: Problem,
        at: Equations,
        values: Samples,
        own: Samples | None = None,
        like: WeighedLogs | None = None,
    ) -> WeighedLogs:
        """Weigh equations about values, or about these and what (k, n) each log has of its own.

        ``like``: others, of the same scatter and noise; these are the likeliest if not given.
        """
        rows = ((log.residuals, log.spread(log.rows, values.size)) for log in at.logs)
        logs = LogRows.of(rows, like.logs.left if like else ())
        moved = np.zeros((len(at.logs), values.size)) if own is None else own
        fixed = like.scatter if like else None
        logs = logs.moved(-moved)
        return cls(problem=problem, values=values, own=moved, logs=logs, about=at, fixed=fixed)

    @classmethod
    def simulated(
        cls,
        problem: Problem,
        values: Samples,
        own: Samples,
        near: WeighedLogs,
        like: WeighedLogs | None,
    ) -> WeighedLogs:
        """Simulate and weigh logs about values and (k, n) that each has of its own (see `of`)."""
        at = problem.equations(values + own, near.about)
        if not at.is_finite:
            raise IdentifiabilityError("a simulation of weighed logs diverges")
        return cls.of(problem, at, values, own, like)

    @cached_property
    def at(self) -> Equations:
        """The equations, whose errors are independent and of variance 1."""
        every, prior = np.arange(self.values.size), self.problem.prior(self.values)
        pairs = zip(*self.scatter.whitened(self.logs, self._spread), strict=True)
        logs = (LogEquations(residuals=own, rows=rows, columns=every) for rows, own in pairs)
        return Equations(values=self.values, logs=tuple(logs), prior=prior)

    @cached_property
    def step(self) -> Samples:
        """(n,) what they ask the values to move by."""
        return self.at.step(*self.problem.box.about(self.values, np.inf))

    @property
    def next(self) -> WeighedLogs:
        """What logs say where the step leads; IdentifiabilityError where a simulation diverges."""
        values = self.values + self.step
        moved = self.scatter.random_effects(self.logs.moved(self.step), self._spread)
        moved = np.maximum(moved, self.problem.lower - values)
        like = self if self.fixed else None
        return WeighedLogs.simulated(self.problem, values, moved, self, like)

    def ended(self, *, converged: bool = True) -> WeighedMinimum:
        """Return the end of that step."""
        at = self.at.moved(self.step)
        return WeighedMinimum(at=at, converged=converged, evaluations=0, weighed=self)

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """Which of the scatter is more than chance."""
        return tuple(self._likelihood.findings(self.scatter, self.problem.names))

    @property
    def _spread(self) -> Samples:
        return spread_of(self.problem.names, self.values)

    @cached_property
    def _likelihood(self) -> Likelihood:
        return Likelihood(self.logs, self._spread, self.problem.prior(self.values), self.values)

    @cached_property
    def scatter(self) -> Scatter:
        """The likeliest scatter."""
        return self.fixed or self._likelihood.best()


@dataclass(frozen=True, kw_only=True, eq=False)
class WeighedMinimum(Minimum):
    """Where a fit to weighed logs ended, a step from these."""

    weighed: WeighedLogs


@dataclass(frozen=True, kw_only=True, eq=False)
class WeighedModel(FreeRunModel):
    """A fit to weighed logs, whose scatter and noise stay while terms are chosen."""

    end: WeighedMinimum

    def equations(self, there: Problem, values: Samples) -> Equations:
        """Return whitened equations of a problem in other terms about (n,) values."""
        return self._weighed(there, values).at

    def simulated(self, there: Problem, values: Samples) -> Equations:
        """Return the same without a prior."""
        return replace(self.equations(there, values), prior=None)

    def _weighed(self, there: Problem, values: Samples) -> WeighedLogs:
        """Return the logs about (n,) values in other terms, with what each has of its own."""
        mine = self.end.weighed
        own = there.values_from(mine.problem, mine.own, np.zeros(values.size))
        own = np.maximum(own, there.lower - values)
        return WeighedLogs.simulated(there, values, own, mine, mine)

    def descended(
        self, there: Problem, at: Equations, most: int = MOST, enough: float = MATTERS
    ) -> WeighedMinimum:
        """Return where the steps of weighed logs lead in other terms, as far as needed."""
        found = self._weighed(there, at.values)
        for _ in range(min(most, PASSES)):
            if found.at.decrease(found.step) <= max(enough, MATTERS) * found.at.cost:
                return found.ended()
            found = found.next
        return found.ended(converged=False)


def weighed_from(problem: Problem, end: Minimum) -> WeighedLogs | None:
    """Weigh logs, from where a descent ended; None where that says nothing."""
    # a robust loss has weights of its own
    few = len(problem.motion) <= FEW or end.at.loss is not Loss.LINEAR
    if few or out_of_time("weighting the logs by their scatter"):
        return None
    try:
        return WeighedLogs.of(problem, end.at, end.values).next
    except IdentifiabilityError:
        return None


def stagewise_weighed(
    every: Problem, fitted: Fitted, weighed: WeighedLogs, rows: Sequence[str], rare: Collection[str]
) -> tuple[Fitted, WeighedLogs]:
    """Add terms that the scatter of logs hides; those that a fit has stay.

    The friction of each log would take the place of those, which the mean of all needs.
    """
    begun = WeighedModel(every=every, problem=fitted.problem, end=weighed.ended(), rows=tuple(rows))
    try:
        found = stagewise(begun, [name for name in rows if name not in begun.terms], rare)
        problem, end = found.model.problem, found.model.end
        if problem is fitted.problem:
            return fitted_of(found, fitted.end, fitted), weighed
        again = replace(end.weighed, fixed=None).next
        at = problem.equations(end.values, end.weighed.about)
    except IdentifiabilityError:  # no joint swings as these would have it
        return fitted, weighed
    if not at.is_finite:
        return fitted, weighed
    return fitted_of(found, replace(fitted.end, at=at, converged=end.converged), fitted), again


def weighed_end(found: WeighedLogs | None, end: Minimum) -> Minimum | None:
    """Return the end of a descent with logs weighed; None where they cannot be followed there."""
    if found is None or conditioning_of(found.problem, found.at).singular:
        return None
    values = np.maximum(found.values + found.step, found.problem.lower)
    promised = replace(end.at, prior=None).moved(values - end.values).cost
    at = found.problem.equations(values, found.about, slopes=False)
    if not LOST * at.cost <= promised:
        return None
    return replace(end, at=replace(found.at.moved(found.step), values=values))
