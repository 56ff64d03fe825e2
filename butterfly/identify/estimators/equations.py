"""Residuals of many logs with their derivatives, and the sums that a fit needs of them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from butterfly.identify.estimators.loss import Loss

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Samples = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class LogEquations:
    """One log's residuals, and their derivatives by the scaled parameters as a product.

    Parameters
    ----------
    residuals
        (m,).
    rows, mixture
        (m, k) derivatives by what the simulation knows, and (k, n) of that by the parameters.
    """

    residuals: Samples
    rows: Samples
    mixture: Samples

    @property
    def jacobian(self) -> Samples:
        """(m, n) derivatives of the residuals."""
        return np.asarray(self.rows @ self.mixture)

    def compressed(self, weights: Samples) -> tuple[Samples, Samples]:
        """Return (p, n) rows and (p,) residuals that say of the log what its weighted ones do."""
        root = np.sqrt(weights)[:, None]
        both = np.column_stack([self.rows, self.residuals]) * root
        triangle = np.asarray(np.linalg.qr(both, mode="r"))
        count = self.rows.shape[1]
        return triangle[:count, :count] @ self.mixture, triangle[:count, count]


@dataclass(frozen=True, kw_only=True, eq=False)
class Equations:
    """All logs' equations about one set of parameters.

    Parameters
    ----------
    logs
        One for each.
    loss, scale
        How their residuals count.
    """

    logs: tuple[LogEquations, ...]
    loss: Loss = Loss.LINEAR
    scale: float = 1.0

    def part(self, numbers: Sequence[int], kept: NDArray[np.intp]) -> Equations:
        """Return the equations of some logs in some of the parameters."""
        logs = [self.logs[k] for k in numbers]
        return replace(self, logs=tuple(replace(log, mixture=log.mixture[:, kept]) for log in logs))

    def moved(self, step: Samples) -> Equations:
        """Return what these equations say of the parameters a step away."""
        logs = (
            replace(log, residuals=log.residuals + log.rows @ (log.mixture @ step))
            for log in self.logs
        )
        return replace(self, logs=tuple(logs))

    @cached_property
    def cost(self) -> float:
        """Half of what the residuals count."""
        counted = (self.loss.values(log.residuals, self.scale) for log in self.logs)
        return 0.5 * float(sum(np.sum(each) for each in counted))

    @property
    def gradient(self) -> Samples:
        """(n,) derivatives of the cost."""
        return self._normal[0]

    @property
    def curvature(self) -> Samples:
        """(n, n) second derivatives of the cost, but for those of the residuals."""
        return self._normal[1]

    @cached_property
    def _normal(self) -> tuple[Samples, Samples]:
        parts = [self._of_log(log) for log in self.logs]
        gradients, curvatures = zip(*parts, strict=True)
        return np.sum(gradients, axis=0), np.sum(curvatures, axis=0)

    def _of_log(self, log: LogEquations) -> tuple[Samples, Samples]:
        rows, residuals, mixture = log.rows, log.residuals, log.mixture
        if self.loss is not Loss.LINEAR:
            weights = self.loss.weights(residuals, self.scale)
            rows, residuals = rows * np.sqrt(weights)[:, None], residuals * np.sqrt(weights)
        return mixture.T @ (rows.T @ residuals), mixture.T @ (rows.T @ rows) @ mixture
