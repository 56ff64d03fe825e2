"""Responses of sine logs: their steady part, a transient beside it, and all of one mass."""

from dataclasses import replace

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from butterfly.errors import InputError
from butterfly.logs.log import Intersample, Sine
from butterfly.model.control_bridge import linearised
from butterfly.model.linear import LinearJoint
from butterfly.model.parameters import AddedMass, LumpedParameters
from butterfly.signals.frequency_response import (
    measured_response,
    pole_of,
    response_point,
    sine_basis,
    steady_window,
)
from tests.identification.simulated import simulated
from tests.signals.sines import fit_sine

SYSTEM = LumpedParameters(p1=0.003, p2=0.004, p3=0.05, p4=0.03)
ROBOT = LumpedParameters(p1=0.003, p2=4e-3, p3=0.04, p4=0.5, delay=0.02)
MASS = AddedMass(mass=0.05, arm=0.104)
SWING = 0.02
FIRST = Intersample.FIRST_ORDER_HOLD


def test_gain_and_phase_of_a_known_response(sine_log):
    point = response_point(sine_log)
    assert abs(point.gain) == pytest.approx(0.5, rel=1e-5)
    assert np.angle(point.gain) == pytest.approx(-0.4, abs=1e-5)
    assert point.drift == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("step", [0.002, 0.01, 0.04])
def test_a_held_input_s_half_sample_of_delay_is_taken_out(sine_log, step):
    """Lemma 3: only what a zero-order hold puts in obeys the discrete transfer function."""
    system = control.ss(control.tf([SYSTEM.p4], [SYSTEM.p1, SYSTEM.p2, SYSTEM.p3]))
    sampled = control.sample_system(system, step, "zoh")
    time = np.arange(0, 40, step)
    inputs = 0.1 * np.sin(5 * time)
    angle = control.forced_response(sampled, time, inputs).outputs
    held = replace(sine_log, intersample=Intersample.ZERO_ORDER_HOLD)
    log = replace(held, time=time, input=inputs, angle=angle, velocity=None)
    exact = complex(LinearJoint.of(SYSTEM).response(5.0))
    assert response_point(log).gain == pytest.approx(exact, rel=0.3 * (5 * step) ** 2 + 1e-5)


@pytest.mark.parametrize("kind", list(Intersample))
@pytest.mark.parametrize("omega", [5.0, 7.3])
def test_the_input_s_phasor_is_that_of_the_held_sine_as_the_samples_of_two_rates_see_it(
    sine_log, kind, omega
):
    steps = np.where(np.arange(20000) < 12000, 0.002, 0.008)  # 24 s of one rate, 64 of the other
    time = np.cumsum(steps)
    wave, sine = np.cos(omega * time), Sine(omega=omega, amplitude=1.0)
    log = replace(sine_log, time=time, input=wave, angle=wave, velocity=None, excitation=sine)
    log = replace(log, intersample=kind)
    for first, step in ((0, 0.002), (12000, 0.008)):
        own = log.take(np.arange(first, first + 4000))
        half = omega * step / 2
        held = np.sinc(half / np.pi) * np.exp(-1j * half)
        expected = abs(held) ** 2 if kind is Intersample.FIRST_ORDER_HOLD else held
        assert response_point(own, 8.0).input == pytest.approx(expected, abs=3e-4)
    both = response_point(log.take(np.arange(8000, 14000)), 24.0)
    late = np.average([0.001, 0.004], weights=[4000, 2000]) if kind is not FIRST else 0.0
    assert np.angle(both.input) == pytest.approx(-omega * late, rel=0.06, abs=1e-4)


@settings(max_examples=10)
@given(scale=st.floats(0.01, 100), shift=st.floats(-50, 50), offset=st.floats(-3, 3))
def test_the_gain_follows_the_input_s_unit_and_sign_and_nothing_else(
    sine_log, scale, shift, offset
):
    reference = response_point(sine_log).gain
    moved = replace(sine_log, time=sine_log.time + shift, angle=sine_log.angle + offset)
    moved = replace(moved, input=-scale * sine_log.input)
    assert response_point(moved).gain == pytest.approx(-reference / scale, rel=1e-6)


def test_a_log_without_a_sine_or_of_another_or_of_too_few_periods_is_refused(sine_log):
    other = replace(sine_log, input=np.sin(9 * sine_log.time))
    with pytest.raises(InputError, match=r"input: got a signal with 0% of its variance at 5 rad/s"):
        response_point(other)
    with pytest.raises(InputError, match="excitation: got none"):
        response_point(replace(sine_log, excitation=None))
    with pytest.raises(InputError, match="at least 3 periods"):
        steady_window(replace(sine_log, excitation=Sine(omega=0.3, amplitude=1.0)), 0.3)


