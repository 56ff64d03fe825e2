"""Parameters drawn stay within bounds, and spread as covariance and intervals say."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from butterfly.errors import IdentifiabilityError, InputError
from butterfly.identification.draws import draw_parameters
from butterfly.model.terms import lower_bounds
from tests.conftest import MASSES
from tests.identification import simulated

NAMES = ("p1", "p2", "p3", "p4", "coulomb", "load")
VALUES = np.array([0.003, 1e-3, 0.04, 0.5, 8e-4, 1e-4])


def estimate_of(values, errors, correlation, left_out=(), reach=1.96):
    plain = simulated.estimate_of(
        values, np.outer(errors, errors) * correlation, names=NAMES, reach=reach
    )
    candidates = np.array([values, *left_out])
    return replace(
        plain,
        lower=np.minimum(plain.lower, candidates.min(axis=0)),
        upper=np.maximum(plain.upper, candidates.max(axis=0)),
        left_out=dict(enumerate(left_out)),
    )


def _correlation(rng, count):
    roots = rng.standard_normal((count, count))
    matrix = roots @ roots.T
    spread = np.sqrt(np.diag(matrix))
    return matrix / np.outer(spread, spread)


@given(seed=st.integers(0, 10_000), size=st.floats(1e-3, 0.8), moved=st.floats(0, 2))
def test_draws_stay_within_bounds_and_make_a_joint_with_every_mass(seed, size, moved):
    rng = np.random.default_rng(seed)
    errors = size * VALUES
    left_out = [VALUES + moved * errors * rng.standard_normal(VALUES.size)]
    found = estimate_of(VALUES, errors, _correlation(rng, VALUES.size), left_out)
    draws = draw_parameters(found, 50, masses=MASSES, seed=seed)
    assert draws.values.shape == (50, VALUES.size)
    assert np.all(draws.values >= lower_bounds(NAMES))
    for parameters in draws.parameters:
        for mass in MASSES:
            loaded = parameters.with_added_mass(mass)
            assert loaded.p1 > 0
            assert loaded.coulomb >= 0
    assert draws.weights.sum() == pytest.approx(1)
    assert draws.effective_size == pytest.approx(50)


def test_draws_spread_as_the_intervals_say_however_they_are_wide():
    rng = np.random.default_rng(1)
    correlation = _correlation(rng, VALUES.size)
    errors = 0.02 * VALUES
    plain = estimate_of(VALUES, errors, correlation)
    scatter = np.cov(draw_parameters(plain, 20_000).values.T)
    np.testing.assert_allclose(scatter / np.outer(errors, errors), correlation, atol=0.04)
    apart = VALUES + errors * np.array([5, 0, -3, 0, 0, 0])
    for found in (
        estimate_of(VALUES, errors, correlation, reach=3.5),
        estimate_of(VALUES, errors, correlation, [apart]),
    ):
        spread = draw_parameters(found, 20_000).values.std(axis=0)
        widest = np.maximum(found.upper - VALUES, VALUES - found.lower)
        assert np.all(1.96 * spread > 0.97 * widest)
        assert np.all(1.96 * spread < 1.2 * np.maximum(widest, 2.5 * errors))


def test_a_combination_that_is_well_known_stays_well_known_at_a_bound():
    """Viscous friction on its bound, and a term that takes its place: their sum is known."""
    values, errors = VALUES * np.array([1, 0, 1, 1, 1, 1]), np.full(VALUES.size, 1e-4)
    correlation = np.eye(VALUES.size)
    correlation[0, 1] = correlation[1, 0] = -0.9999
    draws = draw_parameters(estimate_of(values, errors, correlation), 2000).values
    assert (draws[:, 1] == 0).mean() == pytest.approx(0.5, abs=0.05)
    assert draws[:, :2].sum(axis=1).std() < 0.03 * errors[0]


def test_a_seed_fixes_the_draws():
    found = estimate_of(VALUES, 0.1 * VALUES, np.eye(VALUES.size))
    one, same, other = (draw_parameters(found, 60, seed=seed).values for seed in (3, 3, 4))
    np.testing.assert_array_equal(one, same)
    assert not np.any(one == other)


def test_what_cannot_be_drawn_is_refused():
    found = estimate_of(VALUES, 0.1 * VALUES, np.eye(VALUES.size))
    unknown = replace(found, covariance=np.full_like(found.covariance, np.nan))
    with pytest.raises(IdentifiabilityError, match="no covariance"):
        draw_parameters(unknown)
    with pytest.raises(InputError, match="at least 40"):
        draw_parameters(found, 3)
    with pytest.raises(InputError, match="seed"):
        draw_parameters(found, seed=-1)
    light = np.array([-1.0, 0, 0, 0, 0, 0])
    heavy = replace(
        found, values=VALUES + light, lower=found.lower + light, upper=found.upper + light
    )
    with pytest.raises(IdentifiabilityError, match="hardly any"):
        draw_parameters(heavy, masses=MASSES)
