"""How an orbit is approached: multipliers, and the invariant."""

import math

from butterfly.model.energy import energy


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
