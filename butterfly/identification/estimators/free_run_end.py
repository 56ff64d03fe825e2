"""Where output error ended, as an estimate is made of it."""

from __future__ import annotations

import numpy as np

from butterfly.identification.diagnostics.findings import Ending, Finding, FindingKind
from butterfly.identification.estimators.equations import Equations
from butterfly.identification.estimators.free_run_residuals import FreeRunResiduals
from butterfly.identification.estimators.gauss_newton import Minimum
from butterfly.identification.estimators.loss import Loss
from butterfly.identification.inference.covariance import blocks_of
from butterfly.identification.solved import Solved
from butterfly.model.parameters import AddedMass
from butterfly.verdict import Level


def solved_of(problem: FreeRunResiduals, end: Minimum[Equations]) -> Solved:
    """Return the end of a descent with its equations, those of few logs in blocks of time."""
    blocks = blocks_of(len(problem.trajectories), len(problem.keys))
    parts = end.at.compressed(blocks)
    rows, residuals = zip(*parts, strict=True)
    scale = problem.scale
    took = Finding(
        kind=FindingKind.SIMULATIONS,
        number=end.evaluations,
        severity=Level.NOTE if end.converged else Level.WARNING,
    )
    return Solved(
        names=tuple(name for name, _ in problem.keys),
        values=end.point * problem.scale,
        jacobian=np.concatenate(rows) / problem.scale,
        residuals=np.concatenate(residuals),
        cluster=np.repeat(np.arange(len(parts)), [part.size for part in residuals]),
        on_bound=end.point <= problem.lower,
        lower=problem.lower * problem.scale,
        ending=Ending.CONVERGED if end.converged else Ending.STOPPED,
        findings=(took,),
        prior=None if problem.prior is None else problem.prior.turned(scale, np.zeros(scale.size)),
        bread=None if end.at.loss is Loss.LINEAR else end.at.bread / np.outer(scale, scale),
    )


def local_of(
    known: list[tuple[tuple[str, AddedMass | str | None], float]],
) -> dict[AddedMass | str | None, dict[str, float]]:
    """Return what is not shared, and the zero, by whose it is."""
    local: dict[AddedMass | str | None, dict[str, float]] = {}
    for (name, whose), value in known:
        local.setdefault(whose, {})[name] = value
    return local
