"""Margins of the energy-shaping loop, against closed forms and against loops that are late."""

import math
from dataclasses import replace

import numpy as np
import pytest

from butterfly.errors import InputError
from butterfly.model.energy import Orbit, energy, pull
from butterfly.model.linear import LinearJoint
from butterfly.model.parameters import LumpedParameters, TorqueDrive
from butterfly.orbit.controller import EnergyShaping, gain_for, loop_margins
from butterfly.plant.joints import GreyBoxJoint
from butterfly.plant.motor import CommandPath
from tests.plant.setting import robot, under_law

pytestmark = pytest.mark.slow

FREE = LumpedParameters(p1=0.00325, p2=0.0, p3=0.04905, p4=10)
SIXTY = math.radians(60)
CYCLE = 2e-3


@pytest.mark.parametrize("amplitude", [0.3, SIXTY, 2.5])
@pytest.mark.parametrize(
    "changes", [{}, {"p3_offset": 0.01, "cogging": 5e-3, "cogging_periods": 3}]
)
def test_without_delay_the_multiplier_is_the_closed_form_and_no_gain_is_too_large(
    amplitude, changes
):
    """exp(-p4 gamma oint thd^2 dt), which is 0.3 at the gain for it."""
    orbit = Orbit.of_amplitude(replace(FREE, p2=1e-3, **changes), amplitude)
    gamma = gain_for(orbit, 0.3)
    for factor in (0.01, 1.0, 3.0):
        expected = 0.3**factor
        margins = loop_margins(orbit, factor * gamma)
        assert margins.multiplier == pytest.approx(expected, rel=1e-5)
        assert margins.gain == (0.0, math.inf)


@pytest.mark.parametrize(("amplitude", "multiplier"), [(0.3, 0.5), (SIXTY, 0.9), (SIXTY, 0.1)])
def test_without_friction_the_delay_margin_is_a_quarter_period_less_the_lag(amplitude, multiplier):
    """The velocity has odd harmonics alone, so a quarter late it does no work on the whole."""
    orbit = Orbit.of_amplitude(replace(FREE, delay=0.03), amplitude)
    margins = loop_margins(orbit, gain_for(orbit, multiplier), lag=0.02)
    assert margins.delay == pytest.approx(orbit.period / 4 - 0.05, rel=1e-3)


@pytest.mark.parametrize("delay", [0.02, 0.1, 0.3])
def test_the_multiplier_is_the_decay_of_a_small_deviation_from_step_to_step(delay):
    """Heun's method on the delay equation itself, its past remembered."""
    orbit = Orbit.of_amplitude(FREE, SIXTY)
    p, gamma, periods = orbit.parameters, gain_for(orbit, 0.5), 6
    late = round(delay / CYCLE)
    time = np.arange(0, periods * orbit.period + 2 * CYCLE, CYCLE)
    angle, velocity = orbit.solution(time)
    slope = [LinearJoint.of(p, x).stiffness / p.p1 for x in angle.tolist()]
    change = np.stack([[-pull(p, x) for x in angle.tolist()], p.p1 * velocity], axis=1)
    x, excess, torque = np.array([0.01, 0.0]), [], [0.0] * late

    def rate(k, state, command):
        return np.array([state[1], -slope[k] * state[0] + command / p.p1])

    for k in range(time.size - 1):
        excess.append(change[k] @ x)
        torque.append(-p.p4 * gamma * velocity[k] * excess[-1])
        first = rate(k, x, torque[k])
        after = torque[k + 1] if late else 0.0
        x = x + 0.5 * CYCLE * (first + rate(k + 1, x + CYCLE * first, after))
    at = np.interp(np.arange(2, periods) * orbit.period, time[:-1], excess)
    found = np.abs(at[1:] / at[:-1])
    assert found[-1] == pytest.approx(loop_margins(orbit, gamma, lag=delay).multiplier, rel=0.01)


def _held(orbit, gamma, delay, duration):
    """Largest deviation of the energy in the last periods, as a share of the orbit's."""
    p = orbit.parameters
    held = robot(TorqueDrive(gain=10.0), viscous=p.p2, coulomb=p.coulomb)
    joint = GreyBoxJoint(held, angle=1.02 * orbit.upper)

    class Exact:
        def update(self, *_):
            return joint.velocity

    law = EnergyShaping(orbit, gamma, velocity=Exact())
    try:
        log = under_law(joint, law, duration, CYCLE, path=CommandPath(delay=delay))
    except InputError:  # the joint spins faster and faster
        return math.inf
    last = log.time > duration - 4 * orbit.period
    turn = np.abs(log.angle[last]).max()
    return abs(float(energy(p, turn, 0.0)) / orbit.energy - 1)


def test_the_nonlinear_loop_holds_within_the_margins_and_loses_the_orbit_beyond():
    orbit, lag = Orbit.of_amplitude(FREE, SIXTY), 0.1
    gamma = gain_for(orbit, 0.5)
    margins = loop_margins(orbit, gamma, lag=lag + CYCLE / 2)
    assert margins.gain[0] == 0.0
    assert _held(orbit, 0.9 * margins.gain[1] * gamma, lag, 30) < 1e-3
    assert _held(orbit, 1.1 * margins.gain[1] * gamma, lag, 30) > 0.1
    assert _held(orbit, gamma, lag + 0.9 * margins.delay, 60) < 0.01
    assert _held(orbit, gamma, lag + 1.1 * margins.delay, 60) > 0.5


@pytest.mark.parametrize(
    ("friction", "multiplier", "lag"),
    [({"p2": 1e-3}, 0.5, 0.1), ({"p2": 1e-3}, 0.2, 0.05), ({"coulomb": 4e-4}, 0.5, 0.02)],
)
def test_with_friction_made_up_for_late_the_hand_swings_on_within_the_margin_and_rests_beyond(
    friction, multiplier, lag
):
    orbit = Orbit.of_amplitude(replace(FREE, **friction), SIXTY)
    gamma = gain_for(orbit, multiplier)
    margins = loop_margins(orbit, gamma, lag=lag + CYCLE / 2)
    assert margins.delay < 0.95 * (orbit.period / 4 - lag)
    assert _held(orbit, gamma, lag + 0.9 * margins.delay, 100) < 0.8
    assert _held(orbit, gamma, lag + 1.1 * margins.delay, 100) > 0.97


def test_too_little_gain_lets_late_friction_win():
    """At small swings, the loop about rest: it starts by itself if it pumps more than p2 takes."""
    p = replace(FREE, p2=1e-3)
    orbit = Orbit.of_amplitude(p, 0.2)
    gamma, lag = gain_for(orbit, 0.9), 0.05
    low, _ = loop_margins(orbit, gamma, lag=lag).gain
    turn = math.sqrt(p.p3 / p.p1) * lag
    balance = p.p2 * (1 / math.cos(turn) - 1) / (p.p4 * gamma * orbit.energy)
    assert low == pytest.approx(balance, rel=0.05)


def test_a_loop_that_holds_no_orbit_has_no_margins():
    orbit = Orbit.of_amplitude(FREE, SIXTY)
    with pytest.raises(InputError, match=r"0\.5 s of lag"):
        loop_margins(orbit, gain_for(orbit, 0.5), lag=0.5)
    with pytest.raises(InputError, match="lag"):
        loop_margins(orbit, 0.01, lag=-0.1)
