"""The end of output error once more, its logs weighed by how much they differ from one another."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from butterfly.arrays import Samples
from butterfly.identification.diagnostics.findings import Finding
from butterfly.identification.estimators.free_run_residuals import FreeRunResiduals
from butterfly.identification.estimators.gauss_newton import (
    Equations,
    LogEquations,
    Loss,
    Minimum,
    bounded_step,
)
from butterfly.identification.inference.scatter import Likelihood, LogRows, Scatter, spread_of
from butterfly.identification.levels import FEW
from butterfly.model.prior import Penalty

_WORSE = 2.0  # times the squared errors, from which on logs are not what their weights say


def weighed(problem: FreeRunResiduals, end: Minimum) -> tuple[Minimum, tuple[Finding, ...]] | None:
    """Return the end with logs weighed by their scatter, and what is found of it.

    It takes one step from the least squares, to where every log is simulated with friction and gain
    of its own, which tells the scatter better; the step from there is taken on trust. Few logs do
    not tell, and robust losses have weights of their own: None then, and where the logs are
    followed far worse so, or no longer tell the parameters apart.
    """
    if len(end.at.logs) <= FEW or end.at.loss is not Loss.LINEAR:
        return None
    names = tuple(name for name, _ in problem.keys)
    prior = end.at.known and end.at.known[0].weighed(1.0)
    logs, spread = _rows(end.at), spread_of(names, end.point)
    scatter = Likelihood(logs, spread, prior, end.point).best()
    step = _step(problem, _whitened(logs, scatter, spread, prior, end.point), end.point)
    point = end.point + step
    apart = np.maximum(scatter.apart(logs.moved(step), spread), problem.lower - point)
    there = problem.equations(point, apart)
    if not there.cost <= _WORSE * replace(end.at, known=None).cost:
        return None
    logs, spread = _rows(there).moved(-apart), spread_of(names, point)
    likelihood = Likelihood(logs, spread, prior, point)
    scatter = likelihood.best()
    at = _whitened(logs, scatter, spread, prior, point)
    if problem.inseparable(at):
        return None
    last = _step(problem, at, point)
    found = Minimum(
        point=np.maximum(point + last, problem.lower),
        at=at.moved(last),
        converged=end.converged,
        evaluations=end.evaluations + 1,
    )
    return found, tuple(likelihood.findings(scatter, names))


def _rows(at: Equations) -> LogRows:
    return LogRows.of((log.residuals, log.rows, log.mixture) for log in at.logs)


def _whitened(
    logs: LogRows, scatter: Scatter, spread: Samples, prior: Penalty | None, point: Samples
) -> Equations:
    """Return the equations about (n,) values whose errors are independent and of variance 1."""
    pairs = zip(*scatter.whitened(logs, spread), strict=True)
    identity = np.eye(point.size)
    return Equations(
        logs=tuple(LogEquations(residuals=own, rows=rows, mixture=identity) for rows, own in pairs),
        known=None if prior is None else (prior, point),
    )


def _step(problem: FreeRunResiduals, at: Equations, point: Samples) -> Samples:
    return bounded_step(at, np.minimum(problem.lower - point, 0.0), np.inf)
