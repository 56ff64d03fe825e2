"""The linear equations about an estimator's optimum, cell by cell.

A cell is a log, or a tenth of one in time. Its residuals r and their derivatives J are reduced to
the triangular factor of [J | r], which gives J^T J, J^T r and r^T r of the cell exactly. All
inference uses these: choice of terms, covariance, estimates from parts of the data, agreement of
conditions.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from butterfly.arrays import BLOCK, Samples, unit_columns, unit_diagonal
from butterfly.errors import IdentifiabilityError
from butterfly.identification.findings import Ending
from butterfly.identification.inference.blocks import cut
from butterfly.identification.inference.limits import cluster_covariance
from butterfly.identification.levels import FEW, ROUNDING
from butterfly.model.prior import Penalty
from butterfly.model.terms import TERMS, lower_bounds


@dataclass(frozen=True, kw_only=True, eq=False)
class Solution:
    """(n,) values, and which of them are on an active bound."""

    values: Samples
    on_bound: NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True, eq=False)
class Regression:
    """Equations that are linear in the parameters: ``rows`` times the unknowns is ``target``.

    The unknowns are the parameters themselves, but for those that enter as a product with p4
    (delay, terms of the drive): of these, p4 (parameter - ``about``).
    """

    names: tuple[str, ...]  # of the n parameters
    rows: Samples  # rows, target: (m, n) and (m,)
    target: Samples
    # (m,) indices of the log (or stretch of one) that a row belongs to: errors are taken to be
    # independent between clusters, not within
    cluster: NDArray[np.intp]
    # values of the parameters of the product kind about which the rows hold; 0 if not given
    about: dict[str, float] = field(default_factory=dict)
    # lower bounds, where they are not those of the table of terms
    least: dict[str, float] = field(default_factory=dict)
    # p4 where it is known and no unknown; otherwise a guess of it, which turns priors of products
    # into priors of unknowns
    gain: float = 0.0
    prior: Penalty | None = None  # of the values that are known with an uncertainty

    def solve(self, use: NDArray[np.bool_] | slice = slice(None)) -> Solution:
        """Return the least-squares values of the rows to use, within their bounds."""
        if "p4" in self.names and not self.rows[use, self.names.index("p4")].any():
            raise IdentifiabilityError("the input is always zero: add logs of the driven joint")
        more, wanted = self.known_rows
        rows = np.concatenate([self.rows[use], more])
        target = np.concatenate([self.target[use], wanted])
        scaled, scale = unit_columns(rows)
        moved = self._products & (self._shift != 0)
        lowest = np.where(moved, -np.inf, self.lower)  # of p4 (x - about), whose bound moves too
        highest = np.full(scale.size, np.inf)
        if self.gain < 0:  # products turn their bounds round
            turned = self._products & ~moved
            lowest[turned], highest[turned] = -np.inf, -self.lower[turned]
        fit = lsq_linear(scaled, target, (lowest, highest), method="bvls", tol=1e-14)
        values = self.values(fit.x / scale)
        on_bound = (fit.active_mask != 0) | (values < self.lower)
        return Solution(values=np.maximum(values, self.lower), on_bound=np.asarray(on_bound))

    def at(self, values: Mapping[str, float]) -> Solution:
        """Return values by name, 0 of other parameters, as a solution without active bounds."""
        found = np.array([values.get(name, 0.0) for name in self.names])
        return Solution(values=found, on_bound=np.zeros(found.size, dtype=bool))

    def unknowns(self, values: Samples) -> Samples:
        """Return the (n,) unknowns, which the rows multiply, of (n,) values."""
        return (values - self._shift) * self._slopes(values)

    def values(self, unknowns: Samples) -> Samples:
        """Return the (n,) values of (n,) unknowns, which the rows multiply."""
        return np.asarray(unknowns / self._slopes(unknowns) + self._shift)

    def residuals(self, values: Samples) -> Samples:
        """(m,) left sides less right sides, with (n,) values."""
        return np.asarray(self.rows @ self.unknowns(values) - self.target)

    def jacobian(self, values: Samples) -> Samples:
        """(m, n) derivatives of the residuals by the values, about (n,) values."""
        return self.rows * self._slopes(values)

    @property
    def known_rows(self) -> tuple[Samples, Samples]:
        """(k, n) rows and (k,) targets that the prior adds; none of products without a gain."""
        if self.prior is None:
            return np.empty((0, len(self.names))), np.empty(0)
        if not self.gain:
            return self.prior.without(self._products).rows()
        return self.prior.turned(np.where(self._products, self.gain, 1.0), self._shift).rows()

    @cached_property
    def lower(self) -> Samples:
        """(n,) lower bounds."""
        table = dict(zip(self.names, lower_bounds(self.names).tolist(), strict=True))
        return np.array([self.least.get(name, table[name]) for name in self.names])

    @cached_property
    def _products(self) -> NDArray[np.bool_]:
        return np.array([TERMS[name].of_gain for name in self.names])

    @cached_property
    def _shift(self) -> Samples:
        return np.array([self.about.get(name, 0.0) for name in self.names])

    def _slopes(self, values: Samples) -> Samples:
        """p4 for the parameters that it multiplies, 1 for the others."""
        if not self._products.any():
            return np.ones(len(self.names))
        gain = values[self.names.index("p4")] if "p4" in self.names else self.gain
        return np.where(self._products, float(gain) or np.finfo(float).tiny, 1.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class CellEquations:
    """A solution of n values, and the linear equations about them in each of k cells."""

    names: tuple[str, ...]  # of the n values; those that all logs share come first
    values: Samples  # (n,)
    lower: Samples  # (n,) lower bounds
    on_bound: NDArray[np.bool_]  # (n,) whether the value is on an active bound
    # rows, residuals: (k, m, n) derivatives by the values, and (k, m) residuals, weighted as the
    # solver weighs them
    rows: Samples
    residuals: Samples
    log: NDArray[np.intp]  # (k,) index of each cell's log; cells of a log are in order of time
    ending: Ending = Ending.CONVERGED  # how the solver ended
    # (n,) last or next step of the values, if the solver was stopped
    unsettled: Samples | None = None
    # (n, n) derivatives of the gradient, where the weights depend on the residuals
    bread: Samples | None = None
    prior: Penalty | None = None  # of the values that were known with an uncertainty

    @classmethod
    def of(
        cls,
        regression: Regression,
        solution: Solution,
        *,
        cells: int = 1,
        jacobian: Samples | None = None,
    ) -> CellEquations:
        """Cut a regression about its solution into cells; ``jacobian``: (m, n), if another."""
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

    @property
    def named(self) -> dict[str, float]:
        """The values by name."""
        return dict(zip(self.names, self.values.tolist(), strict=True))

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
        """(n, n) curvature and (n,) gradient of all cells and the prior."""
        curvature, gradient = self.curvature.sum(axis=0), self.gradient.sum(axis=0)
        if self.prior is None:
            return curvature, gradient
        return curvature + self.prior.curvature, gradient + self.prior.gradient(self.values)

    def stopped(self, unsettled: Samples) -> CellEquations:
        """Return the same of a solver that stopped before convergence, with its (n,) last step."""
        return replace(self, ending=Ending.STOPPED, unsettled=unsettled)

    @property
    def next_step(self) -> Samples:
        """(n,) Gauss-Newton step of the `free` values; 0 of the others."""
        return -self.change_by(self.total[1])

    def change_by(self, pull: Samples) -> Samples:
        """(n,) change of the `free` values: the inverse curvature times an (n,) gradient."""
        return np.asarray(self.inverse @ pull)

    @cached_property
    def inverse(self) -> Samples:
        """(n, n) pseudo-inverse of the curvature of the `free` values; 0 elsewhere."""
        scaled, size = unit_diagonal(self.total[0])
        block = np.ix_(self.free, self.free)
        inverse = np.zeros_like(scaled)
        rounding = float(np.finfo(float).eps) * np.count_nonzero(self.free)
        inverse[block] = np.linalg.pinv(scaled[block], rcond=rounding)
        return inverse / np.outer(size, size)

    def orthogonalised(self, changes: Samples) -> tuple[Samples, Samples]:
        """Return (k, n) changes, values partialled out, and (k,) information; 0 if collinear."""
        pulls = np.einsum("kmn,kn->km", self.curvature, changes)
        rest = changes - self.change_by(pulls.sum(axis=0))
        information = np.einsum("kn,kmn,km->k", rest, self.curvature, rest)
        identifiable = information.sum() > ROUNDING * np.sum(changes * pulls)
        return (rest, information) if identifiable else (np.zeros_like(rest), np.zeros(len(rest)))

    @cached_property
    def free(self) -> NDArray[np.bool_]:
        """(n,) which values are on no bound, and affect the residuals or are known."""
        return ~self.on_bound & (np.diag(self.total[0]) > 0)

    @property
    def count(self) -> int:
        """Number of rows that are not 0."""
        return int(np.count_nonzero(np.any(self.rows != 0, axis=2)))

    @cached_property
    def of_logs(self) -> CellEquations:
        """The same, each log a cell."""
        logs = np.unique(self.log)
        if logs.size == self.log.size:
            return self
        of_log = (self.log == number for number in logs)
        rows, residuals = compressed(
            (self.rows[each].reshape(-1, len(self.names)), self.residuals[each].ravel())
            for each in of_log
        )
        return replace(self, rows=rows, residuals=residuals, log=logs)

    @cached_property
    def independent(self) -> CellEquations:
        """The same in cells whose errors are independent: logs, or stretches of few logs."""
        return self.of_logs if np.unique(self.log).size > FEW else self

    def without(self, logs: Iterable[int]) -> CellEquations:
        """Return the equations without some logs, by their indices."""
        kept = ~np.isin(self.log, list(logs))
        return replace(
            self, rows=self.rows[kept], residuals=self.residuals[kept], log=self.log[kept]
        )

    @property
    def realised_variance(self) -> float:
        """Variance of a row by the scatter between cells.

        Errors that are correlated within a cell count as fewer rows, each of a larger variance. It
        is at least the variance in the direction of each parameter that has a prior, the other
        parameters partialled out.
        """
        cells = self.independent
        flat = cells.rows.reshape(-1, cells.rows.shape[2])
        basis, singular, _ = np.linalg.svd(unit_columns(flat)[0], full_matrices=False)
        span = basis[:, singular > ROUNDING * singular.max(initial=0.0)]
        if not span.size:
            raise IdentifiabilityError("no parameter is identifiable from these logs")
        covariance, _ = cluster_covariance(span.reshape(*cells.rows.shape[:2], -1), cells.residuals)
        found = float(np.mean(np.diag(covariance)))
        for k in () if self.prior is None else np.flatnonzero(self.prior.active):
            others = np.delete(flat, k, axis=1)
            res = flat[:, k] - others @ scaled_least_squares(others, flat[:, k])
            if res @ res > ROUNDING * (flat[:, k] @ flat[:, k]):
                along = np.einsum("km,km->k", res.reshape(cells.residuals.shape), cells.residuals)
                found = max(found, float(along @ along / (res @ res)))
        return found

    @property
    def with_prior(self) -> tuple[Samples, Samples]:
        """(m, n) rows and (m,) residuals of all cells and the prior."""
        flat, left = self.rows.reshape(-1, self.rows.shape[2]), self.residuals.ravel()
        if self.prior is None:
            return flat, left
        more, target = self.prior.rows()
        return np.concatenate([flat, more]), np.append(left, more @ self.values - target)


def compressed(cells: Iterable[tuple[Samples, Samples]]) -> tuple[Samples, Samples]:
    """Reduce cells of (m, n) rows and (m,) residuals to n + 1 equivalent equations each."""
    every = [*cells]
    sizes = np.array([residuals.size for _, residuals in every])
    count = every[0][0].shape[1] + 1
    whole = np.zeros((len(every), count, count))
    for size in np.unique(sizes):
        alike, many = np.flatnonzero(sizes == size), max(BLOCK // max(size, 1), 1)
        for begin in range(0, alike.size, many):
            places = alike[begin : begin + many]
            both = np.empty((places.size, size, count))
            for each, place in zip(both, places, strict=True):
                each[:, :-1], each[:, -1] = every[place]
            whole[places, : min(size, count)] = np.linalg.qr(both, mode="r")
    return whole[:, :, :-1], whole[:, :, -1]


def scaled_least_squares(rows: Samples, target: Samples) -> Samples:
    """Return the (n, ...) least-squares values of scaled columns, for (m, ...) targets."""
    scaled, scale = unit_columns(rows)
    return np.asarray((np.linalg.lstsq(scaled, target, rcond=None)[0].T / scale).T)
