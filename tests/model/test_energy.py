"""Energies, torques and friction of the whole model, against the equation written out by hand."""

import numpy as np
import pytest
from scipy.integrate import quad

from butterfly.model.energy import potential, pull
from butterfly.model.linear import LinearJoint
from butterfly.model.parameters import AddedMass
from butterfly.model.terms import DRIVE, TERMS, torque_of
from tests.model.joints import SLIDING

ADDED = AddedMass(mass=0.3, arm=0.1)


def _torque(p, x, v=0.0, u=0.0):
    """The pull of all torques of the equation of motion, written out by hand."""
    friction = p.coulomb + p.stribeck * np.exp(-((v / p.stribeck_velocity) ** 2))
    moving = p.p4 * u - p.p2 * v - friction * np.sign(v) - p.drag * abs(v) * v
    ripple = p.cogging * np.sin(p.cogging_periods * x)
    ripple += p.cogging_cosine * np.cos(p.cogging_periods * x)
    return moving + ripple + p.bias - p.spring * x - p.p3 * np.sin(x) - p.p3_offset * np.cos(x)


@pytest.mark.parametrize("velocity", [-1.3, 0.5])
def test_the_torques_of_the_table_are_those_of_the_equation(velocity):
    loaded = SLIDING.with_added_mass(ADDED)
    motion = loaded.motion(0.6, velocity, input=0.02)
    rows = [row for row in TERMS.values() if row.basis and row.name not in {"load", *DRIVE}]
    expected = _torque(loaded, 0.6, velocity, 0.02)
    assert -torque_of(loaded, motion, rows) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("angle", [-1.1, 0.0, 0.4])
def test_pull_stiffness_and_potential_are_those_written_out_by_hand(angle):
    p, n = SLIDING, SLIDING.cogging_periods
    expected = (
        p.p3 * np.cos(angle)
        - p.p3_offset * np.sin(angle)
        - p.cogging * n * np.cos(n * angle)
        + p.cogging_cosine * n * np.sin(n * angle)
        + p.spring
    )
    assert LinearJoint.of(p, angle).stiffness == pytest.approx(expected, rel=1e-12)
    assert pull(p, angle) == pytest.approx(_torque(p, angle), rel=1e-12)
    work, _ = quad(lambda x: -_torque(p, x), 0.0, angle)
    assert potential(p, angle) == pytest.approx(work, rel=1e-9, abs=1e-15)
