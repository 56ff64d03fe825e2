"""Residuals of many logs with their derivatives, how much they count, and their sums."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from butterfly.identification.prior import Prior

Samples = NDArray[np.float64]
_NORMAL = 1.4826  # standard deviation over median absolute deviation
_OUTLYING = 1.5  # robust standard deviations beyond which a residual is taken for an outlier


class Loss(StrEnum):
    """How residuals, in robust standard deviations, count (see `scipy.optimize.least_squares`)."""

    LINEAR = "linear"
    SOFT_L1 = "soft_l1"
    HUBER = "huber"
    CAUCHY = "cauchy"

    def values(self, residuals: Samples, scale: float) -> Samples:
        """(n,) what residuals count in the place of their squares.

        ``residuals``: (n,); ``scale``: size from which on a residual counts less.
        """
        squares = (residuals / scale) ** 2
        match self:
            case Loss.SOFT_L1:
                counted = 2 * ((1 + squares) ** 0.5 - 1)
            case Loss.HUBER:
                counted = np.where(squares <= 1, squares, 2 * squares**0.5 - 1)
            case Loss.CAUCHY:
                counted = np.log1p(squares)
            case Loss.LINEAR:
                counted = squares
        return np.asarray(scale**2 * counted)

    def weights(self, residuals: Samples, scale: float) -> Samples:
        """(n,) slopes of `values` in the squares of the residuals."""
        squares = (residuals / scale) ** 2
        match self:
            case Loss.SOFT_L1:
                return np.asarray((1 + squares) ** -0.5)
            case Loss.HUBER:
                return np.asarray(np.maximum(squares, 1.0) ** -0.5)
            case Loss.CAUCHY:
                return np.asarray(1 / (1 + squares))
            case Loss.LINEAR:
                return np.ones_like(residuals)

    def slopes(self, residuals: Samples, scale: float) -> Samples:
        """(n,) slopes of the weighted residuals, `weights` times residuals, in the residuals."""
        squares = (residuals / scale) ** 2
        match self:
            case Loss.SOFT_L1:
                return np.asarray((1 + squares) ** -1.5)
            case Loss.HUBER:
                return np.asarray(squares <= 1, dtype=np.float64)
            case Loss.CAUCHY:
                return np.asarray((1 - squares) / (1 + squares) ** 2)
            case Loss.LINEAR:
                return np.ones_like(residuals)


def outlying(residuals: Samples) -> float:
    """Return the size from which on one of (n,) residuals is taken for an outlier."""
    return _OUTLYING * _NORMAL * float(np.median(np.abs(residuals)))


@dataclass(frozen=True, kw_only=True, eq=False)
class LogEquations:
    """One log's residuals, and their derivatives by the scaled parameters as a product."""

    residuals: Samples  # (m,)
    # rows, mixture: (m, k) derivatives by what the simulation knows, and (k, n) of that by the
    # parameters
    rows: Samples
    mixture: Samples

    @property
    def jacobian(self) -> Samples:
        """(m, n) derivatives of the residuals."""
        return np.asarray(self.rows @ self.mixture)

    def weighted(self, weights: Samples) -> LogEquations:
        """Return the equations, the squares of each of m counting so many times."""
        root = np.sqrt(weights)
        return replace(self, residuals=self.residuals * root, rows=self.rows * root[:, None])

    def blocks(self, count: int) -> list[LogEquations]:
        """Return the equations of some stretches of the log, one after the other."""
        pairs = zip(
            np.array_split(self.residuals, count), np.array_split(self.rows, count), strict=True
        )
        return [replace(self, residuals=residuals, rows=rows) for residuals, rows in pairs]

    def compressed(self) -> tuple[Samples, Samples]:
        """Return (p, n) rows and (p,) residuals that say of the log what its own ones do."""
        both = np.column_stack([self.rows, self.residuals])
        triangle = np.asarray(np.linalg.qr(both, mode="r"))
        count = self.rows.shape[1]
        return triangle[:count, :count] @ self.mixture, triangle[:count, count]


