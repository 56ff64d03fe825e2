"""Nonlinear least squares over many logs, within bounds and a trust region.

The sums J^T J and J^T r are all that a step needs. Steps are scaled by their effect on the
residuals, so that the units of the values do not matter. Each is the least-squares step within
bounds and a box, the trust region, whose size follows from actual over predicted decrease (Nocedal
& Wright, Numerical Optimization, 2nd ed. 2006, chapters 4 and 10). SciPy's `least_squares` expands
the cost two to ten times as often, as it verifies the last step too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear
from scipy.special import ndtri

from butterfly.arrays import Samples, unit_diagonal
from butterfly.errors import IdentifiabilityError
from butterfly.identification.inference.blocks import CELLS
from butterfly.identification.inference.equations import CellEquations, compressed
from butterfly.identification.levels import (
    MATTERS,
    MOST,
    PRECISE,
    ROUNDING,
    SHOWS,
    SPREADS,
    WEIGHED,
)
from butterfly.model.prior import Penalty
from butterfly.progress import current_search

_NORMAL = 1 / float(ndtri(0.75))  # standard deviation over median absolute deviation
_LAST = 1e-4  # share of the cost that an unverified last step may be predicted to take off
_REMAINDER = 0.1  # share of one residual's mean cost that it may leave
_POOR, _GOOD, _BETTER = 0.25, 0.75, 1.33  # shares of the predicted decrease


class Loss(StrEnum):
    """Loss of residuals over their robust scale (see `scipy.optimize.least_squares`)."""

    LINEAR = "linear"
    SOFT_L1 = "soft_l1"
    HUBER = "huber"
    CAUCHY = "cauchy"

    def values(self, residuals: Samples, scale: float) -> Samples:
        """(n,) loss of residuals in place of their squares; smaller than these above the scale."""
        return np.asarray(scale**2 * _COUNTED[self][0]((residuals / scale) ** 2))

    def weights(self, residuals: Samples, scale: float) -> Samples:
        """(n,) derivatives of `values` by the squares of the residuals."""
        return np.asarray(_COUNTED[self][1]((residuals / scale) ** 2))

    def slopes(self, residuals: Samples, scale: float) -> Samples:
        """(n,) derivatives of `weights` times residuals by the residuals."""
        return np.asarray(_COUNTED[self][2]((residuals / scale) ** 2))


_COUNTED: dict[Loss, tuple[Callable[[Samples], Samples], ...]] = {
    Loss.LINEAR: (lambda z: z, np.ones_like, np.ones_like),
    Loss.SOFT_L1: (
        lambda z: 2 * ((1 + z) ** 0.5 - 1),
        lambda z: (1 + z) ** -0.5,
        lambda z: (1 + z) ** -1.5,
    ),
    Loss.HUBER: (
        lambda z: np.where(z <= 1, z, 2 * z**0.5 - 1),
        lambda z: np.maximum(z, 1.0) ** -0.5,
        lambda z: np.where(z <= 1, 1.0, 0.0),
    ),
    Loss.CAUCHY: (np.log1p, lambda z: 1 / (1 + z), lambda z: (1 - z) / (1 + z) ** 2),
}
"""Of squares over that of the scale: loss, its derivative, and that of the weighted residuals."""


def outlying(residuals: Samples) -> float:
    """Return the size above which one of (n,) residuals counts as an outlier."""
    return SPREADS * _NORMAL * float(np.median(np.abs(residuals)))


@dataclass(frozen=True, kw_only=True, eq=False)
class LogEquations:
    """One log's residuals, and their derivatives by the parameters that they depend on."""

    residuals: Samples  # (m,)
    rows: Samples  # (m, k) derivatives
    columns: NDArray[np.intp]  # (k,) indices of these among all n parameters

    @classmethod
    def relative(
        cls, errors: Samples, rows: Samples, columns: Sequence[int], motion: float
    ) -> LogEquations:
        """Return the equations of (m,) errors over an rms motion, all arrays scaled in place.

        The ``rows`` are (m, k) derivatives by parameters with these numbers; squares sum to a mean.
        """
        unit = 1 / (motion * errors.size**0.5)
        errors *= unit
        rows *= unit
        return cls(residuals=errors, rows=rows, columns=np.array(columns, dtype=np.intp))

    def weighted(self, weights: Samples) -> LogEquations:
        """Return the equations with (m,) weights of the squared residuals."""
        root = np.sqrt(weights)
        return replace(self, residuals=self.residuals * root, rows=self.rows * root[:, None])

    def spread(self, each: Samples, count: int) -> Samples:
        """Return (..., n) arrays over all parameters from (..., k) over this log's; else 0."""
        every = np.zeros((*each.shape[:-1], count))
        every[..., self.columns] = each
        return every

    def compressed(self, cells: int) -> tuple[Samples, Samples]:
        """Return (cells, p, k) rows and (cells, p) residuals of stretches, one after the other."""
        many = self.residuals.size > CELLS * self.rows.shape[1]
        rows, residuals = self._usual if many and cells in {1, CELLS} else self._factors(cells)
        if cells == 1 < len(rows):
            rows, residuals = compressed([(rows.reshape(-1, rows.shape[2]), residuals.ravel())])
        return rows, residuals

    @cached_property
    def _usual(self) -> tuple[Samples, Samples]:
        """Factors of the usual number of cells, which give that of the whole log too."""
        return self._factors(CELLS)

    def _factors(self, cells: int) -> tuple[Samples, Samples]:
        parts = (np.array_split(each, cells) for each in (self.rows, self.residuals))
        return compressed(zip(*parts, strict=True))


