"""Standard errors against spreads, and what estimators say of their own checks."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from butterfly.errors import IdentifiabilityError, InputError
from butterfly.identification.data import DataSet
from butterfly.identification.estimators import HarmonicBalance, Loss, OutputError, WeakForm
from butterfly.identification.predict import draw_parameters
from butterfly.identification.problem import Start
from butterfly.identification.test_functions import HALF_WIDTH, Averaging
from butterfly.identification.weak_regression import WeakFit
from butterfly.model.prior import LAG, NO_PRIOR, SCALES, Prior
from butterfly.model.terms import PARAMETERS, FrictionTerms, lower_bounds
from tests.conftest import MASSES
from tests.identification.simulated import ROBOT, SWINGS, estimate_of, noisy, steady, wild

ZEROS = dict.fromkeys(MASSES, 0.0)
START = [Start(ROBOT, ZEROS)]


@pytest.mark.slow
def test_the_weak_form_s_standard_errors_are_its_spread_for_logs_of_unequal_length():
    masses = MASSES * 4
    late = replace(ROBOT, delay=0.005)  # far from its bound, where spread is less than half
    clean = wild(late, masses, 16.0)
    shares = np.resize([0.1, 1.0, 0.15, 0.1, 0.4], len(clean))
    clean = [
        log.take(np.arange(int(share * log.time.size)))
        for log, share in zip(clean, shares, strict=True)
    ]
    rng = np.random.default_rng(0)
    estimator = WeakForm(terms=())
    fits = [estimator.of_logs(noisy(clean, 5e-4, rng), ZEROS) for _ in range(120)]
    spread = np.std([fit.values for fit in fits], axis=0)
    claimed = np.sqrt(np.mean([fit.standard_errors**2 for fit in fits], axis=0))
    np.testing.assert_allclose(claimed / spread, 1.0, atol=0.2)  # 3 errors of 120 draws


def test_every_log_weighs_the_same_in_the_weak_form_however_long_and_lively():
    """The sum over logs of rows times residuals vanishes, each over its squared inertial torque."""
    logs = noisy(wild(ROBOT, MASSES, 16.0), 2e-3, np.random.default_rng(2))
    logs = [logs[0].take(np.arange(1200)), *logs[1:]]
    averages = [Averaging(log, 0.0, HALF_WIDTH, FrictionTerms()) for log in logs]
    values = WeakFit.of(averages, PARAMETERS, NO_PRIOR).values
    delay = values.pop("delay")
    parts = {True: 0.0, False: 0.0}
    for log, averaging in zip(logs, averages, strict=True):
        signals = averaging.signals(tuple(values), delay=delay)
        columns = {name: signals.mean[name][signals.moving] for name in values}
        rows = np.column_stack(list(columns.values()))
        carried = log.added_mass.inertia * columns["p1"]
        carried = carried + log.added_mass.gravity_moment * columns["p3"]
        score = rows.T @ (rows @ np.array(list(values.values())) + carried)
        size = columns["p1"] @ columns["p1"]
        parts[True] = parts[True] + score / size
        parts[False] = parts[False] + score / 1e3
    assert np.abs(parts[True]).max() < 1e-8
    assert np.abs(parts[False]).max() > 1e-6


def test_a_spoilt_log_misleads_neither_a_robust_loss_nor_weighed_logs():
    logs = noisy(wild(ROBOT, MASSES * 2, 6.0), 2e-3, np.random.default_rng(1))
    angle = logs[1].angle.copy()
    angle[1200:1500] += 0.5
    spoilt = [logs[0], replace(logs[1], angle=angle), *logs[2:]]

    def fit(some, loss):
        estimator = OutputError(terms=(), loss=loss, workers=1)
        found = estimator.of_logs(some, START)
        return found.values[3], found.standard_errors[3]

    _, clean = fit(logs, Loss.LINEAR)
    for loss, most in ((Loss.CAUCHY, 12.0), (Loss.LINEAR, 3.0)):  # a start is fitted by squares
        p4, error = fit(spoilt, loss)
        assert abs(p4 - ROBOT.p4) < 4 * error
        assert clean < error < most * clean
        assert error < 5e-4 * ROBOT.p4


def test_what_only_one_log_has_is_fitted_to_it_and_used_to_predict_it():
    biases = (-2e-3, 0.0, 3e-3)
    logs = [
        replace(wild(replace(ROBOT, bias=bias), (mass,), 8.0)[0], name=f"log {k}")
        for k, (mass, bias) in enumerate(zip(MASSES, biases, strict=True))
    ]
    estimator = OutputError(terms=(), per_log=("bias",), workers=1)
    found = estimator.of_logs(logs, START)
    assert [found.local[f"log {k}"]["bias"] for k in range(3)] == pytest.approx(biases, abs=2e-5)
    assert [found.applied(log)[0].bias for log in logs] == pytest.approx(biases, abs=2e-5)
    other = replace(logs[0], name="another")
    assert found.applied(other)[0].bias == found.parameters.bias == 0.0
    assert found.local[None]["zero"] == pytest.approx(0.0, abs=1e-4)
    assert DataSet.of(logs).simulations.fits(found).min() > 99.5


def test_a_zero_that_nobody_fitted_is_each_mass_s_own():
    found = replace(estimate_of(np.ones(4), np.eye(4)), local={"log 1": {"bias": 0.1}})
    zeros = [("zero", mass) for mass in MASSES]
    assert found.owners(MASSES) == [("bias", "log 1"), *zeros]
    fitted = replace(found, local={None: {"zero": 0.2}, "log 1": {"velocity": 1.0}})
    assert fitted.owners(MASSES) == [("zero", None)]


@pytest.fixture(scope="module")
def sines():
    return DataSet.of(steady(ROBOT, SWINGS))


@pytest.fixture(scope="module")
def plain(sines):
    return HarmonicBalance(terms=())(sines)


def test_a_mass_in_two_spellings_is_left_out_as_one(sines):
    def spelt(mass):
        return replace(mass, mass=(1 + 1e-12) * mass.mass, mass_uncertainty=1e-12 * bool(mass.mass))

    logs = [
        replace(log, added_mass=spelt(log.added_mass)) if k % 2 else log
        for k, log in enumerate(sines.logs)
    ]
    once, twice = (HarmonicBalance(terms=())(DataSet.of(each)) for each in (sines.logs, logs))
    assert len(DataSet.of(logs).masses) == len(MASSES)
    for limits in ("lower", "upper"):
        expected = getattr(once, limits)
        np.testing.assert_allclose(getattr(twice, limits), expected, rtol=1e-6)


def _rescaled(log, scale, share):
    """Return a log in whose recording one scale is off by some share."""
    mass, sine = log.added_mass, log.excitation
    if scale == "mass_scale":
        return replace(log, added_mass=replace(mass, mass=mass.mass / (1 + share)))
    if scale == "gravity_scale":
        return replace(log, added_mass=replace(mass, gravity=mass.gravity / (1 + share)))
    if scale == "time_scale":
        sine = replace(sine, omega=sine.omega * (1 + share))
        return replace(log, time=log.time / (1 + share), excitation=sine)
    if scale == LAG:
        return replace(log, angle=np.interp(log.time - share, log.time, log.angle))
    column = scale.removesuffix("_scale")
    return replace(log, **{column: getattr(log, column) / (1 + share)})


@pytest.mark.parametrize("scale", [*sorted(SCALES), LAG])
def test_the_uncertainty_of_a_scale_widens_errors_by_what_it_would_move(sines, plain, scale):
    share, estimator = 2e-4, HarmonicBalance(terms=())
    told = replace(sines, known=Prior.of({scale: (float(scale != LAG), share)}))
    wide = estimator(told)
    off = estimator(DataSet.of([_rescaled(log, scale, share) for log in sines.logs]))
    added = np.sqrt(np.diag(wide.covariance) - np.diag(plain.covariance))
    moved = np.abs(off.values - plain.values)
    for name in ("p1", "p2", "p3", "p4"):
        k = plain.names.index(name)
        size = share * abs(plain.values[k])
        assert added[k] == pytest.approx(moved[k], abs=0.1 * moved[k] + 0.15 * size), name
    assert scale != LAG or added[plain.names.index("delay")] == pytest.approx(share, rel=1e-3)


def test_a_scale_is_not_uncertain_beside_an_exact_value(sines):
    known = Prior.of({"p4": 0.025, "input_scale": (1.0, 0.01)})
    with pytest.raises(InputError, match="although masses or scales are uncertain"):
        HarmonicBalance(terms=())(replace(sines, known=known))


def test_intervals_hold_what_each_left_out_mass_leaves(sines):
    checked = HarmonicBalance(terms=()).of_points(sines.sines)
    for mass, values in checked.left_out.items():
        kept = [point for point in sines.sines if point.added_mass != mass]
        alone = HarmonicBalance(terms=()).of_points(kept)
        reach = alone.upper - alone.lower
        np.testing.assert_array_less(np.abs(values - alone.values), 0.1 * reach)
        assert np.all((checked.lower <= values) & (values <= checked.upper))


NAMES = ("p1", "p2", "p3", "p4", "coulomb", "load")
VALUES = np.array([0.003, 1e-3, 0.04, 0.5, 8e-4, 1e-4])


def _estimate_of(values, errors, correlation, left_out=(), reach=1.96):
    plain = estimate_of(values, np.outer(errors, errors) * correlation, names=NAMES, reach=reach)
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


@settings(max_examples=15)
@given(seed=st.integers(0, 10_000), size=st.floats(1e-3, 0.8), moved=st.floats(0, 2))
def test_draws_stay_within_bounds_and_make_a_joint_with_every_mass(seed, size, moved):
    rng = np.random.default_rng(seed)
    errors = size * VALUES
    left_out = [VALUES + moved * errors * rng.standard_normal(VALUES.size)]
    found = _estimate_of(VALUES, errors, _correlation(rng, VALUES.size), left_out)
    draws = draw_parameters(found, 50, masses=MASSES, seed=seed)
    assert draws.values.shape == (50, VALUES.size)
    assert np.all(draws.values >= lower_bounds(NAMES))
    for parameters in draws.parameters:
        for mass in MASSES:
            loaded = parameters.with_added_mass(mass)
            assert loaded.p1 > 0
            assert loaded.coulomb >= 0


def test_draws_spread_as_the_intervals_say_however_they_are_wide():
    rng = np.random.default_rng(1)
    correlation = _correlation(rng, VALUES.size)
    errors = 0.02 * VALUES
    plain = _estimate_of(VALUES, errors, correlation)
    scatter = np.cov(draw_parameters(plain, 4_000).values.T)
    np.testing.assert_allclose(scatter / np.outer(errors, errors), correlation, atol=0.08)
    apart = VALUES + errors * np.array([5, 0, -3, 0, 0, 0])
    for found in (
        _estimate_of(VALUES, errors, correlation, reach=3.5),
        _estimate_of(VALUES, errors, correlation, [apart]),
    ):
        spread = draw_parameters(found, 4_000).values.std(axis=0)
        widest = np.maximum(found.upper - VALUES, VALUES - found.lower)
        assert np.all(1.96 * spread > 0.94 * widest)
        assert np.all(1.96 * spread < 1.2 * np.maximum(widest, 2.5 * errors))


def test_a_combination_that_is_well_known_stays_well_known_at_a_bound():
    """Viscous friction on its bound, and a term that takes its place: their sum is known."""
    values, errors = VALUES * np.array([1, 0, 1, 1, 1, 1]), np.full(VALUES.size, 1e-4)
    correlation = np.eye(VALUES.size)
    correlation[0, 1] = correlation[1, 0] = -0.9999
    draws = draw_parameters(_estimate_of(values, errors, correlation), 2000).values
    assert (draws[:, 1] == 0).mean() == pytest.approx(0.5, abs=0.05)
    assert draws[:, :2].sum(axis=1).std() < 0.03 * errors[0]


def test_a_seed_fixes_the_draws():
    found = _estimate_of(VALUES, 0.1 * VALUES, np.eye(VALUES.size))
    one, same, other = (draw_parameters(found, 60, seed=seed).values for seed in (3, 3, 4))
    np.testing.assert_array_equal(one, same)
    assert not np.any(one == other)


def test_what_cannot_be_drawn_is_refused():
    found = _estimate_of(VALUES, 0.1 * VALUES, np.eye(VALUES.size))
    unknown = replace(found, covariance=np.full_like(found.covariance, np.nan))
    with pytest.raises(IdentifiabilityError, match="no covariance"):
        draw_parameters(unknown, 200)
    with pytest.raises(InputError, match="at least 40"):
        draw_parameters(found, 3)
    with pytest.raises(InputError, match="seed"):
        draw_parameters(found, 200, seed=-1)
    light = np.array([-1.0, 0, 0, 0, 0, 0])
    heavy = replace(
        found, values=VALUES + light, lower=found.lower + light, upper=found.upper + light
    )
    with pytest.raises(IdentifiabilityError, match="hardly any"):
        draw_parameters(heavy, 40, masses=MASSES)
