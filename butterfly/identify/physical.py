"""From p1 and p3 on to physical parameters of the hand, with propagated errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from butterfly.errors import InputError
from butterfly.model.parameters import GRAVITY

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from butterfly.identify.estimate import ParameterEstimate


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
