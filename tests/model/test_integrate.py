"""A joint is integrated with order four."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from butterfly.model.greybox import simulate
from tests.model.joints import PENDULUM, instants


def test_without_coulomb_friction_it_tends_to_an_independent_integrator_with_order_four():
    p, errors = PENDULUM, []

    def rates(t, state):
        x, v = state
        torque = p.p4 * 0.5 * math.sin(4 * t)
        return [v, (torque - p.p2 * v - p.p3 * math.sin(x)) / p.p1]

    for step in (0.02, 0.01, 0.0025):
        time = np.arange(0, 2 + step / 2, step)
        exact = solve_ivp(rates, (0, time[-1]), [0.3, 0], "DOP853", time, rtol=1e-12, atol=1e-13)
        angle, _ = simulate(p, time, 0.5 * np.sin(4 * instants(time)), 0.3)
        errors.append(np.abs(angle - exact.y[0]).max())
    assert errors[2] < 1e-9
    assert math.log2(errors[0] / errors[1]) == pytest.approx(4, abs=0.3)
