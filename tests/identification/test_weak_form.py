from dataclasses import replace

import numpy as np
import pytest

from butterfly.errors import IdentifiabilityError, InputError
from butterfly.identification.estimators import WeakForm
from butterfly.identification.test_functions import Averaging
from butterfly.logs.log import InputKind, Intersample, Log
from butterfly.model.greybox import simulate
from butterfly.model.parameters import LumpedParameters
from butterfly.model.terms import IDEAL, DriveTerms, FrictionTerms
from tests.conftest import MASSES
from tests.identification.simulated import TONES, noisy, simulated

ROBOT = LumpedParameters(
    p1=0.003, p2=5e-4, p3=0.04, p4=0.5, coulomb=2e-4, delay=0.004, drag=1e-4, p3_offset=-2e-3
)
BOTH = WeakForm(terms=("drag", "p3_offset"))
ZEROS = dict.fromkeys(MASSES, 0.3)


def _multisine(time):
    return 0.006 * np.sum([np.sin(w * time + k * k) for k, w in enumerate(TONES)], axis=0)


@pytest.fixture(scope="module")
def logs():
    seen = {"start": 0.2, "step": 1e-3, "zero": 0.3}
    return [simulated(ROBOT, mass, _multisine, 40.0, source=f"{mass}", **seen) for mass in MASSES]


def test_the_robot_is_found_from_any_input_and_noise_of_a_few_encoder_steps_does_little(logs):
    found = BOTH.of_logs(logs, ZEROS)
    truth = np.array([getattr(ROBOT, name) for name in found.names])
    np.testing.assert_allclose(found.values, truth, rtol=0.02)
    large = [found.names.index(name) for name in ("p1", "p3", "p4")]
    np.testing.assert_allclose(found.values[large], truth[large], rtol=2e-3)
    spoilt = BOTH.of_logs(noisy(logs, 5e-4, np.random.default_rng(0)), ZEROS)
    np.testing.assert_allclose(spoilt.values[large], truth[large], rtol=0.01)


def test_unit_sign_clock_and_order_change_p4_alone(logs):
    moved = [replace(log, time=log.time + 7.0, input=-3.0 * log.input) for log in reversed(logs)]
    before, after = (WeakForm().of_logs(each, ZEROS).values for each in (logs, moved))
    after[3] *= -3.0
    np.testing.assert_allclose(after, before, rtol=1e-4)


def test_a_third_of_the_sampling_rate_gives_the_same(logs):
    coarse = [log.take(np.arange(0, log.time.size, 3)) for log in logs]
    fine, thinned = (BOTH.of_logs(each, ZEROS).values for each in (logs, coarse))
    np.testing.assert_allclose(thinned[:4], fine[:4], rtol=0.01)


def test_on_a_slow_clock_a_held_input_s_gain_is_right():
    """Steps of 10 ms at up to 8 rad/s: by the means of the input, p4 would be 1.5e-4 too high."""
    robot = LumpedParameters(p1=0.003, p2=1e-3, p3=0.04, p4=0.5)
    time = np.arange(0, 60, 0.01)
    fine = np.arange(0, 59.99 + 5e-5, 1e-4)
    held = np.repeat(_multisine(time[:-1]), 100)
    logs = []
    for mass in MASSES:
        angle, _ = simulate(robot.with_added_mass(mass), fine, np.column_stack([held] * 3), 0.0)
        log = Log(
            time=time,
            input=_multisine(time),
            angle=angle[::100],
            input_kind=InputKind.TORQUE,
            intersample=Intersample.ZERO_ORDER_HOLD,
            added_mass=mass,
        )
        logs.append(log)
    found = WeakForm(terms=()).of_logs(logs, dict.fromkeys(MASSES, 0.0)).parameters
    assert found.p4 == pytest.approx(robot.p4, rel=1e-5)
    assert found.delay == pytest.approx(0.0, abs=1e-6)


def test_kept_averages_are_those_of_a_log_made_ready_anew(logs):
    kept = Averaging(logs[1], 0.3, 0.25, FrictionTerms())
    yielding = DriveTerms(compression=2.0, dead_zone=0.01)
    for names, delay, drive in (
        (("p1", "p4"), 0.0, IDEAL),
        (("p4", "coulomb", "delay"), 0.004, IDEAL),
        (("p1", "compression", "p4"), 0.0041, yielding),
        (("p4", "p1", "p3", "dead_zone"), 0.0, yielding),
        (("delay", "p4"), 0.004, IDEAL),
    ):
        found, fresh = (
            each.signals(names, delay=delay, drive=drive)
            for each in (kept, Averaging(logs[1], 0.3, 0.25, FrictionTerms()))
        )
        assert list(found.mean) == list(names)
        np.testing.assert_array_equal(found.time, fresh.time)
        np.testing.assert_array_equal(found.still, fresh.still)
        for name in names:
            np.testing.assert_array_equal(found.mean[name], fresh.mean[name])


def test_what_cannot_be_estimated_is_refused(logs):
    with pytest.raises(InputError, match="did you mean"):
        WeakForm(terms=("dreg",)).of_logs(logs, ZEROS)
    with pytest.raises(IdentifiabilityError, match="common factor"):
        WeakForm().of_logs(logs[:1], ZEROS)
    with pytest.raises(InputError, match="at least"):
        WeakForm().of_logs([logs[0].take(np.arange(100)), logs[1]], ZEROS)