@dataclass(frozen=True, kw_only=True, eq=False)
class Equations:
    """All logs' equations about one set of parameters."""

    values: Samples  # (n,) these
    logs: tuple[LogEquations, ...]  # one for each
    prior: Penalty | None = None  # of the parameters
    loss: Loss = Loss.LINEAR  # loss, scale: of the residuals
    scale: float = 1.0
    steps: int = 0  # that their simulations took
    begins: tuple[Samples, ...] = ()  # (s, 2) starts of each log's segments, as they were found

    def counting(self, loss: Loss) -> Equations:
        """Return the equations with a loss, scaled by the scatter of the residuals."""
        if loss is Loss.LINEAR:
            return self
        residuals = np.concatenate([log.residuals for log in self.logs])
        return replace(self, loss=loss, scale=outlying(residuals))

    def prior_weighs_as(self, other: Equations) -> bool:
        """Whether the weights of the prior are nearly those of other equations."""
        if self.prior is None or other.prior is None:
            return True
        mine, theirs = self.prior.weight, other.prior.weight
        return bool((abs(mine - theirs) <= WEIGHED * theirs).all())

    def moved(self, step: Samples) -> Equations:
        """Return the linear equations about the values an (n,) step away."""
        logs = (
            replace(log, residuals=log.residuals + log.rows @ step[log.columns])
            for log in self.logs
        )
        return replace(self, values=self.values + step, logs=tuple(logs))

    @cached_property
    def cost(self) -> float:
        """Half the loss and the penalty of the prior; infinite or NaN if a simulation diverged."""
        with np.errstate(over="ignore", invalid="ignore"):
            counted = [self.loss.values(log.residuals, self.scale) for log in self.logs]
            of_logs = 0.5 * float(sum(np.sum(each) for each in counted))
        return of_logs if self.prior is None else of_logs + self.prior.cost(self.values)

    @property
    def is_finite(self) -> bool:
        """Whether cost, gradient and curvature are finite: no simulation diverged."""
        with np.errstate(over="ignore", invalid="ignore"):
            every = np.append(self.curvature, [*self.gradient, self.cost])
            return bool(np.isfinite(every).all())

    @cached_property
    def gradient(self) -> Samples:
        """(n,) derivatives of the cost."""
        total = np.zeros(self.values.size)
        for log in self._weighted:
            total[log.columns] += log.rows.T @ log.residuals
        return total if self.prior is None else total + self.prior.gradient(self.values)

    @cached_property
    def curvature(self) -> Samples:
        """(n, n) Gauss-Newton approximation of the second derivatives of the cost."""
        return self._summed((log, log.rows.T @ log.rows) for log in self._weighted)

    @property
    def bread(self) -> Samples:
        """(n, n) derivatives of the gradient, those of the weights of a robust loss included."""
        slopes = (self.loss.slopes(log.residuals, self.scale)[:, None] for log in self.logs)
        return self._summed(
            (log, (log.rows * each).T @ log.rows)
            for log, each in zip(self.logs, slopes, strict=True)
        )

    def _summed(self, parts: Iterable[tuple[LogEquations, Samples]]) -> Samples:
        total = np.zeros((self.values.size, self.values.size))
        for log, part in parts:
            total[np.ix_(log.columns, log.columns)] += part
        return total if self.prior is None else total + self.prior.curvature

    def compressed(self, cells: int) -> tuple[Samples, Samples]:
        """Return (k, p, n) rows and (k, p) residuals of all k cells, weighted by the loss."""
        factors = [log.compressed(cells) for log in self._weighted]
        most = max(left.shape[1] for _, left in factors)
        rows = np.zeros((len(factors), cells, most, self.values.size))
        residuals = np.zeros((len(factors), cells, most))
        for k, (log, (part, left)) in enumerate(zip(self.logs, factors, strict=True)):
            rows[k, :, : left.shape[1]] = log.spread(part, self.values.size)
            residuals[k, :, : left.shape[1]] = left
        return rows.reshape(-1, *rows.shape[2:]), residuals.reshape(-1, most)

    def cells(self, names: tuple[str, ...], lower: Samples, count: int) -> CellEquations:
        """Return the equations of ``count`` cells of each log, of n names and lower bounds."""
        rows, residuals = self.compressed(count)
        return CellEquations(
            names=names,
            values=self.values,
            lower=lower,
            on_bound=self.values <= lower,
            rows=rows,
            residuals=residuals,
            log=np.repeat(np.arange(len(self.logs)), count),
            prior=self.prior,
        )

    @cached_property
    def _weighted(self) -> tuple[LogEquations, ...]:
        if self.loss is Loss.LINEAR:
            return self.logs
        weights = (self.loss.weights(log.residuals, self.scale) for log in self.logs)
        return tuple(log.weighted(each) for log, each in zip(self.logs, weights, strict=True))

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
        left = -pull - rows[:, ~free] @ step[~free]
        step[free] = lsq_linear(rows[:, free], left, box, method="bvls", tol=1e-12).x
        return np.asarray(step / size)

    def in_steps(self, directions: Samples) -> Equations:
        """Return the equations in d step lengths, now 0, along (n, d) directions."""
        columns = np.arange(directions.shape[1])
        logs = (
            replace(log, rows=log.rows @ directions[log.columns], columns=columns)
            for log in self.logs
        )
        return replace(self, values=np.zeros(columns.size), logs=tuple(logs))

    def directions(self, count: int) -> Samples:
        """Return (n, d) orthogonal changes of the first values that move the residuals by 1."""
        scaled, size = unit_diagonal(self.curvature[:count, :count])
        curvatures, axes = np.linalg.eigh(scaled)
        determined = curvatures > ROUNDING * curvatures[-1]
        changes = np.zeros((self.values.size, np.count_nonzero(determined)))
        changes[:count] = axes[:, determined] / np.sqrt(curvatures[determined]) / size[:, None]
        return changes

    def reduced(self, directions: Samples) -> Equations:
        """Return the equations after the optimal step along (n, d) `directions`."""
        return self.moved(-directions @ (directions.T @ self.gradient))


