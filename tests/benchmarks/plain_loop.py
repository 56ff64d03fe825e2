"""The plainest compiled loop that steps a joint, as somebody writes it in an afternoon."""

import math

import numba
import numpy as np


@numba.njit(error_model="numpy")
def swing(parameters, drives, step, angle):
    """Return the angle by Runge-Kutta of order 4, friction a sign, torques of stages given."""
    p1, p2, p3, coulomb = parameters
    found = np.empty(len(drives) + 1)
    found[0], x, v = angle, angle, 0.0
    for k in range(len(drives)):
        a1 = (drives[k, 0] - p2 * v - p3 * math.sin(x) - coulomb * np.sign(v)) / p1
        v2 = v + 0.5 * step * a1
        a2 = drives[k, 1] - p2 * v2 - p3 * math.sin(x + 0.5 * step * v) - coulomb * np.sign(v2)
        v3 = v + 0.5 * step * a2 / p1
        a3 = drives[k, 1] - p2 * v3 - p3 * math.sin(x + 0.5 * step * v2) - coulomb * np.sign(v3)
        v4 = v + step * a3 / p1
        a4 = drives[k, 2] - p2 * v4 - p3 * math.sin(x + step * v3) - coulomb * np.sign(v4)
        x += step / 6 * (v + 2 * v2 + 2 * v3 + v4)
        v += step / 6 * (a1 + (2 * a2 + 2 * a3 + a4) / p1)
        found[k + 1] = x
    return found
