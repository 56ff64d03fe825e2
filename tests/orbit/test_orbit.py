"""The energy-shaping loop and its orbit, against closed forms of the pendulum."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ellipe, ellipk

from butterfly.errors import InputError
from butterfly.model.energy import Orbit, energy, potential
from butterfly.model.parameters import LumpedParameters, TorqueDrive
from butterfly.orbit.controller import EnergyShaping, Observer, gain_for
from butterfly.plant.joints import GreyBoxJoint
from butterfly.plant.motor import CommandPath, Reading
from butterfly.plant.sensors import FilteredDifference
from tests.plant.setting import JOINTS, robot, under_law

THESIS = LumpedParameters(p1=0.00325, p2=0.001, p3=0.04905, p4=10)
SIXTY = math.radians(60)
ROBOT = robot(TorqueDrive(gain=10.0), viscous=1e-3)


def _invariant(parameters, orbit, angle, velocity):
    """(n,) values of I = E - E* (107) in J along a motion."""
    return energy(parameters, angle, velocity) - orbit.energy


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
    assert np.abs(_invariant(p, orbit, angle, velocity)).max() < 1e-10
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


def test_the_command_is_the_law_103_with_all_friction_and_the_drive_made_up_for():
    """By hand, at one reading after the difference has settled on a constant velocity."""
    p = replace(THESIS, coulomb=4e-4, drag=2e-4, compression=50.0, dead_zone=1e-5)
    orbit = Orbit.of_amplitude(p, SIXTY)
    for speed in (1.2, -1.2):
        law = EnergyShaping(orbit, 0.3, zero=0.1)
        readings = [Reading(1e-3 * k, 0.1 + speed * 1e-3 * (k - 199), 0.0) for k in range(200)]
        found = [law(reading) for reading in readings][-1]
        excess = p.p1 * speed**2 / 2 - p.p3 * (1 - math.cos(SIXTY))
        friction = p.p2 * speed + (p.coulomb + p.drag * speed**2) * math.copysign(1, speed)
        plain = friction / p.p4 - 0.3 * speed * excess
        lost = math.copysign(p.dead_zone, plain)
        assert found == pytest.approx(plain / (1 - p.compression * abs(plain)) + lost, rel=1e-6)
        assert p.delivered(found) == pytest.approx(plain)


@pytest.mark.parametrize("speed", [1.2, -1.2])
def test_the_command_overcomes_the_friction_that_it_makes_in_a_gear_itself(speed):
    p = replace(THESIS, coulomb=4e-4, motor_friction=0.2, load_friction=0.1)
    law, without = (EnergyShaping(Orbit.of_amplitude(each, SIXTY), 0.3) for each in (p, THESIS))
    for k in range(200):
        reading = Reading(1e-3 * k, speed * 1e-3 * (k - 150), 0.0)
        found, wanted = law(reading), without(reading)
    motor, load = p.p4 * found, -p.p3 * math.sin(reading.angle)
    friction = p.coulomb + abs(0.2 * motor - 0.1 * load)
    assert motor - math.copysign(friction, speed) == pytest.approx(p.p4 * wanted, rel=1e-6)


@pytest.mark.parametrize("joint", JOINTS)
def test_the_loop_holds_the_orbit_from_within_and_from_without(joint):
    orbit = Orbit.of_amplitude(THESIS, SIXTY)
    gamma = gain_for(orbit, 0.5)
    for start in (0.3, 1.6):
        law = EnergyShaping(orbit, gamma)
        log = under_law(joint(ROBOT, angle=start), law, 18.0, 4e-3)
        last = log.angle[log.time > 15]
        assert np.abs(last).max() == pytest.approx(SIXTY, abs=0.02)


def test_from_rest_a_kick_starts_it_and_the_command_stays_within_its_limit():
    orbit = Orbit.of_amplitude(THESIS, SIXTY)
    law = EnergyShaping(orbit, gain_for(orbit, 0.3), kick=5e-4)
    log = under_law(GreyBoxJoint(ROBOT), law, 40.0, 4e-3, path=CommandPath(limit=5e-4))
    assert np.abs(log.input).max() == 5e-4
    assert np.abs(log.angle[log.time > 36]).max() == pytest.approx(SIXTY, abs=0.02)


def test_the_invariant_decays_as_the_closed_form_says():
    orbit = Orbit.of_amplitude(THESIS, SIXTY)
    gamma = gain_for(orbit, 0.6)
    law = EnergyShaping(orbit, gamma, velocity=Observer(THESIS, bandwidth=200.0))
    log = under_law(GreyBoxJoint(ROBOT, angle=SIXTY + 0.05), law, 4 * orbit.period)
    velocity = np.gradient(log.angle, log.time)
    values = _invariant(THESIS, orbit, log.angle, velocity)
    areas = np.concatenate([[0], np.cumsum(velocity[:-1] ** 2 * np.diff(log.time))])
    expected = values[5] * np.exp(-THESIS.p4 * gamma * (areas - areas[5]))  # (114)
    np.testing.assert_allclose(values[5:], expected[5:], atol=0.03 * values[5])


def test_a_wrong_belief_about_friction_settles_at_the_predicted_invariant():
    """Along the motion dI/dt = thd^2 (p4 p2hat/p4hat - p2 - p4 gamma I), with p1 and p3 right."""
    believed = replace(THESIS, p2=0.0013, p4=9.0)
    orbit = Orbit.of_amplitude(believed, SIXTY)
    gamma = gain_for(orbit, 0.1)
    excess = THESIS.p4 * believed.p2 / believed.p4 - THESIS.p2
    predicted = excess / (THESIS.p4 * gamma)
    law = EnergyShaping(orbit, gamma, velocity=FilteredDifference(0.001))
    log = under_law(GreyBoxJoint(ROBOT, angle=1.0), law, 20.0)
    velocity = np.gradient(log.angle, log.time)
    values = _invariant(THESIS, orbit, log.angle, velocity)
    upwards = np.flatnonzero((log.angle[:-1] < 0) & (log.angle[1:] >= 0) & (log.time[1:] > 12))
    periods = slice(upwards[0], upwards[-1])
    found = np.average(values[periods], weights=velocity[periods] ** 2)
    assert found == pytest.approx(predicted, rel=5e-4)


@pytest.mark.parametrize("wrong", [0.0, 1.0, -1.0])
def test_what_makes_no_sense_is_refused(wrong):
    orbit = Orbit.of_amplitude(THESIS, SIXTY)
    with pytest.raises(InputError, match="multiplier"):
        gain_for(orbit, wrong)
    with pytest.raises(InputError, match="gamma"):
        EnergyShaping(orbit, min(wrong, 0.0))
    with pytest.raises(InputError, match="bandwidth"):
        Observer(THESIS, bandwidth=min(wrong, 0.0))