@dataclass(frozen=True, kw_only=True, eq=False)
class Minimum:
    """Where a descent ended."""

    at: Equations  # about the (n,) values there, by the last expansion
    converged: bool  # whether no further decrease is predicted
    evaluations: int  # how often the cost was expanded
    too_stiff: bool = False  # whether it took all steps that it was given

    @property
    def values(self) -> Samples:
        """(n,) values of the parameters."""
        return self.at.values


Expand = Callable[[Samples, Equations], Equations]
"""From (n,) values, and the equations that a step leads from, to the equations about them."""


class Box(NamedTuple):
    """Bounds of values and of their steps."""

    lower: Samples  # (n,) lower bounds
    share: Samples | float = np.inf  # (n,) largest relative change in one step
    # (n,) which a value never reaches, so that a step takes it at most nine tenths of the way
    origin: Samples | float = -np.inf

    def about(self, values: Samples, most: Samples | float) -> tuple[Samples, Samples]:
        """Return the (n,) lower and upper limits of a step from values, at most ``most``."""
        with np.errstate(invalid="ignore"):
            room = np.fmin(most, self.share * abs(values))
        least = np.maximum(self.lower - values, -(1 - PRECISE) * (values - self.origin))
        return np.maximum(least, -room), np.broadcast_to(room, values.shape)


