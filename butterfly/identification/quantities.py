"""Values with a joint covariance, and first-order propagation of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import Samples
from butterfly.identification.levels import ROUNDING
from butterfly.model.prior import Known

Formula = Callable[[Mapping[str, Any]], Any]
"""A function of quantities by name; it takes complex numbers as well."""

_STEP = ROUNDING**2  # imaginary, of a complex-step derivative


@dataclass(frozen=True, kw_only=True, eq=False)
class Quantities:
    """Quantities with a joint covariance."""

    names: tuple[str, ...]  # The n quantities
    values: Samples  # (n,) in their units
    covariance: Samples  # (n, n), in their units; zeros for one that is known exactly

    @classmethod
    def of(cls, known: Mapping[str, Known]) -> Quantities:
        """Return quantities with independent errors."""
        return cls(
            names=tuple(known),
            values=np.array([quantity.value for quantity in known.values()]),
            covariance=np.diag([quantity.uncertainty**2 for quantity in known.values()]),
        )

    def find(self, formula: Formula) -> Known:
        """Return a formula's value and standard uncertainty, not finite where it divides by 0."""
        with np.errstate(divide="ignore", invalid="ignore"):
            gradient = self.gradient(formula)
            variance = float(gradient @ self.covariance @ gradient)
            value = float(formula(self._named(self.values)))
        return Known(value=value, uncertainty=float(np.sqrt(np.maximum(variance, 0.0))))

    def gradient(self, formula: Formula) -> Samples:
        """Return the (n,) derivatives of a formula by each quantity."""
        slopes = np.zeros(len(self.names))
        for k in range(slopes.size):
            moved = self.values.astype(complex)
            moved[k] += 1j * _STEP
            slopes[k] = np.imag(formula(self._named(moved))) / _STEP
        return slopes

    def _named(self, values: NDArray[Any]) -> dict[str, Any]:
        return dict(zip(self.names, values, strict=True))

    def combined_with(
        self, causes: Quantities, formulas: Mapping[str, Formula], *, new: frozenset[str]
    ) -> Quantities:
        """Return these and their causes, each updated by the information in the other.

        Some of these follow from the causes: x = f(c). Where that was used when these were
        estimated (as a prior), c depends on all else by x alone, so that with c ~ (c0, K) as
        given, the gradient G of f at c0 and x as estimated

            c = c0 + L (x - f(c0)) + remainder,   L = K G' (G K G')^-1,

        whose remainder has the covariance K - L G K and is independent of the estimate. Where it
        was not (``new``), x is first updated by f(c0), whose covariance is G K G'.
        """
        fresh = [name for name in formulas if name in new]
        updated = self._updated(causes, {name: formulas[name] for name in fresh})
        rows = [self.names.index(name) for name in formulas]
        slopes, excess = _linearised(updated, causes, formulas)
        prior = slopes @ causes.covariance @ slopes.T
        gain = causes.covariance @ slopes.T @ np.linalg.pinv(prior)
        inner = updated.covariance[np.ix_(rows, rows)]
        across = gain @ updated.covariance[rows]
        of_causes = causes.covariance + gain @ (inner - prior) @ gain.T
        return Quantities(
            names=(*updated.names, *causes.names),
            values=np.concatenate([updated.values, causes.values + gain @ excess]),
            covariance=np.block([[updated.covariance, across.T], [across, of_causes]]),
        )

    def _updated(self, causes: Quantities, formulas: Mapping[str, Formula]) -> Quantities:
        """Return these after a Kalman update by the values that follow from the causes."""
        rows = [self.names.index(name) for name in formulas]
        slopes, excess = _linearised(self, causes, formulas)
        spread = self.covariance[np.ix_(rows, rows)] + slopes @ causes.covariance @ slopes.T
        gain = self.covariance[:, rows] @ np.linalg.pinv(spread)
        return Quantities(
            names=self.names,
            values=self.values - gain @ excess,
            covariance=self.covariance - gain @ self.covariance[rows],
        )


def _linearised(
    quantities: Quantities, causes: Quantities, formulas: Mapping[str, Formula]
) -> tuple[Samples, Samples]:
    """Return the (m, n) derivatives of m formulas, and the (m,) found less computed values."""
    slopes = np.array([causes.gradient(formula) for formula in formulas.values()])
    follows = [causes.find(formula).value for formula in formulas.values()]
    rows = [quantities.names.index(name) for name in formulas]
    return slopes.reshape(len(rows), len(causes.names)), quantities.values[rows] - follows
