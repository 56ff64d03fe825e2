"""Noise does not bias the weak form, since its equations are seen through simulated ones."""

from dataclasses import replace

import numpy as np
import pytest

from butterfly.identification.estimators import WeakForm
from butterfly.identification.estimators.weak_form import fitted_terms
from butterfly.identification.estimators.weak_regression import refined, seen
from butterfly.model.prior import NO_PRIOR, Prior
from tests.conftest import MASSES
from tests.identification.simulated import ROBOT, noisy, wild

ZEROS = dict.fromkeys(MASSES, 0.0)
NOISE, DRAWS = 1.3e-2, 8


@pytest.fixture(scope="module")
def clean():
    return wild(ROBOT)


def _windows(logs):
    estimator = WeakForm(terms=())
    return [estimator._windows(log, 0.0, 1.0) for log in logs]  # noqa: SLF001 - the step before


def test_least_squares_is_biased_by_noise_and_the_weak_form_is_not(clean):
    """Noise and its negative, so that only what grows with its square is left in the mean."""
    errors = []
    for seed in range(DRAWS):
        for sign in (1, -1):
            logs = noisy(clean, sign * NOISE, np.random.default_rng(seed))
            plain = fitted_terms(logs, _windows(logs), (), NO_PRIOR)[0].values
            free = WeakForm(terms=()).of_logs(logs, ZEROS).parameters
            errors.append([[plain["p3"], plain["p4"]], [free.p3, free.p4]])
    plain, free = np.mean(errors, axis=0) / [ROBOT.p3, ROBOT.p4] - 1
    assert np.all(plain < -1e-3)
    assert np.all(np.abs(free) < 5e-4)


def test_without_noise_they_change_nothing(clean):
    plain = fitted_terms(clean, _windows(clean), (), NO_PRIOR)[0].solved.values
    through = WeakForm(terms=()).of_logs(clean, ZEROS).values
    np.testing.assert_allclose(through[:4], plain[:4], rtol=1e-3)


def test_the_averages_own_errors_where_the_joint_turns_back_are_taken_out():
    """A window's smooth velocity turns late where dry friction bends it: p1 was 0.17 % high."""
    robot = replace(ROBOT, p3=0.0, coulomb=6e-3)
    known = Prior.of({"p3": 0.0, "p4": robot.p4})
    logs = wild(robot)
    plain = fitted_terms(logs, _windows(logs), (), known)[0].values
    free = WeakForm(terms=()).of_logs(logs, ZEROS, known).parameters
    assert plain["p1"] > 1.001 * robot.p1
    assert free.p1 == pytest.approx(robot.p1, rel=3e-4)
    assert free.coulomb == pytest.approx(robot.coulomb, rel=3e-4)


def test_where_the_model_does_not_move_like_the_log_its_own_equations_stand(clean):
    windows = _windows(clean)
    for parameters in (replace(ROBOT, p1=-0.01), replace(ROBOT, p4=-0.5)):
        pairs = seen(clean, windows, parameters, ZEROS)
        assert all(each.instruments is each.windows for each in pairs)
    fit = fitted_terms(clean, windows, (), NO_PRIOR)[0]
    kept = refined(fit, pairs).solved.values
    np.testing.assert_allclose(kept, fit.solved.values, rtol=1e-5, atol=1e-7)
    pairs = seen(clean, windows, ROBOT, ZEROS)
    assert all(each.instruments is not each.windows for each in pairs)


def test_a_parameter_on_its_bound_stays_there():
    frictionless = wild(replace(ROBOT, coulomb=0.0, p2=0.0), duration=8.0)
    logs = noisy(frictionless, 2e-3, np.random.default_rng(1))
    found = WeakForm(terms=("drag",)).of_logs(logs, ZEROS)
    assert found.on_bound
    for name in found.on_bound:
        assert found.values[found.names.index(name)] == 0.0
