"""Standard errors against spreads, and what estimators say of their own checks."""

from dataclasses import replace

import numpy as np
import pytest

from butterfly.errors import InputError
from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.findings import FindingKind
from butterfly.identification.estimators import HarmonicBalance, Loss, OutputError, WeakForm
from butterfly.identification.estimators.multistart import Start
from butterfly.identification.estimators.weak_regression import WeakFit, Windows
from butterfly.identification.test_functions import HALF_WIDTH, Averaging
from butterfly.model.prior import NO_PRIOR, SCALES, Prior
from butterfly.model.terms import PARAMETERS, FrictionTerms
from tests.conftest import MASSES
from tests.identification.simulated import ROBOT, SWINGS, noisy, steady, wild

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
    windows = [Windows(log.added_mass, own) for log, own in zip(logs, averages, strict=True)]
    values = WeakFit.of(windows, PARAMETERS, FrictionTerms.stribeck_velocity, NO_PRIOR).values
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
    for loss in (Loss.CAUCHY, Loss.LINEAR):
        p4, error = fit(spoilt, loss)
        assert abs(p4 - ROBOT.p4) < 4 * error
        assert clean < error < 3 * clean


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
    if scale == "time_scale":
        sine = replace(sine, omega=sine.omega * (1 + share))
        return replace(log, time=log.time / (1 + share), excitation=sine)
    column = scale.removesuffix("_scale")
    return replace(log, **{column: getattr(log, column) / (1 + share)})


@pytest.mark.parametrize("scale", sorted(SCALES))
def test_the_uncertainty_of_a_scale_widens_errors_by_what_it_would_move(sines, plain, scale):
    share, estimator = 2e-4, HarmonicBalance(terms=())
    told = replace(sines, known=Prior.of({scale: (1.0, share)}))
    wide = estimator(told)
    off = estimator(DataSet.of([_rescaled(log, scale, share) for log in sines.logs]))
    added = np.sqrt(np.diag(wide.covariance) - np.diag(plain.covariance))
    moved = np.abs(off.values - plain.values)
    for name in ("p1", "p2", "p3", "p4"):
        k = plain.names.index(name)
        size = share * abs(plain.values[k])
        assert added[k] == pytest.approx(moved[k], abs=0.1 * moved[k] + 0.15 * size), name


def test_a_scale_is_not_uncertain_beside_an_exact_value(sines):
    known = Prior.of({"p4": 0.025, "input_scale": (1.0, 0.01)})
    with pytest.raises(InputError, match="although masses or scales are uncertain"):
        HarmonicBalance(terms=())(replace(sines, known=known))


def _kinds(found):
    return {each.kind for each in found.findings} & {FindingKind.FEW_MASSES}


def test_two_masses_are_said_to_be_too_few_to_leave_one_out(sines):
    fewer = sines.take([k for k, log in enumerate(sines.logs) if log.added_mass != MASSES[1]])
    assert _kinds(HarmonicBalance()(sines)) == set()
    found = HarmonicBalance()(fewer)
    assert _kinds(found) == {FindingKind.FEW_MASSES}
    (few,) = [each for each in found.findings if each.kind == "few-masses"]
    assert few.number == 2


def test_intervals_hold_what_each_left_out_mass_leaves(sines):
    checked = HarmonicBalance(terms=()).of_points(sines.sines)
    for mass, values in checked.left_out.items():
        kept = [point for point in sines.sines if point.added_mass != mass]
        alone = HarmonicBalance(terms=()).of_points(kept)
        reach = alone.upper - alone.lower
        np.testing.assert_array_less(np.abs(values - alone.values), 0.1 * reach)
        assert np.all((checked.lower <= values) & (values <= checked.upper))
