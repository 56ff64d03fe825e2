"""The independent integrator against SciPy's, a closed form, and its own convergence."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from tests.independent.integrator import Joint, Law, motion, tracking
from tests.plant.setting import integrated

OTHERS = {"drag": 2e-4, "back_emf": 5e-4, "bias": 1e-3, "gravity_beside": 2e-3, "delay": 3.3e-3}
JOINT = Joint(inertia=3e-3, viscous=1e-3, gravity=0.04, gain=0.02, **OTHERS)
BASE = {"base": 0.5, "base_viscous": 0.4, "base_spring": 300.0, "imbalance": 0.01}
SHAKEN = JOINT._replace(**BASE, spring=0.01, spring_rest=0.2, wear=-0.1)
DRY = JOINT._replace(gain=1e-2, coulomb=4e-3, excess=1e-3, excess_velocity=0.1)


def _driven(duration, cycle, omega=4.0):
    """Stamps of an uneven clock, and a sine that is held between them."""
    cycles = cycle * (1 + 0.4 * np.sin(np.arange(round(duration / cycle))))
    stamps = np.concatenate([[0.0], np.cumsum(cycles)])
    return stamps, np.sin(omega * stamps)


def _by_scipy(joint, stamps, inputs, angle):
    """Angles at the stamps, the equation without dry friction solved between all changes."""
    edges = np.unique(np.concatenate([stamps, stamps + joint.delay]))
    edges = edges[edges <= stamps[-1]]
    latest = np.searchsorted(stamps + joint.delay, edges, "right") - 1
    drives = np.where(latest >= 0, joint.gain * inputs[latest], 0.0)
    shares = 1.0 + joint.wear * (edges + np.append(edges[1:], 0.0)) / 2.0

    def rates(_, state, held):
        (x, v, b, w), (drive, share) = state, held
        torque = drive + joint.bias - joint.gravity * math.sin(x)
        torque -= joint.gravity_beside * math.cos(x) + joint.spring * (x - joint.spring_rest)
        torque -= joint.back_emf * v + share * (joint.viscous + joint.drag * abs(v)) * v
        force = joint.imbalance * math.sin(x) * v**2
        force -= joint.base_viscous * w + joint.base_spring * b
        coupled = joint.imbalance * math.cos(x)
        inertias = [[joint.inertia, coupled], [coupled, joint.base or 1.0]]
        a, c = np.linalg.solve(inertias, [torque, force])
        return [v, a, w, c]

    driven = SimpleNamespace(time=edges, input=np.column_stack([drives, shares]))
    return integrated(driven, rates, (angle, 0.0, 0.0, 0.0))[np.isin(edges, stamps)]


@pytest.mark.parametrize("joint", [JOINT, SHAKEN])
def test_without_dry_friction_it_moves_as_dop853_does(joint):
    stamps, inputs = _driven(0.8, 4e-3)
    ours, _ = motion(joint, stamps, inputs, 0.3)
    np.testing.assert_allclose(ours, _by_scipy(joint, stamps, inputs, 0.3), atol=1e-11)


def test_a_decay_by_coulomb_friction_alone_loses_the_same_at_every_turn_and_stops():
    """x(t) = s d + (x_n - s d) cos(w t) from turn to turn, d = coulomb/gravity, of small angles."""
    joint = Joint(inertia=3e-3, viscous=0.0, gravity=0.05, gain=1.0, coulomb=5e-7)
    omega, band, start = math.sqrt(joint.gravity / joint.inertia), 1e-5, 1.07e-4
    stamps = np.arange(0.0, 8.0, 1e-3)
    turn = (omega * stamps / np.pi).astype(int)
    stop = math.ceil((start / band - 1.0) / 2.0)  # turns until what is left lies in the band
    turn, phase = np.minimum(turn, stop), omega * stamps
    sign = np.where(turn % 2, -1.0, 1.0)
    closed = sign * band + (start - (2 * turn + 1) * band) * np.cos(phase)
    closed = np.where(turn == stop, (-1.0) ** stop * (start - 2 * stop * band), closed)
    found, velocity = motion(joint, stamps, np.zeros(stamps.size), start)
    np.testing.assert_allclose(found, closed, atol=1e-12)
    assert velocity[-1] == 0.0


@pytest.mark.parametrize("base", [0.0, 0.5])
def test_its_order_is_four_with_stick_and_slip(base):
    joint = DRY._replace(delay=0.0, base=base, base_spring=40.0, base_viscous=0.4, imbalance=0.01)
    stamps, inputs = _driven(6.0, 0.04, 2.0)
    _, velocity = motion(joint, stamps, inputs, 0.3)
    assert np.sum(velocity == 0.0) > 10  # it rests at many stamps
    coarse, middle, fine, exact = (
        motion(joint, stamps, inputs, 0.3, step=step)[0] for step in (4e-3, 2e-3, 1e-3, 5e-5)
    )
    errors = [np.abs(each - exact).max() for each in (coarse, middle, fine)]
    assert np.all(np.log2(np.array(errors[:-1]) / errors[1:]) > 3.5), errors


@pytest.mark.parametrize(("share", "moves"), [(0.999, False), (1.001, True)])
def test_a_hand_at_rest_slips_when_the_torque_exceeds_what_friction_holds(share, moves):
    joint = DRY._replace(bias=0.0, gravity_beside=0.0, delay=0.0)
    held = share * (joint.coulomb + joint.excess) / joint.gain
    _, velocity = motion(joint, np.arange(0.0, 1.0, 1e-3), np.full(1000, held))
    assert bool(velocity.any()) is moves


def test_a_law_makes_its_input_of_what_it_reads_and_the_joint_moves_by_that_input():
    stamps, _ = _driven(3.0, 8e-3)
    rng = np.random.default_rng(1)
    law = Law(stiffness=40.0, damping=5.0, limit=25.0, count=1e-2, share=0.3)
    wanted, rates = 1.0 - np.cos(stamps), np.sin(stamps)
    pumps, offsets = np.where(stamps < 1.0, 2.0, 0.0), 0.3 + 1e-2 * rng.standard_normal(stamps.size)
    angles, velocities, inputs, readings = tracking(
        DRY, law, (stamps, wanted, rates, pumps, offsets), 0.2
    )
    np.testing.assert_array_equal(readings, 1e-2 * np.rint((angles + offsets) / 1e-2))
    slope = 0.0
    for k in range(stamps.size):
        if k:
            slope += 0.3 * (np.diff(readings)[k - 1] / np.diff(stamps)[k - 1] - slope)
        told = 40.0 * (wanted[k] - readings[k]) + 5.0 * (rates[k] - slope)
        told += pumps[k] if slope >= 0 else -pumps[k]
        assert inputs[k] == pytest.approx(np.clip(told, -25.0, 25.0), abs=1e-9)
    assert np.ptp(np.abs(inputs)) > 10.0
    for ours, again in zip((angles, velocities), motion(DRY, stamps, inputs, 0.2), strict=True):
        np.testing.assert_array_equal(ours, again)
