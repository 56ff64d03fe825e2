from dataclasses import replace

import control
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from butterfly.errors import InputError
from butterfly.logs.log import Intersample
from butterfly.model.linear import frequency_response
from butterfly.model.parameters import LumpedParameters
from butterfly.signals.frequency_response import response_point

SYSTEM = LumpedParameters(p1=0.003, p2=0.004, p3=0.05, p4=0.03)


def test_gain_and_phase_of_a_known_response(sine_log):
    point = response_point(sine_log)
    assert abs(point.gain) == pytest.approx(0.5, rel=1e-5)
    assert np.angle(point.gain) == pytest.approx(-0.4, abs=1e-5)
    assert point.drift == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("step", [0.001, 0.01, 0.04])
def test_a_held_input_s_half_sample_of_delay_is_taken_out(sine_log, step):
    """Lemma 3: only what a zero-order hold puts in obeys the discrete transfer function."""
    system = control.ss(control.tf([SYSTEM.p4], [SYSTEM.p1, SYSTEM.p2, SYSTEM.p3]))
    sampled = control.sample_system(system, step, "zoh")
    time = np.arange(0, 60, step)
    inputs = 0.1 * np.sin(5 * time)
    angle = control.forced_response(sampled, time, inputs).outputs
    log = replace(
        sine_log,
        time=time,
        input=inputs,
        angle=angle,
        velocity=None,
        intersample=Intersample.ZERO_ORDER_HOLD,
    )
    exact = complex(frequency_response(SYSTEM, 5.0))
    assert response_point(log).gain == pytest.approx(exact, rel=0.3 * (5 * step) ** 2 + 1e-5)


@given(scale=st.floats(0.01, 100), shift=st.floats(-50, 50), offset=st.floats(-3, 3))
def test_the_gain_follows_the_input_s_unit_and_sign_and_nothing_else(
    sine_log, scale, shift, offset
):
    reference = response_point(sine_log).gain
    moved = replace(
        sine_log,
        time=sine_log.time + shift,
        input=-scale * sine_log.input,
        angle=sine_log.angle + offset,
    )
    assert response_point(moved).gain == pytest.approx(-reference / scale, rel=1e-6)


def test_an_input_that_is_not_the_commanded_sine_is_refused(sine_log):
    other = replace(sine_log, input=np.sin(9 * sine_log.time))
    with pytest.raises(InputError, match=r"input: got a signal of which 0% is at 5 rad/s"):
        response_point(other)


def test_a_log_without_a_sine_is_refused(sine_log):
    with pytest.raises(InputError, match="excitation: got none"):
        response_point(replace(sine_log, excitation=None))


def test_time_shift_and_sampling_rate_do_not_change_the_response(sine_log):
    reference = response_point(sine_log)
    shifted = response_point(replace(sine_log, time=sine_log.time + 12.3))
    assert shifted.gain == pytest.approx(reference.gain, rel=1e-9)
    thinned = response_point(sine_log.take(np.arange(0, sine_log.time.size, 3)))
    assert thinned.gain == pytest.approx(reference.gain, rel=1e-4)
