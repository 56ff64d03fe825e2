"""The default method: one linear regression over all logs, at their own finite amplitudes.

At each log's frequency w, with the phasors th of the angle and u of the input and a = |th|, the
balance of the fundamental of (78) with Coulomb friction and an input delay d reads

    [-(p1 + Z) w^2 + j w p2 + (p3 + X) 2 J1(a)/a + j 4 T_c/(pi a)] th = p4 e^(-j w d) u

which is linear in p1, p2, p3, T_c, p4 and, to first order about the current delay, in p4 d. The
known Z = m l^2 and X = m g l set the scale, so two different added masses are needed. Each row is
divided by the slope of its left-hand side in th at the previous iterate (Sanathanan & Koerner,
IEEE Trans. Autom. Control 8, 1963), which turns equation errors into angle errors, and by the
angle error's standard deviation: the measured one of the phasor, and one common to all logs that
makes room for what the model leaves out (Paule & Mandel, J. Res. NBS 87, 1982).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import brentq, lsq_linear
from scipy.special import stdtrit

from butterfly.errors import IdentifiabilityError
from butterfly.identify.covariance import cluster_covariance
from butterfly.identify.estimate import CONFIDENCE, PARAMETERS, ParameterEstimate
from butterfly.identify.identifiability import Conditioning, sort_by_precision
from butterfly.model.harmonic import (
    coulomb_describing_function,
    gravity_amplitude_slope,
    gravity_describing_function,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from butterfly.model.parameters import AddedMass
    from butterfly.signals.frequency_response import ResponsePoint

METHOD = "harmonic balance"

_LOWER = np.array([-np.inf, 0.0, -np.inf, -np.inf, 0.0, -np.inf])  # friction takes energy out
_MAX_ITERATIONS = 60
_EXACT = 1e-24  # relative variance of a phasor that rounding leaves even to exact data
_TOLERANCE = 1e-10  # relative change of the predicted angles


@dataclass(frozen=True, eq=False)
class _Phasors:
    """The (n,) arrays that enter the balance."""

    omega: NDArray[np.float64]
    angle: NDArray[np.complex128]
    input: NDArray[np.complex128]
    variance: NDArray[np.float64]
    inertia: NDArray[np.float64]
    gravity_moment: NDArray[np.float64]

    @classmethod
    def of(cls, points: Sequence[ResponsePoint]) -> _Phasors:
        return cls(
            omega=np.array([p.omega for p in points]),
            angle=np.array([p.angle.fundamental for p in points]),
            input=np.array([p.input for p in points]),
            variance=np.array(
                [max(np.trace(p.angle.covariance) / 2, _EXACT * p.amplitude**2) for p in points]
            ),
            inertia=np.array([p.added_mass.inertia for p in points]),
            gravity_moment=np.array([p.added_mass.gravity_moment for p in points]),
        )

    def regression(self, delay: float) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """(n, 6) regressors of `PARAMETERS`, the last of p4 (d - ``delay``), and (n,) targets."""
        w, th = self.omega, self.angle
        u = self.input * np.exp(-1j * w * delay)
        gravity = gravity_describing_function(np.abs(th)) * th
        coulomb = coulomb_describing_function(np.abs(th)) * th
        columns = [-(w**2) * th, 1j * w * th, gravity, -u, coulomb, 1j * w * u]
        return np.column_stack(columns), self.inertia * w**2 * th - self.gravity_moment * gravity

    def slope(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Rms slope of the left-hand side in the angle's phasor, over its directions, (n,)."""
        p1, p2, p3, _, coulomb, _ = values
        w, a = self.omega, np.abs(self.angle)
        inner = -(p1 + self.inertia) * w**2 + 1j * w * p2
        moment = p3 + self.gravity_moment
        radial = inner + moment * gravity_amplitude_slope(a)
        tangential = (
            inner
            + moment * gravity_describing_function(a)
            + coulomb * coulomb_describing_function(a)
        )
        return np.asarray(np.sqrt((np.abs(radial) ** 2 + np.abs(tangential) ** 2) / 2))


@dataclass(frozen=True, eq=False)
class _Solution:
    """A converged regression: (2n, 6) weighted rows, (2n,) residuals, and the values."""

    values: NDArray[np.float64]
    rows: NDArray[np.float64]
    residuals: NDArray[np.float64]
    on_bound: NDArray[np.bool_]
    settled: bool


