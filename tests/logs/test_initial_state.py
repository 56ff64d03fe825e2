"""A log begins where its first samples are, at rest or in motion, whatever their noise."""

import numpy as np
import pytest

from butterfly.logs.log import Log, Sine
from tests.independent.integrator import Joint, motion

JOINT = Joint(inertia=0.004, viscous=0.002, gravity=0.1, gain=1.0, coulomb=0.002, delay=0.02)
TIME = np.arange(0, 4, 0.004)


def _log(angle, velocity, noise, seed=0):
    inputs = 0.02 * np.sin(4 * TIME + seed)
    found, _ = motion(JOINT, TIME, inputs, angle, velocity)
    return Log(TIME, inputs, found + noise * np.random.default_rng(seed).standard_normal(TIME.size))


@pytest.mark.parametrize("noise", [0.0, 1e-3, 5e-3])
def test_from_rest_it_begins_at_rest_where_its_first_samples_are(noise):
    errors = []
    for seed in range(10):
        log = _log(0.3 * seed / 10, 0.0, noise, seed)
        assert log.initial_state.velocity == 0.0
        errors.append(log.initial_state.angle - 0.3 * seed / 10)
    assert np.max(np.abs(errors)) <= 2 * noise + 1e-5
    assert np.std(errors) <= 0.7 * noise + 1e-5


def test_what_rests_for_long_begins_where_it_rests_whatever_one_sample_says():
    log = _log(0.0, 0.0, 1e-3)
    rests = np.full(500, log.angle[0]) + 1e-3 * np.random.default_rng(1).standard_normal(500)
    angle = np.concatenate([rests, log.angle])
    inputs = np.concatenate([np.zeros(500), log.input])
    held = Log(0.004 * np.arange(angle.size), inputs, angle)
    assert held.initial_state == (pytest.approx(log.angle[0], abs=2e-4), 0.0)


@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_a_log_that_clearly_moves_begins_in_motion(noise):
    for seed, speed in enumerate((-3.0, -1.0, 1.0, 3.0)):
        angle, velocity = _log(0.2, speed, noise, seed).initial_state
        assert angle == pytest.approx(0.2, abs=3 * noise + 1e-3)
        assert velocity == pytest.approx(speed, abs=60 * noise + 0.08)


@pytest.mark.parametrize("phase", [0.0, 0.8, 2.5, 4.0])
def test_a_free_swing_of_ten_samples_a_period_begins_where_its_sine_does(phase):
    """Whether let go or seen from a moment on; by a cubic it is off by several of its swings."""
    time, pace = 0.9 * np.arange(60), 2 * np.pi / 9.0
    swing = Joint(inertia=1.0, viscous=0.04 * pace, gravity=pace**2, gain=1.0)
    start = 0.3 * np.cos(phase), -0.3 * pace * np.sin(phase)
    angle, _ = motion(swing, time, np.zeros_like(time), *start, step=0.02)
    noisy = angle + 0.01 * np.random.default_rng(1).standard_normal(time.size)
    begun = Log(time, np.zeros_like(time), noisy).initial_state
    assert begun.angle == pytest.approx(start[0], abs=0.05)
    assert begun.velocity == pytest.approx(start[1], abs=0.1 * pace)


@pytest.mark.parametrize("phase", [0.0, 0.3, 0.8])
@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_a_free_swing_seen_soon_after_its_turn_begins_in_motion(phase, noise):
    """Though its velocity doubles in the first samples, as that of a joint set going does."""
    pace, time = 2 * np.pi / 1.6, 0.005 * np.arange(660)
    swing = Joint(inertia=1.0, viscous=0.04 * pace, gravity=pace**2, gain=1.0)
    start = 0.3 * np.cos(phase), -0.3 * pace * np.sin(phase)
    angle, _ = motion(swing, time, np.zeros_like(time), *start)
    noisy = angle + noise * np.random.default_rng(1).standard_normal(time.size)
    begun = Log(time, np.zeros_like(time), noisy).initial_state
    assert begun.angle == pytest.approx(start[0], abs=2 * noise + 1e-3)
    assert begun.velocity == pytest.approx(start[1], abs=60 * noise + 0.02)
    assert (begun.velocity == 0) is (phase == 0)


@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_a_log_in_the_steady_swing_of_its_sine_begins_where_that_is(noise):
    """Friction included; to a hundredth of the largest speed, or less."""
    omega, time = 4.0, 0.004 * np.arange(10_000)
    angle, velocity = motion(JOINT, time, 0.02 * np.sin(omega * time), 0.0, 0.0)
    noisy = angle + noise * np.random.default_rng(0).standard_normal(time.size)
    for first in (7000, 7100, 7250):  # any phase of the swing
        inputs = 0.02 * np.sin(omega * time[first:])
        sine = Sine(omega=omega, amplitude=0.02)
        log = Log(time[first:], inputs, noisy[first:], excitation=sine)
        begun = log.initial_state
        assert begun.angle == pytest.approx(angle[first], abs=0.005 * np.ptp(angle[first:]))
        assert begun.velocity == pytest.approx(velocity[first], abs=0.01 * np.ptp(velocity[first:]))
    at_rest = Log(time, 0.02 * np.sin(omega * time), noisy, excitation=sine)
    assert at_rest.initial_state == (pytest.approx(angle[0], abs=2 * noise + 1e-5), 0.0)
