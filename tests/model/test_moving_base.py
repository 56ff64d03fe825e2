"""A base that gives, against Lagrange's equations integrated by scipy, energy and MuJoCo."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from butterfly.errors import InputError
from butterfly.model.greybox import simulate
from butterfly.model.linear import quasi_linear_response
from butterfly.model.parameters import GRAVITY
from butterfly.plant.robot import Robot
from tests.model.bases import ADDED, BASE, JOINT, TIME, drive, simulated
from tests.model.joints import instants


def _integrated(joint, added, moment):
    """Angle, and angles, speeds, ways and speeds of the base; ``moment`` yields h and h'."""
    loaded, mass = joint.with_added_mass(added), BASE.mass + added.mass

    def rates(t, state):
        x, v, y, w = state
        h, lever = moment(loaded, x)
        pull = loaded.p3 * np.sin(x) + loaded.p3_offset * np.cos(x)
        torque = loaded.p4 * drive(t) - loaded.p2 * v - loaded.drag * abs(v) * v + loaded.bias
        force = h * v**2 - BASE.friction * w - y / BASE.compliance
        inertia = [[loaded.p1, lever], [lever, mass]]
        speeding = np.linalg.solve(inertia, [torque - loaded.spring * x - pull, force])
        return v, speeding[0], w, speeding[1]

    start = (0.1, 0.0, 0.0, 0.0)
    return solve_ivp(rates, (0, TIME[-1]), start, t_eval=TIME, rtol=1e-11, atol=1e-13).y


def _of_gravity(loaded, x):
    own, beside = loaded.p3 / GRAVITY, loaded.p3_offset / GRAVITY
    return own * np.sin(x) + beside * np.cos(x), own * np.cos(x) - beside * np.sin(x)


def test_the_joint_moves_as_lagrange_says_and_its_energy_adds_up():
    angle, velocity, way, speed = _integrated(JOINT, ADDED, _of_gravity)
    np.testing.assert_allclose(simulated(JOINT)[0], angle, atol=1e-9)
    still = simulated(replace(JOINT, base_compliance=0.0))[0]
    assert np.abs(still - angle).max() > 5e-3
    loaded = JOINT.with_added_mass(ADDED)
    _, lever = _of_gravity(loaded, angle)
    energy = loaded.p1 * velocity**2 / 2 + lever * velocity * speed - loaded.bias * angle
    energy += (BASE.mass + ADDED.mass) * speed**2 / 2 + way**2 / BASE.compliance / 2
    energy += loaded.p3 * (1 - np.cos(angle)) + loaded.p3_offset * np.sin(angle)
    energy += loaded.spring * angle**2 / 2
    power = loaded.p4 * drive(TIME) * velocity - loaded.p2 * velocity**2
    power -= loaded.drag * abs(velocity) ** 3 + BASE.friction * speed**2
    supplied = np.concatenate([[0], np.cumsum(np.diff(TIME) * (power[:-1] + power[1:]) / 2)])
    np.testing.assert_allclose(energy - energy[0], supplied, atol=1e-5 * energy.max())


def test_without_gravity_the_moments_are_those_of_added_masses():
    added = replace(ADDED, gravity=0.0)
    joint = replace(JOINT, p3=0.0, p3_offset=0.0)
    own = added.mass * added.arm
    angle, *_ = _integrated(joint, added, lambda _, x: (own * np.sin(x), own * np.cos(x)))
    np.testing.assert_allclose(simulated(joint, added)[0], angle, atol=1e-9)


def test_a_base_is_heavier_than_the_hand_and_has_no_states_beside_it():
    light = replace(JOINT, base_compliance=0.02)
    robot = Robot.of_lumped(light)
    assert robot.hand.mass < robot.base.mass < 0.1
    assert robot.lumped.p1 == pytest.approx(JOINT.p1)
    with pytest.raises(InputError, match=r"Base: compliance.*more than the mass of the joint"):
        Robot.of_lumped(light, mass=0.3)
    for name in ("motor_friction", "bristle_stiffness"):
        with pytest.raises(InputError, match=f"Base: {name}.*not simulated"):
            simulated(replace(JOINT, coulomb=1e-3, **{name: 0.1}))


@pytest.mark.parametrize("swing", [0.02, 0.4])
def test_the_response_of_a_steady_swing_is_that_of_the_simulation(swing):
    """A base that hardly gives: its describing function is what compliance does to first order."""
    joint = replace(JOINT, bias=0.0, p3_offset=0.0, drag=0.0, base_compliance=1e-5)
    loaded, w = joint.with_added_mass(ADDED), 9.0
    time = np.arange(0, 60 * 2 * np.pi / w, 1e-3)
    whole = time > 40 * 2 * np.pi / w
    found, told = [], []
    for each in (loaded, replace(loaded, base_compliance=0.0)):
        told.append(complex(quasi_linear_response(each, w, swing)))
        drive = swing / abs(told[-1])
        angle = simulate(each, time, drive * np.sin(w * instants(time)), 0.0)[0][whole]
        found.append(2j * np.mean(angle * np.exp(-1j * w * time[whole])) / drive)
    assert found[0] - found[1] == pytest.approx(told[0] - told[1], rel=0.05)
