"""What every estimator ends in: equations about its optimum, cell by cell.

A cell is a log, or a tenth of one in time. Of its residuals r and their derivatives J stays the
triangular factor of [J | r], which gives J^T J, J^T r and r^T r of the cell exactly. All inference
works on these: which terms are fitted, covariance, what parts of the data say, whether conditions
agree.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import Samples
from butterfly.errors import IdentifiabilityError
from butterfly.identification.blocks import cut
from butterfly.identification.diagnostics.findings import Ending
from butterfly.identification.inference.covariance import cluster_covariance
from butterfly.identification.levels import FEW, ROUNDING
from butterfly.identification.normal_equations import (
    Regression,
    Solution,
    scaled_least_squares,
)
from butterfly.model.prior import Penalty


@dataclass(frozen=True, kw_only=True, eq=False)
class CellEquations:
    """A solver's end: n values, and the equations about them in each of k cells."""

    names: tuple[str, ...]  # of the n values; those that all logs share come first
    values: Samples  # (n,)
    lower: Samples  # (n,) least values
    on_bound: NDArray[np.bool_]  # (n,) whether a bound holds the value
    # rows, residuals: (k, m, n) derivatives by the values, and (k, m) residuals, weighted as the
    # solver weighs them
    rows: Samples
    residuals: Samples
    log: NDArray[np.intp]  # (k,) number of each cell's log; cells follow in the order of time
    ending: Ending = Ending.CONVERGED  # how the solver ended
    # (n,) by how much the values moved last, or would move next, if it was stopped
    unsettled: Samples | None = None
    # (n, n) derivatives of the gradient, where the weights depend on the residuals
    bread: Samples | None = None
    prior: Penalty | None = None  # what was known of the values with an uncertainty

    @classmethod
    def of(
        cls,
        regression: Regression,
        solution: Solution,
        *,
        cells: int = 1,
        jacobian: Samples | None = None,
    ) -> CellEquations:
        """Take a regression and its solution, each cluster cut into some cells.

        ``jacobian``: (m, n) derivatives, if they are not the regression's.
        """
        values = solution.values
        derived = regression.jacobian(values) if jacobian is None else jacobian
        parts = cut(derived, regression.residuals(values), regression.cluster, cells)
        rows, residuals = compressed(parts)
        return cls(
            names=regression.names,
            values=values,
            lower=regression.lower,
            on_bound=solution.on_bound,
            rows=rows,
            residuals=residuals,
            log=np.repeat(np.unique(regression.cluster), cells),
            prior=regression.prior,
        )

    def beside(self, other: CellEquations) -> CellEquations:
        """Return these equations and others of other values, of the same cells, as one."""
        (count, mine, own), (_, theirs, further) = self.rows.shape, other.rows.shape
        rows = np.zeros((count, mine + theirs, own + further))
        rows[:, :mine, :own] = self.rows
        rows[:, mine:, own:] = other.rows
        return replace(
            self,
            names=(*self.names, *other.names),
            values=np.append(self.values, other.values),
            rows=rows,
            residuals=np.concatenate([self.residuals, other.residuals], axis=1),
            on_bound=np.append(self.on_bound, other.on_bound),
            lower=np.append(self.lower, other.lower),
            prior=None if self.prior is None else self.prior.padded(further),
        )

    @cached_property
    def curvature(self) -> Samples:
        """(k, n, n): J^T J of each cell."""
        return np.asarray(np.swapaxes(self.rows, 1, 2) @ self.rows)

    @cached_property
    def gradient(self) -> Samples:
        """(k, n): J^T r of each cell."""
        return np.asarray(np.einsum("kmn,km->kn", self.rows, self.residuals))

    @cached_property
    def cost(self) -> Samples:
        """(k,): r^T r of each cell."""
        return np.asarray(np.sum(self.residuals**2, axis=1))

    @cached_property
    def total(self) -> tuple[Samples, Samples]:
        """(n, n) curvature and (n,) gradient of all cells, and of what is known besides."""
        curvature, gradient = self.curvature.sum(axis=0), self.gradient.sum(axis=0)
        if self.prior is None:
            return curvature, gradient
        return curvature + self.prior.curvature, gradient + self.prior.gradient(self.values)

    def stopped(self, unsettled: Samples) -> CellEquations:
        """Return the same of a solver that was stopped while the (n,) values still moved."""
        return replace(self, ending=Ending.STOPPED, unsettled=unsettled)

    @property
    def next_step(self) -> Samples:
        """(n,) Gauss-Newton step of the values that no bound holds."""
        curvature, gradient = self.total
        free = ~self.on_bound & (np.diag(curvature) > 0)
        step = np.zeros(free.size)
        root = np.sqrt(np.diag(curvature)[free])
        scaled = curvature[np.ix_(free, free)] / np.outer(root, root)
        step[free] = -np.linalg.lstsq(scaled, gradient[free] / root, rcond=None)[0] / root
        return step

    @cached_property
    def of_logs(self) -> CellEquations:
        """The same, each log a cell."""
        logs = np.unique(self.log)
        if logs.size == self.log.size:
            return self
        owned = (self.log == number for number in logs)
        rows, residuals = compressed(
            (self.rows[own].reshape(-1, len(self.names)), self.residuals[own].ravel())
            for own in owned
        )
        return replace(self, rows=rows, residuals=residuals, log=logs)

    @cached_property
    def independent(self) -> CellEquations:
        """The same, in cells between which errors are independent.

        They are logs, or stretches of time where there are so few logs that their scatter tells
        nothing of that between others.
        """
        return self.of_logs if np.unique(self.log).size > FEW else self

    def without(self, logs: Iterable[int]) -> CellEquations:
        """Return the equations of all logs but some."""
        kept = ~np.isin(self.log, list(logs))
        return replace(
            self, rows=self.rows[kept], residuals=self.residuals[kept], log=self.log[kept]
        )

    @property
    def realised_variance(self) -> float:
        """Variance of a row as the scatter of the cells realises it: 1 per parameter if right.

        Of independent equal errors it is theirs; errors that are alike within a cell count for
        fewer rows, which is a larger variance of each. It is no less than in the direction of each
        parameter of which something is known besides, the others following.
        """
        cells = self.independent
        flat = cells.rows.reshape(-1, cells.rows.shape[2])
        size = np.linalg.norm(flat, axis=0)
        basis, singular, _ = np.linalg.svd(
            flat / np.where(size > 0, size, 1.0), full_matrices=False
        )
        told = basis[:, singular > ROUNDING * singular.max(initial=0.0)]
        if not told.size:
            raise IdentifiabilityError("these logs do not move any parameter")
        covariance, _ = cluster_covariance(told.reshape(*cells.rows.shape[:2], -1), cells.residuals)
        found = float(np.mean(np.diag(covariance)))
        for k in () if self.prior is None else np.flatnonzero(self.prior.active):
            others = np.delete(flat, k, axis=1)
            own = flat[:, k] - others @ scaled_least_squares(others, flat[:, k])
            if own @ own > ROUNDING * (flat[:, k] @ flat[:, k]):
                along = np.einsum("km,km->k", own.reshape(cells.residuals.shape), cells.residuals)
                found = max(found, float(along @ along / (own @ own)))
        return found

    @property
    def with_prior(self) -> tuple[Samples, Samples]:
        """(m, n) rows and (m,) residuals of all cells, and of what was known besides."""
        flat, left = self.rows.reshape(-1, self.rows.shape[2]), self.residuals.ravel()
        if self.prior is None:
            return flat, left
        more, target = self.prior.rows()
        return np.concatenate([flat, more]), np.append(left, more @ self.values - target)


def compressed(cells: Iterable[tuple[Samples, Samples]]) -> tuple[Samples, Samples]:
    """Reduce cells of any number of equations in n parameters to n + 1 that say the same.

    Of (m, n) rows and (m,) residuals stays the triangular factor of both: (k, n + 1, n) rows and
    (k, n + 1) residuals.
    """
    factors = []
    for rows, residuals in cells:
        both = np.column_stack([rows, residuals])
        triangle = np.asarray(np.linalg.qr(both, mode="r"))
        missing = both.shape[1] - triangle.shape[0]
        factors.append(np.pad(triangle, ((0, missing), (0, 0))))
    whole = np.array(factors)
    return whole[:, :, :-1], whole[:, :, -1]
