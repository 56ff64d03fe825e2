"""From resonance frequencies of known added masses to p1 and p3, and on to physical parameters.

Without damping Y = (p3 + X)/(p1 + Z) (82), with Y = w_opt^2; multiplied out it is linear (84), but
then the noise of Y stands in a regressor, so that least squares is biased.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import least_squares

from butterfly.errors import IdentifiabilityError, InputError
from butterfly.model.parameters import GRAVITY

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from butterfly.identify.estimate import ParameterEstimate
    from butterfly.identify.resonance import Resonance
    from butterfly.model.parameters import AddedMass


@dataclass(frozen=True, kw_only=True, eq=False)
class PendulumEstimate:
    """p1 in kg m^2 and p3 in N m, with their (2, 2) covariance."""

    p1: float
    p3: float
    covariance: NDArray[np.float64]

    @classmethod
    def of(cls, estimate: ParameterEstimate) -> PendulumEstimate:
        """Take them from an estimate of all parameters."""
        rows = [estimate.names.index(name) for name in ("p1", "p3")]
        p = estimate.parameters
        return cls(p1=p.p1, p3=p.p3, covariance=estimate.covariance[np.ix_(rows, rows)])


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
        if len({(m.inertia, m.gravity_moment) for m in resonances}) < 2:  # noqa: PLR2004
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
    """Fit (84) with the error of Y allowed for in regressor and target (extra ``eiv``).

    Raises
    ------
    InputError
        If the extra is not installed.
    """
    if find_spec("odrpack") is None:
        raise InputError("odrpack", "package", "not installed", "the extra 'eiv'")
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


@dataclass(frozen=True, kw_only=True)
class PhysicalHand:
    """Physical parameters of the hand with their standard errors, from p1, p3 and its mass (83).

    Parameters
    ----------
    com_distance, com_distance_error
        l_c in m.
    inertia, inertia_error
        J_p about the centre of mass in kg m^2.
    """

    com_distance: float
    com_distance_error: float
    inertia: float
    inertia_error: float


INSEPARABLE = (
    "Motion alone does not separate m_p from l_c (only p3 = m_p g l_c), J_p from m_p l_c^2 (only "
    "their sum p1), k_i from R (only p4 = k_i/R), nor k_f from k_emf p4 (only their sum p2): weigh "
    "the hand, and measure R or the current."
)
"""Which of the physical parameters (7) cannot be told from logs."""


def physical_hand(estimate: PendulumEstimate, mass: float, mass_error: float = 0.0) -> PhysicalHand:
    """Separate (83) for a hand that was weighed, errors propagated to first order.

    Parameters
    ----------
    estimate
        p1 and p3 of the bare hand.
    mass, mass_error
        m_p in kg and its standard error.

    Raises
    ------
    InputError
        If the mass is not positive.
    """
    if not mass > 0:
        raise InputError("Hand", "mass", mass, "a positive number of kg")
    distance = estimate.p3 / (mass * GRAVITY)
    inertia = estimate.p1 - mass * distance**2
    covariance = np.zeros((3, 3))
    covariance[:2, :2] = estimate.covariance
    covariance[2, 2] = mass_error**2
    to_distance = np.array([0.0, 1 / (mass * GRAVITY), -distance / mass])
    to_inertia = np.array([1.0, -2 * distance / GRAVITY, distance**2])
    return PhysicalHand(
        com_distance=distance,
        com_distance_error=float(np.sqrt(to_distance @ covariance @ to_distance)),
        inertia=inertia,
        inertia_error=float(np.sqrt(to_inertia @ covariance @ to_inertia)),
    )
