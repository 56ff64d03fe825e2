"""Bounded linear least squares, its columns scaled."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from butterfly.errors import IdentifiabilityError
from butterfly.identification.levels import CLEARLY
from butterfly.model.prior import Penalty
from butterfly.model.terms import TERMS, lower_bounds


@dataclass(frozen=True, kw_only=True, eq=False)
class Solution:
    """(n,) values, and which of them a bound holds."""

    values: NDArray[np.float64]
    on_bound: NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True, eq=False)
class Regression:
    """Equations that are linear in the parameters: ``rows`` times the unknowns is ``target``.

    The unknowns are the parameters themselves, but for those that enter as a product with p4
    (delay, terms of the drive): of these, p4 (parameter - ``about``).
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


def pulled_below(
    rows: NDArray[np.float64], residuals: NDArray[np.float64], covariance: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """(n,) which parameters (m,) equations would have well below their values, were there no bound.

    ``rows``, ``residuals``, ``covariance``: (m, n), (m,) and (n, n).
    """
    step = scaled_least_squares(rows, -residuals)
    return np.asarray(step < -CLEARLY * np.sqrt(np.diag(covariance)))


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
