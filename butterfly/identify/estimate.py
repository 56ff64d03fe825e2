"""What an estimator returns: values with covariance, intervals and a verdict."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from butterfly.model.parameters import LumpedParameters

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from butterfly.logs.log import Log
    from butterfly.model.parameters import AddedMass

PARAMETERS = ("p1", "p2", "p3", "p4", "coulomb", "delay")
"""The parameters that every method estimates, in their order."""

TERMS = (
    *("drag", "load", "bias", "p3_offset", "stribeck", "stribeck_velocity"),
    *("tilt", "cogging", "cogging_cosine"),
)
"""Terms that some methods can estimate besides."""

UNITS = {
    "p1": "kg m²",
    "p2": "N m s/rad",
    "p3": "N m",
    "p4": "N m/unit",
    "coulomb": "N m",
    "delay": "s",
    "drag": "N m s²/rad²",
    "load": "m",
    "bias": "N m",
    "p3_offset": "N m",
    "stribeck": "N m",
    "stribeck_velocity": "rad/s",
    "tilt": "rad",
    "cogging": "N m",
    "cogging_cosine": "N m",
}
"""Unit of each parameter; "unit" is the input's, V for a voltage."""

_NOT_NEGATIVE = frozenset({"p2", "coulomb", "drag", "stribeck"})  # friction takes energy out
_LEAST_STRIBECK_VELOCITY = 1e-3  # rad/s

CONFIDENCE = 0.95
"""Level of all intervals."""


def lower_bounds(names: Sequence[str]) -> NDArray[np.float64]:
    """(n,) least values that n parameters can have."""
    least = {"stribeck_velocity": _LEAST_STRIBECK_VELOCITY} | dict.fromkeys(_NOT_NEGATIVE, 0.0)
    return np.array([least.get(name, -np.inf) for name in names])


@dataclass(frozen=True, kw_only=True, eq=False)
class ParameterEstimate:
    """Parameters of the bare hand and how far to trust them.

    Parameters
    ----------
    method
        How they were obtained.
    names
        The n parameters estimated: `PARAMETERS`, then terms.
    values
        (n,) in their order.
    covariance
        (n, n); NaN where the method has no statement to make.
    lower, upper
        (n,) limits of the intervals at `CONFIDENCE`.
    left_out
        (n,) estimates with the logs of one added mass left out; empty if there are too few masses.
    condition
        Condition number of the column-scaled regression (or Jacobian).
    on_bound
        Parameters held by a bound.
    verdict
        What can and cannot be concluded, in words.
    resonances
        Where the method rests on resonance frequencies: these, in rad/s, per added mass.
    local
        Where the method estimates them: ``zero`` (the encoder's reading in rad at the model's
        angle 0), ``velocity`` (at the first sample, in rad/s) and ``bias``, for one log (by its
        source), for one added mass, or for all (None).
    """

    method: str
    names: tuple[str, ...] = PARAMETERS
    values: NDArray[np.float64]
    covariance: NDArray[np.float64]
    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    left_out: dict[AddedMass, NDArray[np.float64]]
    condition: float
    on_bound: tuple[str, ...]
    verdict: tuple[str, ...]
    resonances: dict[AddedMass, float] = field(default_factory=dict)
    local: dict[AddedMass | str | None, dict[str, float]] = field(default_factory=dict)

    @property
    def parameters(self) -> LumpedParameters:
        """The estimate as parameters of the model."""
        return LumpedParameters(**dict(zip(self.names, self.values.tolist(), strict=True)))

    @property
    def standard_errors(self) -> NDArray[np.float64]:
        """(6,) square roots of the variances."""
        return np.sqrt(np.diag(self.covariance))

    def applied(self, log: Log) -> tuple[LumpedParameters, dict[str, float]]:
        """Return what holds for one log: parameters, and zero and velocity where estimated."""
        own: dict[str, float] = {}
        for key in (None, log.added_mass, log.source):
            own |= self.local.get(key, {})
        parameters = self.parameters
        return replace(parameters, bias=own.pop("bias", parameters.bias)), own

    def with_gain(self, p4: float) -> ParameterEstimate:
        """Return the estimate with p4 set to a value found otherwise."""
        values = np.where(np.array(self.names) == "p4", p4, self.values)
        return replace(self, values=values)
