"""The table of terms against integrals, hand-written equations and the compiled kernel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad

from butterfly.model.energy import potential, pull, stiffness
from butterfly.model.greybox import simulate
from butterfly.model.linear import Linearisation
from butterfly.model.parameters import AddedMass, LumpedParameters
from butterfly.model.terms import CONSERVATIVE, TERMS, Motion, torque_of

ADDED = AddedMass(mass=0.3, arm=0.1)
WHOLE = LumpedParameters(
    p1=0.003,
    p2=2e-3,
    p3=0.04,
    p4=0.5,
    p3_offset=7e-3,
    coulomb=2e-3,
    load=1e-3,
    stribeck=3e-3,
    stribeck_velocity=0.7,
    drag=3e-3,
    bias=-4e-3,
    cogging=5e-3,
    cogging_cosine=-6e-3,
    cogging_periods=3.0,
)
SPEED = 0.9


def _torque(p, x, v, u):
    """The pull of all torques of the equation of motion, written out by hand."""
    friction = p.coulomb + p.stribeck * np.exp(-((v / p.stribeck_velocity) ** 2))
    return (
        p.p4 * u
        - p.p2 * v
        - p.p3 * np.sin(x)
        - p.p3_offset * np.cos(x)
        - friction * np.sign(v)
        - p.drag * abs(v) * v
        + p.bias
        + p.cogging * np.sin(p.cogging_periods * x)
        + p.cogging_cosine * np.cos(p.cogging_periods * x)
    )


@pytest.mark.parametrize("velocity", [-1.3, -0.4, 0.5, 1.7])
def test_the_torques_of_the_table_and_of_the_kernel_are_those_of_the_equation(velocity):
    angle, command = 0.6, 0.02
    loaded = WHOLE.with_added_mass(ADDED)
    expected = _torque(loaded, angle, velocity, command)
    motion = Motion.of(loaded, angle, velocity)._replace(input=command)
    rows = [row for row in TERMS.values() if row.basis and row.name not in {"load", "compression"}]
    assert -torque_of(loaded, motion, rows) == pytest.approx(expected, rel=1e-12)
    h = 1e-4
    _, found = simulate(loaded, np.array([0, h]), np.full((1, 3), command), angle, velocity)
    assert loaded.p1 * (found[1] - velocity) / h == pytest.approx(expected, rel=2e-3)


def test_the_load_on_the_bearing_brakes_by_its_weight_in_newtons():
    motion = Motion(0.0, -SPEED, -1.0, weight=ADDED.weight)
    assert TERMS["load"].basis(motion) == pytest.approx(-0.3 * 9.81)
    alone = replace(WHOLE, load=0.0)
    more = WHOLE.with_added_mass(ADDED).coulomb - alone.with_added_mass(ADDED).coulomb
    assert more == pytest.approx(WHOLE.load * 0.3 * 9.81)


def test_the_compression_s_torque_is_the_slope_of_what_the_drive_loses():
    motion = Motion(0.0, 0.0, 0.0, input=np.array([-0.3, 0.2]))
    c = 1e-6
    lost = -(motion.input / (1 + c * abs(motion.input)) - motion.input) / c
    np.testing.assert_allclose(TERMS["compression"].basis(motion), lost, rtol=1e-5)


@pytest.mark.parametrize("row", CONSERVATIVE, ids=lambda row: row.name)
def test_the_slope_of_a_potential_is_the_torque(row):
    for angle in (-2.0, 0.3, 1.4):
        work, _ = quad(lambda x: float(row.basis(Motion(x, 0.0, 0.0, periods=3.0))), 0.0, angle)
        assert row.potential(angle, 3.0) == pytest.approx(work, rel=1e-9)


@pytest.mark.parametrize(
    "row", [r for r in TERMS.values() if r.describing and r.name != "p1"], ids=lambda r: r.name
)
@pytest.mark.parametrize("omega", [0.8, 3.0])
def test_a_describing_function_is_the_fourier_integral_of_the_torque(row, omega):
    swing = 0.7

    def torque(phase):
        angle, velocity = swing * np.cos(phase), -swing * omega * np.sin(phase)
        motion = Motion(angle, velocity, np.sign(velocity), weight=2.5, periods=3.0)
        return float(row.basis(motion._replace(stribeck_velocity=0.4)))

    ends = [np.pi]
    real = quad(lambda t: torque(t) * np.cos(t), 0, 2 * np.pi, points=ends)[0] / np.pi
    imaginary = -quad(lambda t: torque(t) * np.sin(t), 0, 2 * np.pi, points=ends)[0] / np.pi
    motion = Motion(0.0, 0.0, 0.0, weight=2.5, periods=3.0, stribeck_velocity=0.4)
    found = row.describing(np.array([omega]), np.array([swing]), motion)
    assert complex(np.ravel(found)[0]) * swing == pytest.approx(
        complex(real, imaginary), rel=1e-6, abs=1e-9
    )


@pytest.mark.parametrize("angle", [-1.1, 0.0, 0.4])
def test_pull_stiffness_and_potential_are_those_written_out_by_hand(angle):
    p, n = WHOLE, WHOLE.cogging_periods
    expected = (
        p.p3 * np.cos(angle)
        - p.p3_offset * np.sin(angle)
        - p.cogging * n * np.cos(n * angle)
        + p.cogging_cosine * n * np.sin(n * angle)
    )
    assert stiffness(p, angle) == pytest.approx(expected, rel=1e-12)
    assert Linearisation.of(p, angle).stiffness == pytest.approx(expected, rel=1e-12)
    still = replace(p, p2=0.0, coulomb=0.0, stribeck=0.0, drag=0.0)
    assert pull(p, angle) == pytest.approx(_torque(still, angle, 0.0, 0.0), rel=1e-12)
    work, _ = quad(lambda x: -_torque(still, x, 0.0, 0.0), 0.0, angle)
    assert potential(p, angle) == pytest.approx(work, rel=1e-9, abs=1e-15)


def test_the_response_is_that_of_the_small_motion_about_rest():
    """By hand, with offset and cogging, delay, and back EMF behind the armature's lag."""
    p = replace(WHOLE, back_emf=1.5e-3, time_constant=0.08, delay=0.03)
    omega = np.array([0.7, 3.0, 9.0])
    lag = 1 / (1 + 1j * omega * 0.08)
    spring = p.p3 - p.cogging * 3
    below = spring - p.p1 * omega**2 + 1j * omega * (p.p2 - 1.5e-3 + 1.5e-3 * lag)
    expected = p.p4 * np.exp(-0.03j * omega) * lag / below
    linear = Linearisation.of(p)
    np.testing.assert_allclose(linear.response(omega), expected, rtol=1e-12)
    fine = np.linspace(0.5, 10, 200_001)
    peak = fine[np.argmax(np.abs(linear.response(fine)))]
    assert linear.resonance == pytest.approx(peak, abs=1e-4)
