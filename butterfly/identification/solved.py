"""A solver's end, and the equations about it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from butterfly.identification.diagnostics.findings import Ending, Finding
from butterfly.identification.inference.covariance import cluster_covariance, compress_all
from butterfly.identification.prior import Prior
from butterfly.identification.regression import Regression, Solution

_TOLD = 1e-7  # of the scaled equations, below which a combination is not determined
_WELL = 3.0  # standard errors


@dataclass(frozen=True, kw_only=True, eq=False)
class Solved:
    """A solver's end: n values that m equations determine, and the equations about them."""

    names: tuple[str, ...]  # of the n values; those that all logs share come first
    values: NDArray[np.float64]  # (n,)
    # jacobian, residuals: (m, n) derivatives by the values, and (m,) residuals, weighted as the
    # solver weighs them
    jacobian: NDArray[np.float64]
    residuals: NDArray[np.float64]
    # (m,) numbers of the logs, or stretches, between which errors are independent
    cluster: NDArray[np.intp]
    on_bound: NDArray[np.bool_]  # (n,) whether a bound holds the value
    lower: NDArray[np.float64]  # (n,) least values
    ending: Ending = Ending.CONVERGED  # how the solver ended
    findings: tuple[Finding, ...] = ()  # what it has to say besides
    # (n, n) derivatives of the gradient, where the weights depend on the residuals
    bread: NDArray[np.float64] | None = None
    prior: Prior | None = None  # what was known of the values with an uncertainty

    @classmethod
    def of(
        cls, regression: Regression, solution: Solution, *, unsettled: Finding | None = None
    ) -> Solved:
        """Take a regression and its solution; ``unsettled`` says how an iteration was stopped."""
        return cls(
            names=regression.names,
            values=solution.values,
            jacobian=regression.jacobian(solution.values),
            residuals=regression.residuals(solution.values),
            cluster=regression.cluster,
            on_bound=solution.on_bound,
            lower=regression.lower,
            ending=Ending.STOPPED if unsettled else Ending.CONVERGED,
            findings=(unsettled,) if unsettled else (),
            prior=regression.prior,
        )

    def beside(self, other: Solved) -> Solved:
        """Return these equations and others of other values, of the same clusters, as one."""
        (mine, own), (theirs, further) = self.jacobian.shape, other.jacobian.shape
        jacobian = np.zeros((mine + theirs, own + further))
        jacobian[:mine, :own] = self.jacobian
        jacobian[mine:, own:] = other.jacobian
        return replace(
            self,
            names=(*self.names, *other.names),
            values=np.append(self.values, other.values),
            jacobian=jacobian,
            residuals=np.append(self.residuals, other.residuals),
            cluster=np.append(self.cluster, other.cluster),
            on_bound=np.append(self.on_bound, other.on_bound),
            lower=np.append(self.lower, other.lower),
            prior=None if self.prior is None else self.prior.padded(further),
        )

    @property
    def realised_variance(self) -> float:
        """Variance of a row as the scatter of the clusters realises it: 1 per parameter if right.

        Of independent equal errors it is theirs; errors that are alike within a cluster count for
        fewer rows, which is a larger variance of each.
        """
        rows, residuals = self.by_cluster()
        flat = rows.reshape(-1, rows.shape[2])
        size = np.linalg.norm(flat, axis=0)
        basis, singular, _ = np.linalg.svd(
            flat / np.where(size > 0, size, 1.0), full_matrices=False
        )
        told = basis[:, singular > _TOLD * singular[0]]
        covariance, _ = cluster_covariance(told.reshape(*rows.shape[:2], -1), residuals)
        return float(np.mean(np.diag(covariance)))

    def with_prior(
        self, rows: NDArray[np.float64], residuals: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (m, n) rows and (m,) residuals of all clusters, and of what was known besides."""
        flat, left = rows.reshape(-1, rows.shape[2]), residuals.reshape(-1)
        if self.prior is None:
            return flat, left
        more, target = self.prior.rows()
        return np.concatenate([flat, more]), np.append(left, more @ self.values - target)

    def by_cluster(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (k, n, n) rows and (k, n) residuals that say of k clusters what these do."""
        order = np.argsort(self.cluster, kind="stable")
        starts = np.flatnonzero(np.diff(self.cluster[order])) + 1
        parts = np.split(order, starts)
        return compress_all((self.jacobian[part], self.residuals[part]) for part in parts)


def pulled_below(
    rows: NDArray[np.float64], residuals: NDArray[np.float64], covariance: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """(n,) which parameters (m,) equations would have well below their values, were there no bound.

    ``rows``, ``residuals``, ``covariance``: (m, n), (m,) and (n, n).
    """
    scale = np.linalg.norm(rows, axis=0)
    step = np.linalg.lstsq(rows / scale, -residuals, rcond=None)[0] / scale
    return np.asarray(step < -_WELL * np.sqrt(np.diag(covariance)))
