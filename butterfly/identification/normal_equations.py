"""Bounded linear least squares, its columns scaled, and the equations about a solution."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from butterfly.errors import IdentifiabilityError
from butterfly.identification.diagnostics.findings import Ending, Finding
from butterfly.identification.inference.covariance import cluster_covariance, compress_all
from butterfly.model.prior import Penalty
from butterfly.model.terms import TERMS, lower_bounds

_TOLD = 1e-7  # of the scaled equations, below which a combination is not determined
_WELL = 3.0  # standard errors


@dataclass(frozen=True, kw_only=True, eq=False)
class Solution:
    """(n,) values, and which of them a bound holds."""

    values: NDArray[np.float64]
    on_bound: NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True, eq=False)
class Regression:
    """Equations that are linear in the parameters: ``rows`` times the unknowns is ``target``.

    The unknowns are the parameters themselves, but for those that enter as a product with p4
    (delay, compression): of these, p4 (parameter - ``about``).
    """

    names: tuple[str, ...]  # of the n parameters
    rows: NDArray[np.float64]  # rows, target: (m, n) and (m,)
    target: NDArray[np.float64]
    # (m,) numbers, from 0 on, of the log (or stretch of one) that a row belongs to: errors are
    # taken to be independent between clusters, not within
    cluster: NDArray[np.intp]
    # values of the parameters of the product kind about which the rows hold; 0 if not given
    about: dict[str, float] = field(default_factory=dict)
    # least values, where they are not those of the table of terms
    least: dict[str, float] = field(default_factory=dict)
    # p4, where it is known, and no unknown; a guess of it otherwise, by which what is known of
    # products is turned
    gain: float = 0.0
    prior: Penalty | None = None  # what is known of the values with an uncertainty

    def solve(self, use: NDArray[np.bool_] | slice = slice(None)) -> Solution:
        """Return the values that fit the rows to use best, within their bounds."""
        if "p4" in self.names and not self.rows[use, self.names.index("p4")].any():
            raise IdentifiabilityError("the input is zero throughout: add logs of a driven joint")
        more, wanted = self.known_rows
        rows = np.concatenate([self.rows[use], more])
        target = np.concatenate([self.target[use], wanted])
        scale = np.linalg.norm(rows, axis=0)
        scale[scale == 0] = 1.0  # a column of zeros stays without effect
        moved = self._products & (self._shift != 0)
        lowest = np.where(moved, -np.inf, self.lower)  # of p4 (x - about), whose bound moves too
        highest = np.full(scale.size, np.inf)
        if self.gain < 0:  # products turn their bounds round
            turned = self._products & ~moved
            lowest[turned], highest[turned] = -np.inf, -self.lower[turned]
        fit = lsq_linear(rows / scale, target, (lowest, highest), method="bvls", tol=1e-14)
        unknowns = fit.x / scale
        values = self.values(unknowns)
        on_bound = (fit.active_mask != 0) | (values < self.lower)
        return Solution(values=np.maximum(values, self.lower), on_bound=np.asarray(on_bound))

    def unknowns(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what the rows multiply, of (n,) values."""
        return (values - self._shift) * self._slopes(values)

    def values(self, unknowns: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (n,) values of what the rows multiply."""
        return np.asarray(unknowns / self._slopes(unknowns) + self._shift)

    def residuals(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """(m,) left sides less right sides, with (n,) values."""
        return np.asarray(self.rows @ self.unknowns(values) - self.target)

    def jacobian(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """(m, n) derivatives of the residuals by the values, about (n,) values."""
        return self.rows * self._slopes(values)

    @property
    def known_rows(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(k, n) rows and (k,) targets that the prior adds; none of products without a gain."""
        known = self.turned_prior
        return (np.empty((0, len(self.names))), np.empty(0)) if known is None else known.rows()

    @property
    def turned_prior(self) -> Penalty | None:
        """The prior, of what the rows multiply."""
        if self.prior is None:
            return None
        if not self.gain:
            return self.prior.without(self._products)
        return self.prior.turned(np.where(self._products, self.gain, 1.0), self._shift)

    @cached_property
    def lower(self) -> NDArray[np.float64]:
        """(n,) least values."""
        table = dict(zip(self.names, lower_bounds(self.names).tolist(), strict=True))
        return np.array([self.least.get(name, table[name]) for name in self.names])

    @cached_property
    def _products(self) -> NDArray[np.bool_]:
        return np.array([TERMS[name].of_gain for name in self.names])

    @cached_property
    def _shift(self) -> NDArray[np.float64]:
        return np.array([self.about.get(name, 0.0) for name in self.names])

    def _slopes(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """p4 for the parameters that it multiplies, 1 for the others."""
        if not self._products.any():
            return np.ones(len(self.names))
        own = values[self.names.index("p4")] if "p4" in self.names else self.gain
        gain = float(own) or np.finfo(float).tiny
        return np.where(self._products, gain, 1.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class SolvedEquations:
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
    prior: Penalty | None = None  # what was known of the values with an uncertainty

    @classmethod
    def of(
        cls, regression: Regression, solution: Solution, *, unsettled: Finding | None = None
    ) -> SolvedEquations:
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

    def beside(self, other: SolvedEquations) -> SolvedEquations:
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
        fewer rows, which is a larger variance of each. It is no less than in the direction of each
        parameter of which something is known besides, the others following.
        """
        rows, residuals = self.by_cluster()
        flat = rows.reshape(-1, rows.shape[2])
        size = np.linalg.norm(flat, axis=0)
        basis, singular, _ = np.linalg.svd(
            flat / np.where(size > 0, size, 1.0), full_matrices=False
        )
        told = basis[:, singular > _TOLD * singular[0]]
        covariance, _ = cluster_covariance(told.reshape(*rows.shape[:2], -1), residuals)
        found = float(np.mean(np.diag(covariance)))
        for k in () if self.prior is None else np.flatnonzero(self.prior.active):
            others = np.delete(flat, k, axis=1)
            own = flat[:, k] - others @ scaled_least_squares(others, flat[:, k])
            if own @ own > _TOLD * (flat[:, k] @ flat[:, k]):
                along = np.einsum("km,km->k", own.reshape(residuals.shape), residuals)
                found = max(found, float(along @ along / (own @ own)))
        return found

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
    step = scaled_least_squares(rows, -residuals)
    return np.asarray(step < -_WELL * np.sqrt(np.diag(covariance)))


def scaled_least_squares(
    rows: NDArray[np.float64], target: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return (n,) or (n, k) values, (m, n) rows times which are nearest to (m,) or (m, k) targets.

    Each column of the rows is scaled to be of length 1, so that its unit does not count.
    """
    scale = np.linalg.norm(rows, axis=0)
    scale[scale == 0] = 1.0
    values = np.linalg.lstsq(rows / scale, target, rcond=None)[0]
    return np.asarray((values.T / scale).T)
