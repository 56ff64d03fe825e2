"""The weak form, its averages over test functions, and noise, which does not bias it."""

from dataclasses import replace

import numpy as np
import pytest

from butterfly.errors import IdentifiabilityError, InputError
from butterfly.identification.estimators import WeakForm
from butterfly.identification.estimators.weak_form import instruments_of, refined
from butterfly.identification.test_functions import Averaging, half_width_of
from butterfly.identification.weak_regression import averaging_of
from butterfly.logs.log import Log, Sine
from butterfly.model.parameters import LumpedParameters
from butterfly.model.prior import NO_PRIOR, Prior
from butterfly.model.terms import IDEAL, DriveTerms, FrictionTerms
from tests.conftest import MASSES
from tests.identification.simulated import ROBOT as PLAIN
from tests.identification.simulated import TONES, driven, noisy, simulated, wild
from tests.independent.integrator import Joint

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
    return [simulated(ROBOT, mass, _multisine, 20.0, source=f"{mass}", **seen) for mass in MASSES]


def test_the_robot_is_found_from_any_input_and_noise_of_a_few_encoder_steps_does_little(logs):
    found = BOTH.of_logs(logs, ZEROS)
    truth = np.array([getattr(ROBOT, name) for name in found.names])
    np.testing.assert_allclose(found.values, truth, rtol=0.02)
    large = [found.names.index(name) for name in ("p1", "p3", "p4")]
    np.testing.assert_allclose(found.values[large], truth[large], rtol=2e-3)
    spoilt = BOTH.of_logs(noisy(logs, 5e-4, np.random.default_rng(0)), ZEROS)
    np.testing.assert_allclose(spoilt.values[large], truth[large], rtol=0.01)


def test_on_a_slow_clock_a_held_input_s_gain_is_right():
    """Steps of 10 ms at up to 8 rad/s: by the means of the input, p4 would be 1.5e-4 too high."""
    time, logs = np.arange(0, 30, 0.01), []
    for mass in MASSES:
        joint = Joint(0.003 + mass.inertia, 1e-3, 0.04 + mass.gravity_moment, 0.5)
        logs.append(driven(joint, time, _multisine(time), added_mass=mass))
    found = WeakForm(terms=()).of_logs(logs, dict.fromkeys(MASSES, 0.0)).parameters
    assert found.p4 == pytest.approx(0.5, rel=1e-5)
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
        np.testing.assert_array_equal(found.moving, fresh.moving)
        for name in names:
            np.testing.assert_array_equal(found.mean[name], fresh.mean[name])


def test_a_log_shorter_than_its_averages_is_refused(logs):
    short = [logs[0].take(np.arange(100)), logs[1]]
    with pytest.raises(InputError, match=r"at least 0\.5 s, the length of one window"):
        WeakForm(half_width=0.25).of_logs(short, ZEROS)
    assert replace(BOTH, half_width=None).of_logs(short, ZEROS).parameters.p1 == pytest.approx(
        PLAIN.p1, rel=0.01
    )


HALF, STEP = 0.25, 1e-3
AT_ZERO = dict.fromkeys(MASSES, 0.0)
NOISE, DRAWS = 1.3e-2, 4


@pytest.fixture(scope="module")
def clean():
    return wild(PLAIN)


def _plain(logs, known=NO_PRIOR):
    return WeakForm(terms=(), half_width=HALF).least_squares(logs, AT_ZERO, known)


def test_least_squares_is_biased_by_noise_and_the_weak_form_is_not(clean):
    """Noise and its negative, so that only what grows with its square is left in the mean."""
    errors = []
    for seed in range(DRAWS):
        for sign in (1, -1):
            logs = noisy(clean, sign * NOISE, np.random.default_rng(seed))
            plain = _plain(logs).values
            free = WeakForm(terms=(), half_width=HALF).of_logs(logs, AT_ZERO).parameters
            errors.append([[plain["p3"], plain["p4"]], [free.p3, free.p4]])
    plain, free = np.mean(errors, axis=0) / [PLAIN.p3, PLAIN.p4] - 1
    assert np.all(plain < -1e-3)
    assert np.all(np.abs(free) < 5e-4)


def test_without_noise_they_change_nothing(clean):
    plain = _plain(clean).solved.values
    through = WeakForm(terms=()).of_logs(clean, AT_ZERO).values
    np.testing.assert_allclose(through[:4], plain[:4], rtol=1e-3)


