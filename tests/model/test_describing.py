"""Describing functions, against Fourier integrals."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from butterfly.model.terms import BASE_TERMS, TERMS
from tests.model.rows import ADDED, PLAIN, motion_at


@pytest.mark.parametrize(("a", "w"), [(0.02, 14.0), (0.8, 3.0), (2.9, 1.2)])
@pytest.mark.parametrize(
    "name", [n for n, row in TERMS.items() if row.describing and n not in BASE_TERMS]
)
def test_a_describing_function_is_the_fourier_integral_of_the_basis(name, a, w):
    row, still = TERMS[name], motion_at(0.0, 0.0, weight=ADDED.weight, mass=ADDED.mass, carried=1.0)

    def torque(t):
        angle, velocity = a * math.cos(t), -a * w * math.sin(t)
        motion = PLAIN.motion(angle, velocity, weight=ADDED.weight, mass=ADDED.mass)
        inertial = row.derivative == 2 or name == "mass_inertia"
        return -(w**2) * angle if inertial else float(row.basis(motion))

    def integral(weight):
        weighed = quad(lambda t: torque(t) * weight(t), 0, 2 * math.pi, points=[math.pi], limit=200)
        return weighed[0] / (math.pi * a)

    found = complex(row.describing(np.array(w), np.array(a), still))
    assert found == pytest.approx(complex(integral(math.cos), -integral(math.sin)), rel=1e-7)
