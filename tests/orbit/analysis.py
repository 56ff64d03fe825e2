"""How an orbit is approached: multipliers, and the invariant."""

import math

import numpy as np
from scipy.integrate import solve_ivp

from butterfly.model.energy import energy, pull, stiffness


def invariant(parameters, orbit, angle, velocity):
    """Return (n,) values of I = E - E* (107) in J along a motion."""
    return energy(parameters, angle, velocity) - orbit.energy


def multiplier_of(orbit, gamma):
    """Return the Floquet multiplier exp(-p4 gamma oint thd^2 dt) of the loop on its orbit."""
    return math.exp(-abs(orbit.parameters.p4) * gamma * orbit.squared_speed)


def steady_invariant(true, believed, gamma):
    """Return the invariant I in J at which the loop settles when p2 or p4 are believed wrongly.

    Along the motion dI/dt = thd^2 (p4 p2hat/p4hat - p2 - p4 gamma I), zero at
    (p4 p2hat/p4hat - p2)/(p4 gamma); p1 and p3 are taken to be right.
    """
    return (true.p4 * believed.p2 / believed.p4 - true.p2) / (true.p4 * gamma)


def monodromy(orbit, gamma):
    """Return the (2, 2) monodromy matrix of the exact loop (104), (109) on its orbit.

    Integrated numerically with the variational equation; one of its eigenvalues is 1, along the
    orbit, the other `multiplier_of`.
    """
    p = orbit.parameters
    strength = abs(p.p4) * gamma

    def rhs(_, y):
        x, v = y[:2].tolist()
        torque, excess = pull(p, x), energy(p, x, v) - orbit.energy
        acceleration = (torque - strength * v * excess) / p.p1
        jacobian = np.array(
            [
                [0.0, 1.0],
                [
                    (strength * v * torque - stiffness(p, x)) / p.p1,
                    -strength * (excess + p.p1 * v**2) / p.p1,
                ],
            ]
        )
        return np.concatenate([[v, acceleration], (jacobian @ y[2:].reshape(2, 2)).ravel()])

    start = np.concatenate([[orbit.upper, 0.0], np.eye(2).ravel()])
    solved = solve_ivp(rhs, (0, orbit.period), start, "DOP853", rtol=1e-10, atol=1e-12)
    return solved.y[2:, -1].reshape(2, 2)