def test_the_averages_own_errors_where_the_joint_turns_back_are_taken_out():
    """A window's smooth velocity turns late where dry friction bends it: p1 was 0.17 % high."""
    robot = replace(PLAIN, p3=0.0, coulomb=6e-3)
    known = Prior.of({"p3": 0.0, "p4": robot.p4})
    logs = wild(robot)
    plain = _plain(logs, known).values
    free = WeakForm(terms=()).of_logs(logs, AT_ZERO, known).parameters
    assert plain["p1"] > 1.001 * robot.p1
    assert free.p1 == pytest.approx(robot.p1, rel=3e-4)
    assert free.coulomb == pytest.approx(robot.coulomb, rel=3e-4)


def test_where_the_model_does_not_move_like_the_log_its_own_equations_stand(clean):
    fit = _plain(clean)
    windows = fit.about.windows
    for parameters in (replace(PLAIN, p1=-0.01), replace(PLAIN, p4=-0.5)):
        found = instruments_of(clean, windows, parameters, AT_ZERO)
        assert all(each is own for each, own in zip(found, windows, strict=True))
    kept = refined(fit, found).solved.values
    np.testing.assert_allclose(kept[:-1], fit.solved.values[:-1], rtol=1e-5, atol=1e-7)
    assert kept[-1] == pytest.approx(fit.solved.values[-1], abs=1e-5)  # of the delay, as it settles
    found = instruments_of(clean, windows, PLAIN, AT_ZERO)
    assert all(each is not own for each, own in zip(found, windows, strict=True))


def test_a_parameter_on_its_bound_stays_there():
    frictionless = wild(replace(PLAIN, coulomb=0.0, p2=0.0), duration=8.0)
    logs = noisy(frictionless, 2e-3, np.random.default_rng(1))
    found = WeakForm(terms=("drag",)).of_logs(logs, AT_ZERO)
    assert found.on_bound
    for name in found.on_bound:
        assert found.values[found.names.index(name)] == 0.0


def _swing(period, samples, periods, noise, seed=0):
    """A swing of .3 rad; noise over it, and samples in a period."""
    time = period / samples * np.arange(round(periods * samples) + 1)
    angle = 0.3 * np.cos(2 * np.pi * time / period)
    angle += 0.3 * noise * np.random.default_rng(seed).standard_normal(time.size)
    return Log(time, np.zeros_like(time), angle)


def test_windows_have_the_log_s_own_time():
    assert half_width_of(_swing(2.0, 1000, 10, 1e-4)) == HALF  # of an ordinary log
    slow = half_width_of(_swing(20.0, 1000, 10, 1e-4))
    assert HALF <= slow < 2.0  # without noise as short
    assert half_width_of(_swing(20.0, 1000, 10, 0.1)) == pytest.approx(5.0, rel=0.05)
    assert half_width_of(_swing(0.4, 1000, 10, 1e-4)) == pytest.approx(0.1, rel=0.01)
    assert half_width_of(_swing(0.4, 1000, 1.5, 1e-4)) == pytest.approx(0.6 / 10, rel=0.01)
    assert half_width_of(_swing(0.4, 10, 10, 1e-4)) == pytest.approx(5 * 0.04)  # few samples
    assert half_width_of(_swing(2.0, 1000, 10, 30.0)) >= HALF  # noise has no period
    assert half_width_of(_swing(2.0, 500, 10, 0.0)) == HALF
    still = replace(_swing(2.0, 500, 10, 0.0), angle=np.zeros(5001))
    assert half_width_of(still) > 0


def test_windows_that_are_asked_for_are_those_of_sines_too(logs):
    sine = replace(logs[0], excitation=Sine(omega=10.0, amplitude=0.1))
    assert averaging_of(sine, 0.3).half_width == pytest.approx(np.pi / 20)
    assert averaging_of(sine, 0.3, 0.3).half_width == 0.3


def test_fewer_windows_than_values_are_refused_in_these_words(logs):
    short = logs[0].take(np.arange(700))
    with pytest.raises(
        IdentifiabilityError, match=r"contain \d+ windows of 0.5 s in which"
    ) as refused:
        WeakForm(half_width=HALF).of_logs([short], ZEROS, Prior.of({"p4": ROBOT.p4}))
    assert "cannot be identified" not in str(refused.value)