@pytest.mark.parametrize("omega", [2.0, 4.75, 16.0])
def test_the_steady_window_holds_whole_periods_at_the_end(sine_log, omega):
    rows = steady_window(sine_log, omega, 30.0)
    duration = rows.sum() * sine_log.mean_step
    periods = duration * omega / (2 * np.pi)
    assert rows[-1]
    assert periods == pytest.approx(round(periods), abs=0.01)
    assert 30 - 2 * np.pi / omega < duration <= 30.001


def test_three_periods_of_a_slow_sine_may_take_longer_than_the_window(sine_log):
    slowest = 3.5 * 2 * np.pi / (sine_log.time[-1] - sine_log.time[0])
    seconds = 2.0 * np.pi / slowest  # room for one
    rows = steady_window(sine_log, slowest, seconds)
    assert rows.sum() * sine_log.mean_step == pytest.approx(3.0 * seconds, rel=1e-2)


def _decay(time, pole, phase=0.7):
    return np.real(0.1 * np.exp(pole * time + 1j * phase))


TIME = np.arange(0, 30, 2e-3)


@pytest.mark.parametrize("pole", [-0.05 + 4.3j, -0.3 + 6.1j, -1.0 + 9.0j])
def test_the_pole_of_a_decay_is_found(pole):
    time = 3.0 + TIME
    assert pole_of(time, _decay(time, pole)) == pytest.approx(pole, rel=1e-3)


def test_noise_and_jittered_stamps_move_it_little_and_what_grows_is_called_no_decay():
    noise = np.random.default_rng(0).standard_normal((2, TIME.size))
    time = np.sort(TIME + 4e-4 * noise[0])
    pole = -0.1 + 5.2j
    assert pole_of(time, _decay(time, pole) + 5e-3 * noise[1]) == pytest.approx(pole, abs=5e-3)
    assert pole_of(TIME, _decay(TIME, 0.1 + 5.2j)).real <= 0


def test_a_sine_beside_a_ringing_transient_is_read_right_with_its_pole():
    omega, phasor = 3.0, 0.2 * np.exp(-0.4j)
    angle = np.real(phasor * np.exp(1j * omega * TIME)) + _decay(TIME, -0.05 + 3.6j)
    plain = fit_sine(TIME, angle, omega)
    pole = pole_of(TIME, angle - plain.on(sine_basis(TIME, omega)))
    calmer = fit_sine(TIME, angle, omega, pole=pole)
    errors = [abs(fit.fundamental - phasor) / abs(phasor) for fit in (plain, calmer)]
    assert errors[0] > 0.02
    assert errors[1] < 0.05 * errors[0]


def _point(mass, omega):
    gain = abs(linearised(ROBOT, mass)["angle", "command"](1j * omega))
    sine = Sine(omega=omega, amplitude=SWING / gain)
    return response_point(simulated(ROBOT, mass, sine.sample, 50.0, sine=sine))


def test_of_small_swings_it_lies_on_the_state_space_s_response_within_a_tenth_of_a_per_cent():
    points = [_point(MASS, omega) for omega in (8.0, 2.0, 3.5)] + [_point(AddedMass(), 3.0)]
    found = measured_response(points, MASS)
    assert isinstance(found, control.FrequencyResponseData)
    np.testing.assert_array_equal(found.omega, [2.0, 3.5, 8.0])
    assert (found.input_labels, found.output_labels) == (["command"], ["angle"])
    expected = linearised(ROBOT, MASS)["angle", "command"](1j * found.omega)
    np.testing.assert_allclose(found.complex, expected, rtol=1e-3)
    alone = measured_response(points)
    np.testing.assert_array_equal(alone.omega, [3.0])


def test_logs_of_one_frequency_count_as_one_by_least_squares(sine_log):
    point = response_point(sine_log)
    other = replace(point, input=3j * point.input)
    found = measured_response([point, other, point], point.added_mass)
    inputs = np.array([point.input, other.input, point.input])
    expected = np.linalg.lstsq(inputs[:, None], np.full(3, point.angle.fundamental), rcond=None)[0]
    assert found.omega.tolist() == [point.omega]
    np.testing.assert_allclose(found.complex, expected, rtol=1e-12)


def test_a_mass_that_was_not_measured_is_refused(sine_log):
    with pytest.raises(InputError, match="added mass: got 200 g at 100 mm"):
        measured_response([response_point(sine_log)], AddedMass(mass=0.2, arm=0.1))