@dataclass(frozen=True, kw_only=True, eq=False)
class Equations:
    """All logs' equations about one set of parameters."""

    logs: tuple[LogEquations, ...]  # one for each
    loss: Loss = Loss.LINEAR  # loss, scale: how their residuals count
    scale: float = 1.0
    # what is known of the parameters besides, and the (n,) values that these equations are about
    known: tuple[Prior, Samples] | None = None

    def part(self, numbers: Sequence[int], kept: NDArray[np.intp]) -> Equations:
        """Return the equations of some logs in some of the parameters."""
        logs = [self.logs[k] for k in numbers]
        known = None if self.known is None else (self.known[0].take(kept), self.known[1][kept])
        mixed = tuple(replace(log, mixture=log.mixture[:, kept]) for log in logs)
        return replace(self, logs=mixed, known=known)

    def cut(self, stretches: int) -> Equations:
        """Return the equations of some stretches of time of each log, as if they were logs."""
        return replace(
            self, logs=tuple(part for log in self.logs for part in log.blocks(stretches))
        )

    def moved(self, step: Samples) -> Equations:
        """Return what these equations say of the parameters a step away."""
        logs = (
            replace(log, residuals=log.residuals + log.rows @ (log.mixture @ step))
            for log in self.logs
        )
        known = None if self.known is None else (self.known[0], self.known[1] + step)
        return replace(self, logs=tuple(logs), known=known)

    @property
    def count(self) -> int:
        """How many residuals there are."""
        return sum(log.residuals.size for log in self.logs)

    @cached_property
    def cost(self) -> float:
        """Half of what the residuals count; infinite or NaN if a simulation diverged."""
        with np.errstate(over="ignore", invalid="ignore"):
            counted = [self.loss.values(log.residuals, self.scale) for log in self.logs]
            of_logs = 0.5 * float(sum(np.sum(each) for each in counted))
        return of_logs if self.known is None else of_logs + self.known[0].cost(self.known[1])

    @property
    def gradient(self) -> Samples:
        """(n,) derivatives of the cost."""
        of_logs = np.asarray(self.gradients.sum(axis=0))
        return of_logs if self.known is None else of_logs + self.known[0].gradient(self.known[1])

    @property
    def curvature(self) -> Samples:
        """(n, n) second derivatives of the cost, but for those of the residuals."""
        of_logs = np.asarray(self.curvatures.sum(axis=0))
        return of_logs if self.known is None else of_logs + self.known[0].curvature

    @property
    def gradients(self) -> Samples:
        """(k, n) share of each log in the gradient."""
        return self._normal[0]

    @property
    def curvatures(self) -> Samples:
        """(k, n, n) share of each log in the curvature."""
        return self._normal[1]

    @property
    def squares(self) -> Samples:
        """(k,) squared residuals of each log, weighted as its loss says."""
        return np.array([float(log.residuals @ log.residuals) for log in self._weighted()])

    @cached_property
    def _normal(self) -> tuple[Samples, Samples]:
        parts = [_normal(log) for log in self._weighted()]
        gradients, curvatures = zip(*parts, strict=True)
        return np.array(gradients), np.array(curvatures)

    def compressed(self, blocks: int = 1) -> list[tuple[Samples, Samples]]:
        """Return for each log, or block, what it comes down to, weighted as its loss says."""
        return [part.compressed() for log in self._weighted() for part in log.blocks(blocks)]

    @property
    def bread(self) -> Samples:
        """(n, n) derivatives of the gradient as a robust loss has them, its weights moving too."""
        parts = (
            (log.rows * self.loss.slopes(log.residuals, self.scale)[:, None], log)
            for log in self.logs
        )
        of_logs = np.asarray(
            sum(log.mixture.T @ (sloped.T @ log.rows) @ log.mixture for sloped, log in parts)
        )
        return of_logs if self.known is None else of_logs + self.known[0].curvature

    def _weighted(self) -> Iterator[LogEquations]:
        for log in self.logs:
            if self.loss is Loss.LINEAR:
                yield log
            else:
                yield log.weighted(self.loss.weights(log.residuals, self.scale))


def _normal(log: LogEquations) -> tuple[Samples, Samples]:
    """(n,) J^T r and (n, n) J^T J of one log."""
    rows, residuals, mixture = log.rows, log.residuals, log.mixture
    return mixture.T @ (rows.T @ residuals), mixture.T @ (rows.T @ rows) @ mixture
