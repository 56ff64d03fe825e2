"""Conditions of logs: a log has a frequency if its motion repeats."""

import numpy as np
import pytest

from butterfly.identification.agreement import Condition, Conditions
from butterfly.logs.log import Log, Sine

TIME = np.linspace(0.0, 4.0, 2001)
STEP = 1.0 - np.exp(-3.0 * TIME)
OVERSHOOT = 1.0 - np.exp(-2.0 * TIME) * np.cos(5.0 * TIME)
DECAY = np.exp(-0.5 * TIME) * np.cos(6.0 * TIME)
PACE = 5.0
SINE = np.sin(PACE * TIME)


def _log(angle, **more):
    return Log(time=TIME, input=np.ones(TIME.size), angle=angle, **more)


def _squares(*logs):
    return Conditions.of(logs, 1).values.get(Condition.FREQUENCY)


@pytest.mark.parametrize("angle", [STEP, -STEP, OVERSHOOT, TIME, 0.1 * SINE + TIME])
@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_a_log_that_goes_from_here_to_there_has_no_frequency(angle, noise):
    noisy = angle + noise * np.random.default_rng(1).standard_normal(TIME.size)
    assert _squares(_log(noisy), _log(2.0 * noisy)) is None


def test_a_log_that_swings_has_that_of_its_motion():
    assert _squares(_log(SINE))[0] ** 0.5 == pytest.approx(PACE, rel=0.05)
    assert _squares(_log(DECAY))[0] ** 0.5 == pytest.approx(6.0, rel=0.1)


def test_the_drive_of_a_sine_has_one_however_short_the_log():
    part = Log(
        time=TIME[:200],
        input=SINE[:200],
        angle=TIME[:200],
        excitation=Sine(omega=PACE, amplitude=1.0),
    )
    assert _squares(part)[0] == pytest.approx(PACE**2)


def test_of_logs_without_a_frequency_nothing_follows_it():
    sines = [_log(np.sin(omega * TIME)) for omega in (4.0, 6.0)]
    both, with_step = _squares(*sines), _squares(*sines, _log(STEP))
    np.testing.assert_allclose(with_step, [*both, both.mean()])
