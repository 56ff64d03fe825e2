"""How the fit worsens when one parameter is held, without formulas: profile likelihood."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtri

from butterfly.errors import InputError, nearest
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators.output_error import OutputError
from butterfly.identification.inference.intervals import CONFIDENCE
from butterfly.progress import Track, untracked


@dataclass(frozen=True, kw_only=True, eq=False)
class Profile:
    """Least sum of squares when one parameter is held, the others fitted.

    Parameters
    ----------
    name
        Of the parameter.
    values, costs
        (n,) values at which it was held, and sums of squares relative to the least one.
    threshold
        Relative sum of squares at the limits of the interval at `CONFIDENCE`.
    """

    name: str
    values: NDArray[np.float64]
    costs: NDArray[np.float64]
    threshold: float

    @property
    def interval(self) -> tuple[float, float]:
        """Where the profile crosses the threshold; infinite where it does not on the grid."""
        inside = np.flatnonzero(self.costs <= self.threshold)
        if inside.size == 0:
            return float("nan"), float("nan")
        first, last = int(inside[0]), int(inside[-1])
        lower = -np.inf if first == 0 else self._crossing(first - 1, first)
        upper = np.inf if last == self.values.size - 1 else self._crossing(last + 1, last)
        return lower, upper

    def _crossing(self, outside: int, inside: int) -> float:
        share = (self.threshold - self.costs[inside]) / (self.costs[outside] - self.costs[inside])
        step = self.values[outside] - self.values[inside]
        return float(self.values[inside] + share * step)


def profile(
    data: DataSet,
    estimate: Estimate,
    name: str,
    values: Sequence[float],
    estimator: OutputError | None = None,
    *,
    track: Track = untracked,
) -> Profile:
    """Profile the output error over one parameter (Bates & Watts, Nonlinear Regression, 1988).

    Errors within a log are correlated, so each log counts as two independent residuals, its gain
    and its phase, in the F test for the threshold.

    Parameters
    ----------
    data
        The logs.
    estimate
        The output-error estimate, from which every fit starts.
    name
        The parameter.
    values
        (n,) increasing values at which it is held.
    estimator
        With which the estimate was made, whose terms are kept.

    Raises
    ------
    InputError
        If it was not estimated.
    """
    if name not in estimate.names:
        raise InputError("profile", "name", name, nearest(name, estimate.names))
    estimator = (estimator or OutputError()).holding_terms_of(estimate)
    start = estimate.parameters
    zero = estimate.local.get(None, {}).get("zero")
    zeros = data.equilibria if zero is None else dict.fromkeys(data.masses, zero)
    least = estimator.minimum(data.logs, start, zeros, data.known)
    held = estimator.holding(name)
    costs = [
        held.minimum(data.logs, replace(start, **{name: float(value)}), zeros, data.known) / least
        for value in track(values, f"Profiling {name}")
    ]
    freedom = max(2 * len(data.logs) - len(estimate.names), 1)
    threshold = 1 + fdtri(1, freedom, CONFIDENCE) / freedom
    return Profile(
        name=name, values=np.array(values), costs=np.array(costs), threshold=float(threshold)
    )
