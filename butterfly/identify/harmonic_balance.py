"""The default method: one linear regression over all logs, at their own finite amplitudes.

At each log's frequency w, with the phasors th of the angle and u of the input and a = |th|, the
balance of the fundamental of (78) with Coulomb friction and an input delay d reads

    [-(p1 + Z) w^2 + j w p2 + (p3 + X) 2 J1(a)/a + j 4 T_c/(pi a)] th = p4 e^(-j w d) u

which is linear in p1, p2, p3, T_c, p4 and, to first order about the current delay, in p4 d; so are
the describing functions of quadratic drag, load-dependent and Stribeck friction. The
known Z = m l^2 and X = m g l set the scale, so two different added masses are needed. Each row is
divided by the slope of its left-hand side in th at the previous iterate (Sanathanan & Koerner,
IEEE Trans. Autom. Control 8, 1963), which turns equation errors into angle errors, and by the
angle error's standard deviation: the measured one of the phasor, and one in proportion to the
swing, common to all logs, that makes room for what the model leaves out (Paule & Mandel, J. Res.
NBS 87, 1982).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import brentq, lsq_linear

from butterfly.errors import IdentifiabilityError, InputError, nearest
from butterfly.identify.covariance import cluster_covariance
from butterfly.identify.estimate import PARAMETERS, ParameterEstimate, lower_bounds
from butterfly.identify.identifiability import Conditioning, refuse_one_mass, sort_by_precision
from butterfly.identify.intervals import honest_limits, without_each_mass
from butterfly.identify.phasors import Phasors

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from butterfly.model.parameters import AddedMass
    from butterfly.signals.frequency_response import ResponsePoint

METHOD = "harmonic balance"

LINEAR = ("p1", "p2", "p3", "p4")
"""What is estimated in the limit of small swings without Coulomb friction and delay."""

TERMS = ("drag", "load", "stribeck")
"""What can be estimated besides `PARAMETERS`; the Stribeck velocity is held at its default."""

_MAX_ITERATIONS = 60
_TOLERANCE = 1e-10  # relative change of the predicted angles


@dataclass(frozen=True, eq=False)
class _Solution:
    """A converged regression: (2n, 6) weighted rows, (2n,) residuals, and the values."""

    values: NDArray[np.float64]
    rows: NDArray[np.float64]
    residuals: NDArray[np.float64]
    on_bound: NDArray[np.bool_]
    settled: bool


def fit_harmonic_balance(
    points: Sequence[ResponsePoint], terms: tuple[str, ...] = ()
) -> ParameterEstimate:
    """Estimate p1..p4, Coulomb torque and input delay from the steady responses of all logs.

    Parameters
    ----------
    points
        At least four, with at least two different added masses (none counts as one).
    terms
        Of `TERMS`, estimated too.

    Returns
    -------
    ParameterEstimate
        Its covariance is the cluster-robust one over logs (see `cluster_covariance`); its
        intervals are widened to hold the estimates that leave one added mass out.

    Raises
    ------
    IdentifiabilityError
        If the points cannot determine all parameters.
    InputError
        If there is no such term.
    """
    for term in terms:
        if term not in TERMS:
            raise InputError(METHOD, "terms", term, nearest(term, TERMS))
    return _fit(points, (*PARAMETERS, *terms), METHOD, small=False)


def fit_linear(points: Sequence[ResponsePoint]) -> ParameterEstimate:
    """Estimate p1..p4 of the linearisation from the steady responses of all logs.

    For swings so small that sin th = th, without Coulomb friction and delay: what is left of
    `fit_harmonic_balance` is the joint linear complex fit -p1 w^2 G + j w p2 G + p3 G - p4 =
    (Z w^2 - X) G.

    Raises
    ------
    IdentifiabilityError
        If the points cannot determine all four parameters.
    """
    return _fit(points, LINEAR, "joint linear complex fit", small=True)


def _fit(
    points: Sequence[ResponsePoint], names: tuple[str, ...], method: str, *, small: bool
) -> ParameterEstimate:
    _refuse_too_few(points, names)
    phasors = Phasors.of(points, names, small=small)
    solution = _solve(phasors)
    conditioning = Conditioning.of(solution.rows, names)
    conditioning.refuse_singular()
    by_log = solution.rows.reshape(2, len(points), -1).swapaxes(0, 1)
    covariance, freedom = cluster_covariance(by_log, solution.residuals.reshape(2, -1).T)

    def without(mass: AddedMass) -> NDArray[np.float64]:
        kept = [point for point in points if point.added_mass != mass]
        _refuse_too_few(kept, names)
        return _solve(Phasors.of(kept, names, small=small)).values

    left_out = without_each_mass((point.added_mass for point in points), without)
    lower, upper = honest_limits(solution.values, covariance, freedom, left_out.values())
    lower = np.maximum(lower, lower_bounds(phasors.names))
    on_bound = tuple(np.array(names)[solution.on_bound].tolist())
    return ParameterEstimate(
        method=method,
        names=names,
        values=solution.values,
        covariance=covariance,
        lower=lower,
        upper=upper,
        left_out=left_out,
        condition=conditioning.number,
        on_bound=on_bound,
        verdict=(
            sort_by_precision(solution.values, lower, upper, names),
            *conditioning.words(),
            *_remarks(on_bound, checked=bool(left_out), settled=solution.settled),
        ),
    )


def _refuse_too_few(points: Sequence[ResponsePoint], names: Sequence[str]) -> None:
    if not points:
        raise IdentifiabilityError(
            "no log is a sine: the methods weak-form and output-error take other inputs"
        )
    refuse_one_mass(point.added_mass for point in points)
    if 2 * len(points) <= len(names):
        raise IdentifiabilityError(
            f"{len(points)} logs give {2 * len(points)} equations for {len(names)} "
            "parameters: add runs at other frequencies"
        )


def _solve(phasors: Phasors) -> _Solution:
    count = len(phasors.names)
    gain = phasors.names.index("p4")
    late = phasors.names.index("delay") if "delay" in phasors.names else None
    values, weights, delay = np.zeros(count), np.ones(phasors.omega.size), 0.0
    for _ in range(_MAX_ITERATIONS):
        matrix, target = phasors.regression(delay)
        rows, wanted = _real(matrix * weights[:, None]), _real(target * weights)
        scale = np.linalg.norm(rows, axis=0)
        bounds = (lower_bounds(phasors.names), np.inf)
        fit = lsq_linear(rows / scale, wanted, bounds=bounds, method="bvls", tol=1e-14)
        previous, values = values, fit.x / scale
        step = 0.0 if late is None else values[late] / values[gain]
        slope = phasors.slope(values)
        swing = np.abs(phasors.angle)
        errors = np.abs(matrix @ values - target) / (slope * swing)
        spread = _model_variance(errors, phasors.variance / swing**2, count)
        weights = 1.0 / (slope * np.sqrt(phasors.variance + spread * swing**2))
        delay += step
        change = np.linalg.norm(rows @ (values - previous)) / np.linalg.norm(rows @ values)
        settled = bool(change < _TOLERANCE)
        if settled:
            break
    residuals = rows @ values - wanted
    if late is not None:
        rows[:, late] *= values[gain]  # of the delay itself, not of p4 times it
        values[late] = delay
    return _Solution(values, rows, residuals, fit.active_mask != 0, settled)


def _real(values: NDArray[np.complex128]) -> NDArray[np.float64]:
    return np.concatenate([values.real, values.imag])


def _model_variance(
    errors: NDArray[np.float64], variance: NDArray[np.float64], count: int
) -> float:
    """Relative variance per component, common to all logs, that ``variance`` does not explain."""
    freedom = 2 * errors.size - count

    def excess(common: float) -> float:
        return float(np.sum(errors**2 / (variance + common))) - freedom

    largest = float(np.sum(errors**2)) / freedom
    if excess(0.0) <= 0:
        return 0.0
    return float(brentq(excess, 1e-12 * largest, largest * (1 + 1e-9), xtol=1e-9 * largest))


def _remarks(on_bound: Sequence[str], *, checked: bool, settled: bool) -> list[str]:
    remarks = []
    if not settled:
        remarks.append(
            f"The iteration did not settle in {_MAX_ITERATIONS} rounds: do not trust the values."
        )
    if on_bound:
        remarks.append(
            f"{', '.join(on_bound)} ended on the bound 0: friction that the data do not show, or "
            "a model that misses something."
        )
    if not checked:
        remarks.append(
            "Fewer than three added masses: the intervals could not be checked by leaving one out."
        )
    return remarks
