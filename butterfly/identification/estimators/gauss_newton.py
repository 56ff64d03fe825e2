"""Nonlinear least squares from normal equations, within bounds and a trust region.

Where residuals are many, parameters few and derivatives come with the residuals, the sums J^T J and
J^T r are all that a step needs. Each is the least-squares step within the bounds of the parameters
and a box about the point, whose size follows how well the last step was predicted (Nocedal &
Wright, Numerical Optimization, 2nd ed. 2006, chapters 4 and 10).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from butterfly.errors import IdentifiabilityError

Samples = NDArray[np.float64]

_LAST = 1e-4  # share of the cost that a step taken on trust may promise
_UNSEEN = 0.1  # share of a residual's part of the cost that may be left after it
_NEGLIGIBLE = 1e-8  # share of the cost, for which no step is worth while
_STUCK = 1e-3  # share of the cost, more than which the end of a descent must not leave
_SMALLEST_STEP = 1e-6  # of scaled parameters
_FLAT = 1e-15  # share of the largest curvature, below which there is only rounding
_POOR, _GOOD, _BETTER = 0.25, 0.75, 1.33  # shares of the predicted decrease
_INSIDE = 0.99  # share of the box that a step stays within which the box does not cut short


MOST = 60
"""How often a cost is expanded at most."""


class Expansion(Protocol):
    """A cost about a point."""

    @property
    def count(self) -> int:
        """How many residuals there are."""

    @property
    def cost(self) -> float:
        """Half the sum of the squares."""

    @property
    def gradient(self) -> Samples:
        """(n,) J^T r."""

    @property
    def curvature(self) -> Samples:
        """(n, n) J^T J."""

    def moved(self, step: Samples) -> Self:
        """Return what the derivatives say of the cost a step of (n,) away."""


_E = TypeVar("_E", bound=Expansion)


@dataclass(frozen=True, kw_only=True, eq=False)
class Minimum(Generic[_E]):
    """Where a descent ended."""

    point: Samples  # (n,)
    at: _E  # the cost about it, as its last expansion says
    converged: bool  # whether no further step promises anything
    evaluations: int  # how often the cost was expanded


def minimise(
    expand: Callable[[Samples], _E],
    initial: Samples,
    lower: Samples,
    known: _E | None = None,
    most: int = MOST,
) -> Minimum[_E]:
    """Descend from a point to a minimum.

    Once steps do what they promise, and each promises far less than the one before, the last one is
    taken on trust. A descent that ends because its box has shrunk has converged only if no step out
    of the box promises anything either.

    ``expand``: from (n,) a point to the cost about it. Infinite or NaN costs are stepped back from;
    ``initial``, ``lower``: (n,) where to begin, and least values. The coordinates are of order 1;
    ``known``: the cost about the beginning, if it is known already; ``most``: how often the cost
    may be expanded.
    """
    point = np.maximum(initial, lower)
    at, evaluations = (expand(point), 1) if known is None else (known, 0)
    if not _is_finite(at):
        raise IdentifiabilityError(
            "the model diverges with the parameters from which the fit would start: they are not "
            "those of a joint (see what a closed form says of these logs, such as the weak form)"
        )
    reach, kept, last = max(float(np.linalg.norm(point)), 1.0), 0.0, 0.0
    while evaluations < most:
        step = _step(at, np.maximum(lower - point, -reach), reach)
        predicted, longest = _decrease(at, step), float(np.abs(step).max(initial=0.0))
        there = np.maximum(point + step, lower)
        if longest < _INSIDE * reach:
            left = _UNSEEN * at.cost * last / at.count
            trusted = (
                _GOOD < kept < _BETTER and predicted <= _LAST * at.cost and predicted**2 < left
            )
            if trusted or predicted <= _NEGLIGIBLE * at.cost or longest < _SMALLEST_STEP:
                end = at.moved(there - point)
                return Minimum(point=there, at=end, converged=True, evaluations=evaluations)
        elif reach < _SMALLEST_STEP:
            break
        tried = expand(there)
        evaluations += 1
        kept = (at.cost - tried.cost) / predicted if _is_finite(tried) else -np.inf
        if kept < _POOR:
            reach = _POOR * longest
        elif kept > _GOOD and longest > _INSIDE * reach:
            reach *= 2
        if kept > 0:
            last = at.cost - tried.cost
            point, at = there, tried
    promised = _decrease(at, _step(at, lower - point, np.inf))
    converged = evaluations < most and promised <= _STUCK * at.cost
    return Minimum(point=point, at=at, converged=converged, evaluations=evaluations)


def _decrease(at: Expansion, step: Samples) -> float:
    """Return what a step takes off the cost, by its derivatives."""
    return -float(at.gradient @ step + 0.5 * step @ at.curvature @ step)


def _is_finite(at: Expansion) -> bool:
    return bool(np.isfinite(at.cost) and np.isfinite(at.gradient).all())


def _step(at: Expansion, lowest: Samples, reach: float) -> Samples:
    """Return the step that a quadratic cost asks for, within a box."""
    curvatures, axes = np.linalg.eigh(at.curvature)
    told = curvatures > _FLAT * curvatures[-1]
    roots = np.sqrt(np.where(told, curvatures, 0.0))
    pull = np.divide(axes.T @ at.gradient, roots, out=np.zeros_like(roots), where=told)
    rows = roots[:, None] * axes.T
    return np.asarray(lsq_linear(rows, -pull, (lowest, reach), method="bvls", tol=1e-12).x)
