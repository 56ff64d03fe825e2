"""Logs weighed by how much friction and gain differ among them: where a fit ends.

From the least squares a step leads to where logs that differ (see `scatter`) are best. There every
log is simulated with its likeliest friction and gain, which tells the scatter better, and so on;
the equations about the end, whitened, are plain ones (Lindstrom & Bates, Biometrics 46, 1990).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from butterfly.arrays import Samples
from butterfly.identification.chosen_terms import conditioning_of
from butterfly.identification.diagnostics.findings import Finding
from butterfly.identification.fit import Equations, LogEquations, Loss, Minimum
from butterfly.identification.inference.scatter import Likelihood, LogRows, Scatter, spread_of
from butterfly.identification.levels import FEW, LOST
from butterfly.identification.problem import Problem
from butterfly.progress import out_of_time


@dataclass(frozen=True, kw_only=True, eq=False)
class WeighedLogs:
    """What logs say about (n,) values of a problem, weighed by their likeliest scatter."""

    problem: Problem
    values: Samples
    logs: LogRows

    @classmethod
    def of(
        cls, problem: Problem, at: Equations, values: Samples, own: Samples | None = None
    ) -> WeighedLogs:
        """Weigh equations about values, or about these and what (k, n) each log has of its own."""
        unit = np.eye(values.size)
        logs = LogRows.of((log.residuals, log.rows, unit[log.columns]) for log in at.logs)
        return cls(problem=problem, values=values, logs=logs if own is None else logs.moved(-own))

    @cached_property
    def at(self) -> Equations:
        """The equations, whose errors are independent and of variance 1."""
        every = np.arange(self.values.size)
        pairs = zip(*self._scatter.whitened(self.logs, self._spread), strict=True)
        logs = (LogEquations(residuals=own, rows=rows, columns=every) for rows, own in pairs)
        return Equations(
            values=self.values, logs=tuple(logs), prior=self.problem.prior(self.values)
        )

    @cached_property
    def step(self) -> Samples:
        """(n,) what they ask the values to move by."""
        return self.at.step(*self.problem.box.about(self.values, np.inf))

    @property
    def next(self) -> WeighedLogs | None:
        """What logs say where the step leads; None where a simulation diverges."""
        values = self.values + self.step
        moved = self._scatter.apart(self.logs.moved(self.step), self._spread)
        moved = np.maximum(moved, self.problem.lower - values)
        at = self.problem.equations(values + moved)
        return WeighedLogs.of(self.problem, at, values, moved) if at.is_finite else None

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """Which of the scatter is more than chance."""
        return tuple(self._likelihood.findings(self._scatter, self.problem.names))

    @property
    def _spread(self) -> Samples:
        return spread_of(self.problem.names, self.values)

    @cached_property
    def _likelihood(self) -> Likelihood:
        return Likelihood(self.logs, self._spread, self.problem.prior(self.values), self.values)

    @cached_property
    def _scatter(self) -> Scatter:
        return self._likelihood.best()


def weighed_from(problem: Problem, end: Minimum) -> WeighedLogs | None:
    """Weigh logs, from where a descent ended; None where that says nothing."""
    # a robust loss has weights of its own
    few = len(problem.motion) <= FEW or end.at.loss is not Loss.LINEAR
    if few or out_of_time("weighting the logs by their scatter"):
        return None
    return WeighedLogs.of(problem, end.at, end.values).next


def weighed_end(found: WeighedLogs | None, end: Minimum) -> Minimum | None:
    """Return the end of a descent with logs weighed; None where they cannot be followed there."""
    if found is None or conditioning_of(found.problem, found.at).singular:
        return None
    values = np.maximum(found.values + found.step, found.problem.lower)
    promised = replace(end.at, prior=None).moved(values - end.values).cost
    if not LOST * found.problem.equations(values, slopes=False).cost <= promised:
        return None
    return replace(end, at=replace(found.at.moved(found.step), values=values))
