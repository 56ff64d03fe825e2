from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from butterfly.logs.faults import clipped, saturated
from butterfly.model.greybox import simulate
from butterfly.model.parameters import LumpedParameters

TIME = np.arange(20_000) * 1e-3
HAND = LumpedParameters(p1=0.00325, p2=0.00145, p3=0.04905, p4=0.025, coulomb=3e-4)
STEPS = [0.0, 6e-6, 1.9e-4, 2e-3]
"""Encoder steps in rad; 0 reads exact angles."""


@cache
def _swing(omega, amplitude, coulomb, stribeck, *, switched=False):
    """Angles in rad of a hand that sticks at its turning points for a while."""
    hand = replace(HAND, coulomb=coulomb, stribeck=stribeck * coulomb, stribeck_velocity=0.05)
    stiffness = abs(complex(hand.p3 - hand.p1 * omega**2, hand.p2 * omega))
    torque = stiffness * amplitude + 1.3 * (1 + stribeck) * coulomb
    wave = np.sin(omega * TIME)
    inputs = torque / hand.p4 * (0.7 * np.sign(wave) if switched else wave)
    angle, _ = simulate(hand, TIME, np.column_stack([inputs] * 3), 0.0)
    return angle


def _read(angle, step, noise, seed=0):
    noisy = angle + noise * np.random.default_rng(seed).standard_normal(angle.size)
    return noisy if step == 0 else np.round(noisy / step) * step


@pytest.mark.parametrize("switched", [False, True])
@pytest.mark.parametrize("stribeck", [0.0, 1.0])
@pytest.mark.parametrize("coulomb", [3e-4, 3e-3, 8e-3])
@pytest.mark.parametrize("omega", [1.0, 3.0, 8.0, 16.0])
def test_a_joint_that_sticks_where_it_turns_is_not_clipped(omega, coulomb, stribeck, switched):
    for amplitude in (0.3, 0.8):
        angle = _swing(omega, amplitude, coulomb, stribeck, switched=switched)
        for step in STEPS:
            for noise in (0.0, 5e-5, 2e-4):
                read = _read(angle, step, noise)
                assert np.ptp(read) == 0 or clipped(read) == 0, (amplitude, step, noise)


@pytest.mark.parametrize("noise", [0.0, 5e-5, 2e-4])
@pytest.mark.parametrize("step", STEPS)
@pytest.mark.parametrize("coulomb", [0.0, 3e-4, 3e-3])
@pytest.mark.parametrize("omega", [1.0, 3.0, 8.0, 16.0])
def test_a_swing_cut_off_is_counted(omega, coulomb, step, noise):
    angle = _swing(omega, 0.5, coulomb, 0.0)
    level = 0.7 * np.abs(angle[10_000:]).max()
    level = level if step == 0 else np.round(level / step) * step
    read = np.clip(_read(angle, step, noise), -level, level)
    assert clipped(read) > 0.85 * np.count_nonzero(np.abs(read) == level)


@given(
    omega=st.floats(0.5, 20),
    amplitude=st.floats(0.02, 1.5),
    phase=st.floats(0, 6.3),
    step=st.floats(1e-6, 1e-3),
    noise=st.sampled_from([0.0, 1e-5, 3e-4]),
)
def test_a_smooth_swing_is_not_clipped_however_coarse_its_encoder(
    omega, amplitude, phase, step, noise
):
    assert clipped(_read(amplitude * np.sin(omega * TIME + phase), step, noise)) == 0


def test_a_joint_that_leaves_its_stop_abruptly_is_judged_by_how_it_came():
    """It comes to rest like a ball thrown up, holds, and falls off in a straight line."""
    rise = 0.1 - 2.0 * (TIME[:300][::-1]) ** 2
    angle = np.concatenate([rise, np.full(500, 0.1), 0.1 - 1.5 * TIME[1:120]])
    angle = np.round(np.tile(angle, 5) / 1.9e-4) * 1.9e-4
    assert clipped(angle) == 0
    assert clipped(angle[::-1]) == 0


def test_a_triangle_cut_off_on_one_side_is_counted_there():
    triangle = np.abs((3 * TIME) % 2 - 1)
    cut = np.maximum(triangle, 0.2)
    inside = (cut == 0.2) & (TIME > 0.5) & (TIME < 19.5)
    assert clipped(cut) >= np.count_nonzero(inside)


def test_a_constant_or_switched_input_is_not_saturated():
    assert saturated(np.zeros(100)) == 0
    assert saturated(np.sign(np.sin(TIME + 0.1))) == 0
    assert saturated(np.clip(np.sin(3 * TIME), -2, 0.9)) > 0
