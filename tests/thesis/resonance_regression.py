"""From resonance frequencies of known added masses to p1 and p3.

Without damping Y = (p3 + X)/(p1 + Z) (82), with Y = w_opt^2; multiplied out it is linear (84), but
then the noise of Y stands in a regressor, so that least squares is biased.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import find_spec

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from butterfly.errors import IdentifiabilityError, InputError
from butterfly.model.parameters import AddedMass
from butterfly.thesis.resonance import Resonance


@dataclass(frozen=True, kw_only=True, eq=False)
class PendulumEstimate:
    """p1 in kg m^2 and p3 in N m, with their (2, 2) covariance."""

    p1: float
    p3: float
    covariance: NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Data:
    """The (n,) variables of (81), and standard errors of Y; their scale, if any is known."""

    x: NDArray[np.float64]
    z: NDArray[np.float64]
    y: NDArray[np.float64]
    error: NDArray[np.float64]
    scale_known: bool

    @classmethod
    def of(cls, resonances: Mapping[AddedMass, Resonance]) -> _Data:
        if len({mass.inertia_and_moment for mass in resonances}) < 2:
            raise IdentifiabilityError(
                "resonances of fewer than two added masses leave p1, p3 open"
            )
        omega = np.array([r.omega for r in resonances.values()])
        error = np.array([r.error for r in resonances.values()])
        known = np.isfinite(error)
        typical = float(np.median(error[known])) if known.any() else 1.0
        return cls(
            x=np.array([m.gravity_moment for m in resonances]),
            z=np.array([m.inertia for m in resonances]),
            y=omega**2,
            error=2 * omega * np.where(known, error, typical),
            scale_known=bool(known.any()),
        )

    def scaled(
        self, covariance: NDArray[np.float64], residuals: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Inflate a covariance by the residuals' size, where they exceed their errors.

        Where no error is known it is the residuals' size alone that tells; two masses leave none.
        """
        freedom = self.y.size - 2
        if not self.scale_known:
            return covariance * (float(residuals @ residuals) / freedom if freedom else np.nan)
        return covariance * max(1.0, float(residuals @ residuals) / max(freedom, 1))


def fit_multiplied_out(resonances: Mapping[AddedMass, Resonance]) -> PendulumEstimate:
    """Fit (84) by ordinary least squares, as the thesis proposes; biased by the noise in -Y."""
    data = _Data.of(resonances)
    design = np.column_stack([-data.y, np.ones(data.y.size)])
    target = data.y * data.z - data.x
    solution, *_ = np.linalg.lstsq(design, target, rcond=None)
    residual = target - design @ solution
    freedom = max(data.y.size - 2, 1)
    covariance = np.linalg.inv(design.T @ design) * (residual @ residual) / freedom
    return PendulumEstimate(p1=float(solution[0]), p3=float(solution[1]), covariance=covariance)


def fit_ratio(resonances: Mapping[AddedMass, Resonance]) -> PendulumEstimate:
    """Fit (82) by weighted nonlinear least squares, which has no noise in its regressors."""
    data = _Data.of(resonances)
    start = fit_multiplied_out(resonances)
    scale = np.array([abs(start.p1), abs(start.p3) + 1e-12])

    def residuals(shares: NDArray[np.float64]) -> NDArray[np.float64]:
        p1, p3 = shares * scale
        return np.asarray(((p3 + data.x) / (p1 + data.z) - data.y) / data.error)

    fit = least_squares(residuals, [start.p1, start.p3] / scale, xtol=1e-14, ftol=1e-14)
    jacobian = fit.jac / scale
    covariance = data.scaled(np.linalg.inv(jacobian.T @ jacobian), fit.fun)
    p1, p3 = fit.x * scale
    return PendulumEstimate(p1=float(p1), p3=float(p3), covariance=covariance)


def fit_orthogonal(resonances: Mapping[AddedMass, Resonance]) -> PendulumEstimate:
    """Fit (84) with the error of Y allowed for in regressor and target (by odrpack).

    Raises
    ------
    InputError
        If the extra is not installed.
    """
    if find_spec("odrpack") is None:
        raise InputError("odrpack", "package", "not installed", "pip install odrpack")
    from odrpack import odr_fit  # noqa: PLC0415 - an extra, which need not be there

    data = _Data.of(resonances)
    start = fit_ratio(resonances)

    def model(y: NDArray[np.float64], beta: NDArray[np.float64]) -> NDArray[np.float64]:
        """Implicit form: zero where Y, the only noisy variable, is true."""
        return np.asarray((beta[0] + data.z) * y - beta[1] - data.x)

    fit = odr_fit(
        model,
        data.y,
        np.zeros(data.y.size),
        np.array([start.p1, start.p3]),
        weight_x=1 / data.error**2,
        task="implicit-ODR",
    )
    p1, p3 = fit.beta
    return PendulumEstimate(p1=float(p1), p3=float(p3), covariance=np.asarray(fit.cov_beta))