def minimise(
    expand: Expand,
    at: Equations,
    box: Box,
    most: int = MOST,
    enough: float = ROUNDING,
    *,
    steps: float = np.inf,
) -> Minimum:
    """Descend from equations about the (n,) first values to a minimum, in ``most`` expansions.

    Those take no more than so many ``steps`` of simulations, the last one aside.
    Where the cost curves more along a step than its derivatives predict, the next one is shorter by
    as much. Once predictions are right and decrease fast, the last step is taken without expanding
    the cost there; the descent ends before, where a step predicts or takes no more than a share
    ``enough`` of the cost. Where the trust region has shrunk, it has converged only if no step out
    of it predicts a decrease. IdentifiabilityError if the first equations are not finite.
    """
    if not at.is_finite:
        raise IdentifiabilityError(
            "the simulation diverges at the initial parameters of the fit, so they are not those "
            "of a joint"
        )
    size, evaluations, taken = np.sqrt(np.diag(at.curvature)), 0, 0
    unit = np.where(size > 0, 1 / np.where(size > 0, size, 1.0), np.maximum(abs(at.values), SHOWS))
    radius = max(float(np.linalg.norm(at.values / unit)), 1.0)
    rho, last, bends, search = 0.0, np.inf, 1.0, current_search()  # rho: actual over predicted
    while evaluations < most and last > enough * at.cost and not search.over and taken < steps:
        whole = at.step(*box.about(at.values, radius * unit))
        step, of_whole = whole / bends, at.decrease(whole)
        longest = float(abs(whole / unit).max())
        there = np.maximum(at.values + step, box.lower)
        within = longest < (1 - ROUNDING) * radius
        if within and (_is_last(at, of_whole, last, rho, bends) or longest < ROUNDING):
            end = replace(at.moved(there - at.values), values=there)
            return Minimum(at=end, converged=True, evaluations=evaluations)
        if (within and of_whole <= enough * at.cost) or (not within and radius < ROUNDING):
            break
        tried = replace(expand(there, at), prior=at.prior)
        evaluations += 1
        taken += tried.steps
        predicted, longest = at.decrease(step), longest / bends
        rho = (at.cost - tried.cost) / predicted if tried.is_finite else -np.inf
        if rho > _POOR:
            bends = max(1.0, 1 + (1 - rho) * predicted / (0.5 * float(step @ at.curvature @ step)))
        if rho < _POOR:
            radius = _POOR * longest
        elif rho > _GOOD and longest >= (1 - ROUNDING) * radius:
            radius *= 2
        if rho > 0:
            last = at.cost - tried.cost
            at = tried
    predicted = at.decrease(at.step(*box.about(at.values, np.inf)))
    converged = evaluations < most and taken < steps and predicted <= max(enough, MATTERS) * at.cost
    return Minimum(at=at, converged=converged, evaluations=evaluations, too_stiff=taken >= steps)


def _is_last(at: Equations, predicted: float, last: float, rho: float, bends: float) -> bool:
    """Whether a step's predicted decrease is so small that the cost after it is not verified."""
    left = _REMAINDER * at.cost * last / sum(log.residuals.size for log in at.logs)
    small = predicted <= _LAST * at.cost and predicted**2 < left
    # a shortened step leaves a share of what the whole one predicts
    sure = predicted * (bends - 1) ** 2 <= _LAST**2 * at.cost
    return (_GOOD < rho < _BETTER and small and sure) or predicted <= ROUNDING * at.cost


def minimise_robustly(
    expand: Expand,
    at: Equations,
    box: Box,
    loss: Loss,
    *,
    most: int,
    enough: float,
    steps: float = np.inf,
) -> Minimum:
    """Descend to the least squares, if the loss is linear yet, then to the minimum of a loss."""
    spent = 0
    if at.loss is Loss.LINEAR:
        unweighted = minimise(expand, at, box, most, enough, steps=steps)
        if loss is Loss.LINEAR:
            return unweighted
        at, spent = unweighted.at.counting(loss), unweighted.evaluations

    def counted(values: Samples, here: Equations) -> Equations:
        return replace(expand(values, here), loss=loss, scale=at.scale)

    found = minimise(counted, at, box, MOST, enough, steps=steps)
    return replace(found, evaluations=spent + found.evaluations)