def fit_harmonic_balance(points: Sequence[ResponsePoint]) -> ParameterEstimate:
    """Estimate p1..p4, Coulomb torque and input delay from the steady responses of all logs.

    Parameters
    ----------
    points
        At least four, with at least two different added masses (none counts as one).

    Returns
    -------
    ParameterEstimate
        Its covariance is the cluster-robust one over logs (see `cluster_covariance`); its
        intervals are widened to hold the estimates that leave one added mass out.

    Raises
    ------
    IdentifiabilityError
        If the points cannot determine all six parameters.
    """
    _refuse_too_few(points)
    solution = _solve(_Phasors.of(points))
    conditioning = Conditioning.of(solution.rows)
    conditioning.refuse_singular()
    by_log = solution.rows.reshape(2, len(points), -1).swapaxes(0, 1)
    covariance, freedom = cluster_covariance(by_log, solution.residuals.reshape(2, -1).T)
    left_out = _leave_one_mass_out(points)
    reach = stdtrit(freedom, 0.5 + CONFIDENCE / 2)
    error = np.sqrt(np.diag(covariance))
    candidates = np.array([solution.values, *left_out.values()])
    lower = np.minimum(solution.values - reach * error, candidates.min(axis=0))
    upper = np.maximum(solution.values + reach * error, candidates.max(axis=0))
    lower = np.maximum(lower, _LOWER)
    on_bound = tuple(np.array(PARAMETERS)[solution.on_bound].tolist())
    return ParameterEstimate(
        method=METHOD,
        values=solution.values,
        covariance=covariance,
        lower=lower,
        upper=upper,
        left_out=left_out,
        condition=conditioning.number,
        on_bound=on_bound,
        verdict=(
            sort_by_precision(solution.values, lower, upper),
            *conditioning.words(),
            *_remarks(on_bound, checked=bool(left_out), settled=solution.settled),
        ),
        resonances={},
    )


def _refuse_too_few(points: Sequence[ResponsePoint]) -> None:
    masses = {(p.added_mass.inertia, p.added_mass.gravity_moment) for p in points}
    if len(masses) < 2:  # noqa: PLR2004 - one mass leaves the common factor of p1..p4 free
        raise IdentifiabilityError(
            "all logs carry the same added mass, so p1..p4 are known only up to a common factor: "
            "add a run with another known mass (none counts as one)"
        )
    if 2 * len(points) <= len(PARAMETERS):
        raise IdentifiabilityError(
            f"{len(points)} logs give {2 * len(points)} equations for {len(PARAMETERS)} "
            "parameters: add runs at other frequencies"
        )


def _solve(phasors: _Phasors) -> _Solution:
    values, weights, delay = np.zeros(6), np.ones(phasors.omega.size), 0.0
    for _ in range(_MAX_ITERATIONS):
        matrix, target = phasors.regression(delay)
        rows, wanted = _real(matrix * weights[:, None]), _real(target * weights)
        scale = np.linalg.norm(rows, axis=0)
        fit = lsq_linear(rows / scale, wanted, bounds=(_LOWER, np.inf), method="bvls", tol=1e-14)
        previous, values = values, fit.x / scale
        step = values[5] / values[3]
        slope = phasors.slope(values)
        errors = np.abs(matrix @ values - target) / slope
        spread = _model_variance(errors, phasors.variance)
        weights = 1.0 / (slope * np.sqrt(phasors.variance + spread))
        delay += step
        change = np.linalg.norm(rows @ (values - previous)) / np.linalg.norm(rows @ values)
        settled = bool(change < _TOLERANCE)
        if settled:
            break
    residuals = rows @ values - wanted
    rows = rows * np.array([1, 1, 1, 1, 1, values[3]])  # of the delay itself, not of p4 times it
    values = np.array([*values[:5], delay])
    return _Solution(values, rows, residuals, fit.active_mask != 0, settled)


def _real(values: NDArray[np.complex128]) -> NDArray[np.float64]:
    return np.concatenate([values.real, values.imag])


def _model_variance(errors: NDArray[np.float64], variance: NDArray[np.float64]) -> float:
    """Variance per component, common to all logs, that the measured one leaves unexplained."""
    freedom = 2 * errors.size - len(PARAMETERS)

    def excess(common: float) -> float:
        return float(np.sum(errors**2 / (variance + common))) - freedom

    largest = float(np.sum(errors**2)) / freedom
    if excess(0.0) <= 0:
        return 0.0
    return float(brentq(excess, 1e-12 * largest, largest * (1 + 1e-9), xtol=1e-9 * largest))


def _leave_one_mass_out(points: Sequence[ResponsePoint]) -> dict[AddedMass, NDArray[np.float64]]:
    left_out = {}
    for mass in sorted({p.added_mass for p in points}):
        kept = [p for p in points if p.added_mass != mass]
        try:
            _refuse_too_few(kept)
        except IdentifiabilityError:
            continue
        left_out[mass] = _solve(_Phasors.of(kept)).values
    return left_out


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
