"""Orbits, against closed forms of the pendulum."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ellipe, ellipk

from butterfly.errors import InputError
from butterfly.model.energy import Orbit, energy, potential
from tests.orbit.setting import SIXTY, THESIS, invariant


def test_the_60_degree_orbit_has_the_known_period_and_squared_speed_whatever_names_it():
    orbit = Orbit.of_amplitude(THESIS, SIXTY)
    assert orbit.period == pytest.approx(1.7357, abs=5e-5)
    assert orbit.squared_speed == pytest.approx(12.627, abs=5e-4)
    speed = math.sqrt(2 * orbit.energy / THESIS.p1)
    assert Orbit.of_state(THESIS, 0.0, speed).upper == pytest.approx(SIXTY, rel=1e-9)
    assert energy(THESIS, 0.0, speed) == pytest.approx(THESIS.p3 * (1 - math.cos(SIXTY)))


@settings(max_examples=30)
@given(amplitude=st.floats(0.05, 3.0))
def test_quadrature_equals_the_elliptic_integrals(amplitude):
    orbit = Orbit.of_amplitude(THESIS, amplitude)
    natural, k = math.sqrt(THESIS.p3 / THESIS.p1), math.sin(amplitude / 2)
    assert orbit.period == pytest.approx(4 * ellipk(k**2) / natural, rel=1e-7)
    closed = 16 * natural * (ellipe(k**2) - (1 - k**2) * ellipk(k**2))
    assert orbit.squared_speed == pytest.approx(closed, rel=1e-7)


@settings(max_examples=5)
@given(st.floats(-0.02, 0.02), st.floats(-0.005, 0.005), st.floats(-0.01, 0.01))
def test_with_offset_bias_and_cogging_the_energy_is_conserved(offset, bias, cogging):
    p = replace(THESIS, p3_offset=offset, bias=bias, cogging=cogging, cogging_periods=3)
    orbit = Orbit.of_energy(p, potential(p, 0.9))
    times = np.linspace(0, orbit.period, 50)
    angle, velocity = orbit.solution(times)
    assert np.abs(invariant(p, orbit, angle, velocity)).max() < 1e-10
    assert angle[-1] == pytest.approx(orbit.upper, abs=1e-7)
    assert angle.min() == pytest.approx(orbit.lower, abs=0.02)


@pytest.mark.parametrize("target", [-0.01, 0.0, 2 * THESIS.p3])
def test_energies_without_a_swing_are_refused_with_the_reason(target):
    with pytest.raises(InputError, match="turns over"):
        Orbit.of_energy(THESIS, target)
    with pytest.raises(InputError, match="between 0 and pi"):
        Orbit.of_amplitude(THESIS, 4.0)


@pytest.mark.parametrize("amplitude", [0.2, 1.5, 2.8])
def test_a_hand_whose_mass_lies_above_its_pivot_swings_about_the_inverted_rest(amplitude):
    inverted = replace(THESIS, p3=-THESIS.p3)
    orbit = Orbit.of_energy(inverted, inverted.p3 * (1 + math.cos(amplitude)))
    assert abs(orbit.upper - orbit.lower) == pytest.approx(2 * amplitude, rel=1e-9)
    assert math.cos(0.5 * (orbit.upper + orbit.lower)) == pytest.approx(-1)
    period = 4 * ellipk(math.sin(amplitude / 2) ** 2) * math.sqrt(THESIS.p1 / THESIS.p3)
    assert orbit.period == pytest.approx(period, rel=1e-7)
    angle, velocity = orbit.solution(np.linspace(0, orbit.period, 40))
    assert np.abs(energy(inverted, angle, velocity) - orbit.energy).max() < 1e-10
    assert angle[-1] == pytest.approx(orbit.upper, abs=1e-6)
