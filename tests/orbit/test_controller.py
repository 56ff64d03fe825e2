"""The energy-shaping loop and its observer, against a simulated truth and closed forms."""

import math
from dataclasses import replace

import numpy as np
import pytest

from butterfly.errors import InputError
from butterfly.model.energy import Orbit
from butterfly.model.greybox import simulate
from butterfly.model.parameters import LumpedParameters, TorqueDrive
from butterfly.orbit.controller import EnergyShaping, Observer, gain_for
from butterfly.plant.joints import GreyBoxJoint
from butterfly.plant.motor import CommandPath, Reading
from butterfly.plant.sensors import FilteredDifference
from tests.orbit.setting import SIXTY, THESIS, invariant
from tests.plant.setting import JOINTS, robot, under_law

PRESENT = {"p3_offset": 0.1 * 9.81 * 0.003, "bias": -2e-3, "coulomb": 8e-4, "stribeck": 3e-3}
PRESENT |= {"drag": 4e-4, "motor_friction": 0.2, "load_friction": 0.1, "cogging": 3e-3}
PRESENT |= {"spring": 5e-3, "dead_zone": 3e-4, "compression": 400.0}
BESIDE = {"stribeck": {"stribeck_velocity": 1.0}, "cogging": {"cogging_periods": 3.0}}
STEP = 5e-4


def _observed(robot, believed, zero=0.0):
    """Velocity that an observer sees of a driven swing, and the true one."""
    time = np.arange(0, 2, STEP)
    held = 1e-3 * np.sin(3 * time[:-1])
    delivered = robot.delivered(held)
    angle, velocity = simulate(robot, time, np.column_stack([delivered] * 3), 1.0)
    observer = Observer(believed, zero=zero)
    commands = np.concatenate([[0.0], held])
    found = [observer.update(*row) for row in zip(time, angle + zero, commands, strict=True)]
    settled = time > 0.5
    return np.array(found)[settled], velocity[settled]


@pytest.mark.parametrize("name", PRESENT)
def test_an_observer_that_believes_what_is_true_of_a_term_has_no_lag_and_no_bias(name):
    robot = replace(THESIS, **{name: PRESENT[name]} | BESIDE.get(name, {}))
    right, truth = _observed(robot, robot)
    wrong, _ = _observed(robot, replace(robot, **{name: 0.0}))
    error, missed = (np.sqrt(np.mean((found - truth) ** 2)) for found in (right, wrong))
    assert error < min(0.004 * np.std(truth), 0.5 * missed)
    if name == "p3_offset":
        assert abs(np.mean(right - truth)) < 1e-3
        assert abs(np.mean(wrong - truth)) > 5e-3


def test_the_encoder_s_zero_is_taken_off():
    found, truth = _observed(THESIS, THESIS, zero=0.7)
    assert np.abs(found - truth).max() < 0.02


def test_both_poles_of_the_observer_are_at_its_bandwidth():
    """A step of the angle of a joint that nothing acts on: e'' + 2 b e' + b^2 e = 0."""
    free = LumpedParameters(p1=1.0, p2=0.0, p3=0.0, p4=1.0)
    observer, b, step = Observer(free, bandwidth=20.0), 20.0, 1e-4
    observer.update(0.0, 0.0, 0.0)
    times = step * np.arange(1, 4000)
    found = np.array([observer.update(t, 0.1, 0.0) for t in times])
    np.testing.assert_allclose(found, 0.1 * b**2 * times * np.exp(-b * times), atol=0.01)


ROBOT = robot(TorqueDrive(gain=10.0), viscous=1e-3)


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
    values = invariant(THESIS, orbit, log.angle, velocity)
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
    values = invariant(THESIS, orbit, log.angle, velocity)
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
