"""Equations of logs that are linear in a change of some values: what all fits and inference use.

A `Regression` is linear in the parameters themselves. A `Linearisation` has the residuals r of logs
about some values, and their derivatives J: all rows of each log, or those of its `cells`. A cell is
a log, or a tenth of one in time, reduced to the triangular factor of [J | r], which gives J^T J,
J^T r and r^T r of the cell exactly.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from butterfly.arrays import BLOCK, ROUNDING, Samples, joined, unit_columns, unit_diagonal
from butterfly.errors import IdentifiabilityError
from butterfly.identification.limits import (
    CELLS,
    WEIGHED,
    Conditioning,
    cluster_covariance,
    half_widths,
)
from butterfly.identification.loss import Loss, outlying
from butterfly.identification.trust import FEW
from butterfly.model.prior import Penalty
from butterfly.model.terms import TERMS, lower_bounds
from butterfly.signals.frequency_response import white_variance

_NOISE = 0.25  # of the squared error, below which white noise is the lesser part of it


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

    def linearised(
        self, solution: Solution, *, cells: int = 1, jacobian: Samples | None = None
    ) -> Linearisation:
        """Return the equations about a solution in cells; ``jacobian``: (m, n), if another."""
        values = solution.values
        derived = self.jacobian(values) if jacobian is None else jacobian
        order = np.argsort(self.cluster, kind="stable")
        log, counts = np.unique(self.cluster, return_counts=True)
        return Linearisation(
            names=self.names,
            values=values,
            lower=self.lower,
            held=solution.on_bound,
            rows=derived[order],
            residuals=self.residuals(values)[order],
            ends=np.cumsum(counts),
            log=log,
            prior=self.prior,
        ).cells(cells)

    def at(self, values: Mapping[str, float]) -> Solution:
        """Return values by name, 0 of other parameters, as a solution without active bounds."""
        vector = np.array([values.get(name, 0.0) for name in self.names])
        return Solution(values=vector, on_bound=np.zeros(vector.size, dtype=bool))

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
class Linearisation:
    """Residuals of logs about n values, and their derivatives by these, in k blocks of rows.

    A block is a log, or a cell of one. The unknowns may be a problem's values or lengths of steps.
    """

    names: tuple[str, ...]  # of the n values; those that all logs share come first
    values: Samples  # (n,)
    lower: Samples  # (n,) lower bounds
    rows: Samples  # (m, n) derivatives
    residuals: Samples  # (m,)
    ends: NDArray[np.intp]  # (k,) number of rows up to the end of each block
    log: NDArray[np.intp]  # (k,) number of each block's log; blocks of a log are in order of time
    held: NDArray[np.bool_] | None = None  # (n,) if others than those on their lower bound
    prior: Penalty | None = None  # of the values that were known with an uncertainty
    loss: Loss = Loss.LINEAR  # loss, scale: of the residuals
    scale: float = 1.0
    steps: int = 0  # that their simulations took
    begins: tuple[Samples, ...] = ()  # (s, 2) starts of each log's segments, as they were found

    @classmethod
    def of_logs(
        cls, parts: Sequence[tuple[Samples, Samples]], names: tuple[str, ...], values: Samples
    ) -> Linearisation:
        """Return the equations of k logs: (m,) residuals of each, with (m, n) derivatives."""
        residuals, rows = zip(*parts, strict=True)
        return cls(
            names=names,
            values=values,
            lower=lower_bounds(names),
            rows=joined(rows),
            residuals=joined(residuals),
            ends=np.cumsum([errors.size for errors in residuals]),
            log=np.arange(len(parts)),
        )

    def counting(self, loss: Loss) -> Linearisation:
        """Return the equations with a loss, scaled by the scatter of the residuals."""
        if loss is Loss.LINEAR:
            return self
        return replace(self, loss=loss, scale=outlying(self.residuals))

    def moved(self, step: Samples) -> Linearisation:
        """Return the linear equations about the values an (n,) step away."""
        residuals = self.residuals + self.rows @ step
        return replace(self, values=self.values + step, residuals=residuals)

    def along(self, directions: Samples, names: tuple[str, ...]) -> Linearisation:
        """Return the equations in d step lengths, now 0, along (n, d) directions."""
        count = directions.shape[1]
        return replace(
            self,
            names=names,
            values=np.zeros(count),
            lower=lower_bounds(names),
            held=None,
            rows=self.rows @ directions,
        )

    def without(self, logs: Iterable[int]) -> Linearisation:
        """Return the equations without some logs, by their numbers."""
        blocks = ~np.isin(self.log, list(logs))
        sizes = np.diff(self.ends, prepend=0)
        rows = np.repeat(blocks, sizes)
        return replace(
            self,
            rows=self.rows[rows],
            residuals=self.residuals[rows],
            ends=np.cumsum(sizes[blocks]),
            log=self.log[blocks],
        )

    @property
    def named(self) -> dict[str, float]:
        """The values by name."""
        return dict(zip(self.names, self.values.tolist(), strict=True))

    @property
    def on_bound(self) -> NDArray[np.bool_]:
        """(n,) which values are held: on an active bound."""
        return self.values <= self.lower if self.held is None else self.held

    @cached_property
    def weighted(self) -> tuple[Samples, Samples]:
        """(m, n) rows and (m,) residuals, weighted as the loss weighs them."""
        if self.loss is Loss.LINEAR:
            return self.rows, self.residuals
        roots = np.sqrt(self.loss.weights(self.residuals, self.scale))
        return self.rows * roots[:, np.newaxis], self.residuals * roots

    @property
    def by_log(self) -> list[Samples]:
        """(m,) residuals of each of the k blocks."""
        return np.split(self.residuals, self.ends[:-1])

    @property
    def white_cost(self) -> float:
        """The cost that white noise as rough as the residuals of the logs would have."""
        return sum(0.5 * errors.size * white_variance(errors) for errors in self.by_log)

    @property
    def is_misfit(self) -> bool:
        """Whether most of the error is no noise: twice what white noise as rough would be."""
        return self.white_cost < _NOISE * 0.5 * float(self.residuals @ self.residuals)

    @cached_property
    def cost(self) -> float:
        """Half the loss and the penalty of the prior; infinite or NaN if a simulation diverged."""
        with np.errstate(over="ignore", invalid="ignore"):
            of_logs = 0.5 * float(np.sum(self.loss.values(self.residuals, self.scale)))
        return of_logs if self.prior is None else of_logs + self.prior.cost(self.values)

    @cached_property
    def gradient(self) -> Samples:
        """(n,) derivatives of the cost."""
        rows, residuals = self.weighted
        total = rows.T @ residuals
        return total if self.prior is None else total + self.prior.gradient(self.values)

    @cached_property
    def curvature(self) -> Samples:
        """(n, n) Gauss-Newton approximation of the second derivatives of the cost."""
        rows, _ = self.weighted
        return rows.T @ rows if self.prior is None else rows.T @ rows + self.prior.curvature

    @property
    def bread(self) -> Samples:
        """(n, n) derivatives of the gradient, those of the weights of a robust loss included."""
        slopes = self.loss.slopes(self.residuals, self.scale)
        total = (self.rows * slopes[:, np.newaxis]).T @ self.rows
        return total if self.prior is None else total + self.prior.curvature

    @property
    def is_finite(self) -> bool:
        """Whether cost, gradient and curvature are finite: no simulation diverged."""
        with np.errstate(over="ignore", invalid="ignore"):
            every = np.append(self.curvature, [*self.gradient, self.cost])
            return bool(np.isfinite(every).all())

    def prior_weighs_as(self, other: Linearisation) -> bool:
        """Whether the weights of the prior are nearly those of other equations."""
        if self.prior is None or other.prior is None:
            return True
        mine, theirs = self.prior.weight, other.prior.weight
        return bool((abs(mine - theirs) <= WEIGHED * theirs).all())

    def decrease(self, step: Samples) -> float:
        """Return the decrease of the cost that its derivatives predict for an (n,) step."""
        return -float(self.gradient @ step + 0.5 * step @ self.curvature @ step)

    def step(self, lowest: Samples, highest: Samples) -> Samples:
        """Return the (n,) step that minimises the quadratic cost within a box."""
        scaled, size = unit_diagonal(self.curvature)
        curvatures, axes = np.linalg.eigh(scaled)
        determined = curvatures > ROUNDING**2 * curvatures[-1]
        roots = np.sqrt(np.where(determined, curvatures, 0.0))
        pull = np.divide(axes.T @ (self.gradient / size), roots, out=0 * roots, where=determined)
        rows, step = roots[:, None] * axes.T, lowest * size
        free = lowest < highest  # the others are held: `lsq_linear` refuses a box without width
        box = step[free], (highest * size)[free]
        target = -pull - rows[:, ~free] @ step[~free]
        step[free] = lsq_linear(rows[:, free], target, box, method="bvls", tol=1e-12).x
        return np.asarray(step / size)

    def directions(self, count: int) -> Samples:
        """Return (n, d) orthogonal changes of the first values that move the residuals by 1."""
        scaled, size = unit_diagonal(self.curvature[:count, :count])
        curvatures, axes = np.linalg.eigh(scaled)
        determined = curvatures > ROUNDING * curvatures[-1]
        changes = np.zeros((self.values.size, np.count_nonzero(determined)))
        changes[:count] = axes[:, determined] / np.sqrt(curvatures[determined]) / size[:, None]
        return changes

    @cached_property
    def free(self) -> NDArray[np.bool_]:
        """(n,) which values are on no bound, and affect the residuals or are known."""
        return ~self.on_bound & (np.diag(self.curvature) > 0)

    @cached_property
    def inverse(self) -> Samples:
        """(n, n) pseudo-inverse of the curvature of the `free` values; 0 elsewhere."""
        scaled, size = unit_diagonal(self.curvature)
        block = np.ix_(self.free, self.free)
        inverse = np.zeros_like(scaled)
        rounding = float(np.finfo(float).eps) * np.count_nonzero(self.free)
        inverse[block] = np.linalg.pinv(scaled[block], rcond=rounding)
        return inverse / np.outer(size, size)

    @property
    def next_step(self) -> Samples:
        """(n,) Gauss-Newton step of the `free` values; 0 of the others."""
        return -self.inverse @ self.gradient

    @property
    def with_prior(self) -> tuple[Samples, Samples]:
        """(m, n) rows and (m,) residuals, those of the prior included."""
        if self.prior is None:
            return self.rows, self.residuals
        more, target = self.prior.rows()
        residuals = np.append(self.residuals, more @ self.values - target)
        return np.concatenate([self.rows, more]), residuals

    def cells(self, count: int) -> Linearisation:
        """Return the weighted equations of ``count`` stretches of each block, n + 1 rows each."""
        sizes = np.diff(self.ends, prepend=0)
        many = sizes.size > 0 and bool((sizes > CELLS * len(self.names)).all())
        many = many and count in {1, CELLS}
        rows, residuals = self._usual if many else self._factors(count)
        if many and count == 1:
            shape = (self.ends.size, -1)
            rows, residuals = compressed(
                zip(rows.reshape(*shape, rows.shape[2]), residuals.reshape(*shape), strict=True)
            )
        return replace(
            self,
            rows=rows.reshape(-1, rows.shape[2]),
            residuals=residuals.ravel(),
            ends=rows.shape[1] * np.arange(1, len(rows) + 1),
            log=np.repeat(self.log, count),
            loss=Loss.LINEAR,
        )

    @cached_property
    def _usual(self) -> tuple[Samples, Samples]:
        """Factors of the usual number of cells, which give that of the whole log too."""
        return self._factors(CELLS)

    def _factors(self, count: int) -> tuple[Samples, Samples]:
        """(k, p, n) rows and (k, p) residuals of ``count`` stretches of each block."""
        parts = (np.split(array, self.ends[:-1]) for array in self.weighted)
        return compressed(
            stretch
            for rows, residuals in zip(*parts, strict=True)
            for stretch in zip(
                np.array_split(rows, count), np.array_split(residuals, count), strict=True
            )
        )

    @cached_property
    def whole_logs(self) -> Linearisation:
        """The same cells joined, each log one."""
        last = np.append(np.diff(self.log) != 0, [True])
        if last.all():
            return self
        return replace(self, ends=self.ends[last], log=self.log[last]).cells(1)

    @cached_property
    def independent(self) -> Linearisation:
        """The same in cells whose errors are independent: logs, or stretches of few logs."""
        return self.whole_logs if np.unique(self.log).size > FEW else self

    @property
    def conditioning(self) -> Conditioning:
        """How well the rows and the prior separate the values."""
        active = None if self.prior is None else self.prior.active
        return Conditioning.of(self.rows, self.names, active, (self.values, self.residuals))

    @property
    def half_widths(self) -> Samples:
        """(n,) half-widths of the values' intervals by the scatter between independent cells."""
        cells = self.independent
        return half_widths(*cluster_covariance(*cells.stack, cells.prior))

    @cached_property
    def stack(self) -> tuple[Samples, Samples]:
        """(k, p, n) rows and (k, p) residuals of k cells of one size."""
        count = self.ends.size
        return self.rows.reshape(count, -1, len(self.names)), self.residuals.reshape(count, -1)

    @cached_property
    def curvatures(self) -> Samples:
        """(k, n, n): J^T J of each cell."""
        rows, _ = self.stack
        return np.asarray(np.swapaxes(rows, 1, 2) @ rows)

    @cached_property
    def gradients(self) -> Samples:
        """(k, n): J^T r of each cell."""
        return np.asarray(np.einsum("kmn,km->kn", *self.stack))

    @cached_property
    def squares(self) -> Samples:
        """(k,): r^T r of each cell."""
        return np.asarray(np.sum(self.stack[1] ** 2, axis=1))

    def orthogonalised(self, changes: Samples) -> tuple[Samples, Samples]:
        """Return (k, n) changes, values partialled out, and (k,) information; 0 if collinear."""
        pulls = np.einsum("kmn,kn->km", self.curvatures, changes)
        rest = changes - self.inverse @ pulls.sum(axis=0)
        information = np.einsum("kn,kmn,km->k", rest, self.curvatures, rest)
        identifiable = information.sum() > ROUNDING * np.sum(changes * pulls)
        return (rest, information) if identifiable else (np.zeros_like(rest), np.zeros(len(rest)))

    @property
    def realised_variance(self) -> float:
        """Variance of a row by the scatter between cells.

        Errors that are correlated within a cell count as fewer rows, each of a larger variance. It
        is at least the variance in the direction of each parameter that has a prior, the other
        parameters partialled out.
        """
        cells = self.independent
        flat, (stack, residuals) = cells.rows, cells.stack
        basis, singular, _ = np.linalg.svd(unit_columns(flat)[0], full_matrices=False)
        span = basis[:, singular > ROUNDING * singular.max(initial=0.0)]
        if not span.size:
            raise IdentifiabilityError("no parameter is identifiable from these logs")
        covariance, _ = cluster_covariance(span.reshape(*stack.shape[:2], -1), residuals)
        variance = float(np.mean(np.diag(covariance)))
        for k in () if self.prior is None else np.flatnonzero(self.prior.active):
            others = np.delete(flat, k, axis=1)
            res = flat[:, k] - others @ scaled_least_squares(others, flat[:, k])
            if res @ res > ROUNDING * (flat[:, k] @ flat[:, k]):
                along = np.einsum("km,km->k", res.reshape(residuals.shape), residuals)
                variance = max(variance, float(along @ along / (res @ res)))
        return variance


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
            for cell, place in zip(both, places, strict=True):
                cell[:, :-1], cell[:, -1] = every[place]
            whole[places, : min(size, count)] = np.linalg.qr(both, mode="r")
    return whole[:, :, :-1], whole[:, :, -1]


def scaled_least_squares(rows: Samples, target: Samples) -> Samples:
    """Return the (n, ...) least-squares values of scaled columns, for (m, ...) targets."""
    scaled, scale = unit_columns(rows)
    return np.asarray((np.linalg.lstsq(scaled, target, rcond=None)[0].T / scale).T)
