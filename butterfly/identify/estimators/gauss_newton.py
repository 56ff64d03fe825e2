"""Nonlinear least squares from normal equations, within bounds and a trust region.

Where residuals are many, parameters few and derivatives come with the residuals, the sums J^T J and
J^T r are all that a step needs. Each is the least-squares step within the bounds of the parameters
and a box about the point, whose size follows how well the last step was foretold (Nocedal & Wright,
Numerical Optimization, 2nd ed. 2006, chapters 4 and 10).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, Protocol, Self, TypeVar

import numpy as np
from scipy.optimize import lsq_linear

from butterfly.errors import IdentifiabilityError

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Samples = NDArray[np.float64]

_FORETOLD = 1e-4  # share of the cost that the last step takes off, without being looked back at
_NEGLIGIBLE = 1e-8  # the same of a step that is not worth taking
_SMALLEST_STEP = 1e-6
_MOST = 60
_FLAT = 1e-15  # share of the largest curvature, below which there is only rounding
_POOR, _GOOD, _BETTER = 0.25, 0.75, 1.33  # shares of the foretold decrease


class Expansion(Protocol):
    """A cost about a point."""

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
    """Where a descent ended.

    Parameters
    ----------
    point
        (n,).
    at
        The cost about it, as its last expansion says.
    converged
        Whether no further step promised anything.
    evaluations
        How often the cost was expanded.
    """

    point: Samples
    at: _E
    converged: bool
    evaluations: int


def minimise(
    expand: Callable[[Samples], _E],
    initial: Samples,
    lower: Samples,
    known: _E | None = None,
) -> Minimum[_E]:
    """Descend from a point to a minimum.

    Once steps do what they promise, the last one, which promises little, is taken on trust.

    Parameters
    ----------
    expand
        From (n,) a point to the cost about it. Infinite or NaN costs are stepped back from.
    initial, lower
        (n,) where to begin, and least values. The coordinates are of order 1.
    known
        The cost about the beginning, if it is known already.

    Raises
    ------
    IdentifiabilityError
        If the cost at the beginning is no number.
    """
    point = np.maximum(initial, lower)
    at, evaluations = (expand(point), 1) if known is None else (known, 0)
    if not _is_finite(at):
        raise IdentifiabilityError(
            "the model diverges with the parameters from which the fit would start: they are not "
            "those of a joint (see what a closed form says of these logs, such as the weak form)"
        )
    reach, kept = max(float(np.linalg.norm(point)), 1.0), 0.0
    while evaluations < _MOST:
        step = _step(at, np.maximum(lower - point, -reach), reach)
        foretold = -float(at.gradient @ step + 0.5 * step @ at.curvature @ step)
        longest = float(np.abs(step).max(initial=0.0))
        there = np.maximum(point + step, lower)
        trusted = foretold <= _FORETOLD * at.cost and _GOOD < kept < _BETTER and evaluations > 0
        if trusted or foretold <= _NEGLIGIBLE * at.cost or longest < _SMALLEST_STEP:
            end = at.moved(there - point)
            return Minimum(point=there, at=end, converged=True, evaluations=evaluations)
        tried = expand(there)
        evaluations += 1
        kept = (at.cost - tried.cost) / foretold if _is_finite(tried) else -np.inf
        if kept < _POOR:
            reach = _POOR * longest
        elif kept > _GOOD and longest > 0.9 * reach:
            reach *= 2
        if kept > 0:
            point, at = there, tried
    return Minimum(point=point, at=at, converged=False, evaluations=evaluations)


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
