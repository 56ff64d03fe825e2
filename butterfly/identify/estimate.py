"""What an estimator returns: values with covariance, intervals and a verdict."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from butterfly.model.parameters import LumpedParameters

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from butterfly.model.parameters import AddedMass

PARAMETERS = ("p1", "p2", "p3", "p4", "coulomb", "delay")
"""Order of the parameters in every vector and matrix of an estimate."""

UNITS = {
    "p1": "kg m²",
    "p2": "N m s/rad",
    "p3": "N m",
    "p4": "N m/unit",
    "coulomb": "N m",
    "delay": "s",
}
"""Unit of each parameter; "unit" is the input's, V for a voltage."""

CONFIDENCE = 0.95
"""Level of all intervals."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ParameterEstimate:
    """Parameters of the bare hand and how far to trust them.

    Parameters
    ----------
    method
        How they were obtained.
    values
        (6,) in the order of `PARAMETERS`.
    covariance
        (6, 6); NaN where the method has no statement to make.
    lower, upper
        (6,) limits of the intervals at `CONFIDENCE`.
    left_out
        (6,) estimates with the logs of one added mass left out; empty if there are too few masses.
    condition
        Condition number of the column-scaled regression (or Jacobian).
    on_bound
        Parameters held by a bound.
    verdict
        What can and cannot be concluded, in words.
    resonances
        Where the method rests on resonance frequencies: these, in rad/s, per added mass.
    """

    method: str
    values: NDArray[np.float64]
    covariance: NDArray[np.float64]
    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    left_out: dict[AddedMass, NDArray[np.float64]]
    condition: float
    on_bound: tuple[str, ...]
    verdict: tuple[str, ...]
    resonances: dict[AddedMass, float]

    @property
    def parameters(self) -> LumpedParameters:
        """The estimate as parameters of the model."""
        return LumpedParameters(**dict(zip(PARAMETERS, self.values.tolist(), strict=True)))

    @property
    def standard_errors(self) -> NDArray[np.float64]:
        """(6,) square roots of the variances."""
        return np.sqrt(np.diag(self.covariance))

    def with_gain(self, p4: float) -> ParameterEstimate:
        """Return the estimate with p4 set to a value found otherwise."""
        values = np.where(np.array(PARAMETERS) == "p4", p4, self.values)
        return replace(self, values=values)
