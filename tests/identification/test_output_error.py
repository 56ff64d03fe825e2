from dataclasses import replace

import numpy as np
import pytest

from butterfly.errors import IdentifiabilityError, InputError
from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.findings import Ending
from butterfly.identification.estimators import HarmonicBalance, Loss, OutputError
from butterfly.identification.free_run import FitSummary
from butterfly.logs.log import InputKind, Intersample, Log, Sine
from butterfly.model.greybox import simulate
from butterfly.model.linear import resonance_frequency
from butterfly.model.parameters import LumpedParameters
from tests.conftest import MASSES

ROBOT = LumpedParameters(
    p1=0.003,
    p2=3e-4,
    p3=0.03,
    p4=0.5,
    coulomb=2e-3,
    delay=0.004,
    drag=1e-4,
    load=5e-4,
    bias=2e-3,
    p3_offset=-1e-3,
    stribeck=5e-4,
)
ZERO = 0.6


def _log(mass, omega, amplitude, noise, seed):
    time = np.arange(0, 20, 2e-3)
    late = np.column_stack([time[:-1], (time[1:] + time[:-1]) / 2, time[1:]]) - ROBOT.delay
    torque = np.where(late > 0, amplitude * np.sin(omega * late), 0.0)
    angle, _ = simulate(ROBOT.with_added_mass(mass), time, torque, 0.05)
    rng = np.random.default_rng(seed)
    return Log(
        time=time,
        input=amplitude * np.sin(omega * time),
        angle=ZERO + angle + noise * rng.standard_normal(time.size),
        input_kind=InputKind.TORQUE,
        intersample=Intersample.FIRST_ORDER_HOLD,
        added_mass=mass,
        excitation=Sine(omega=omega, amplitude=amplitude),
        source=f"{mass.mass:g}-{omega:g}",
    )


@pytest.fixture(scope="module")
def logs():
    drives = ((2.0, 0.014), (4.0, 0.014), (5.5, 0.02), (8.0, 0.08))
    return [_log(mass, *drive, 1e-3, 7) for mass in MASSES for drive in drives]


def _fit(logs, **options):
    data = DataSet.of(logs)
    start = HarmonicBalance().of_points(data.sines).parameters
    return OutputError(**options).of_logs(data.logs, start, data.equilibria)


def test_every_term_is_recovered_within_its_interval(logs):
    estimate = _fit(logs)
    truth = np.array([getattr(ROBOT, name) for name in estimate.names])
    rounding = 1e-4 * np.abs(truth)
    assert np.all((estimate.lower - rounding <= truth) & (truth <= estimate.upper + rounding))
    np.testing.assert_allclose(estimate.values, truth, rtol=0.01)
    assert estimate.local[None]["zero"] == pytest.approx(ZERO, abs=1e-4)
    assert estimate.ending is Ending.CONVERGED


def test_one_core_or_several_give_the_same_to_the_bit(logs):
    one, two = (_fit(logs[:8], workers=workers).values for workers in (1, 2))
    np.testing.assert_array_equal(one, two)


def test_sign_unit_and_start_of_the_clock_and_order_of_logs_change_nothing_else(logs):
    part = [logs[k] for k in (0, 1, 2, 3, 8, 9, 10, 11)]
    moved = [replace(log, time=log.time + 100.0, input=-8.0 * log.input) for log in reversed(part)]
    before = _fit(part, terms=("drag",))
    after = _fit(moved, terms=("drag",))
    expected = before.values.copy()
    expected[3] /= -8
    small = np.maximum(before.standard_errors, 1e-12)
    small[3] /= 8
    np.testing.assert_allclose((after.values - expected) / small, 0, atol=0.1)


def test_a_third_of_the_sampling_rate_gives_the_same(logs):
    coarse = [log.take(np.arange(0, log.time.size, 3)) for log in logs]
    fine, thinned = (_fit(each, check=False) for each in (logs, coarse))
    shift = np.abs(thinned.values - fine.values)
    assert np.all(shift < 5 * np.hypot(fine.standard_errors, thinned.standard_errors))
    np.testing.assert_allclose(thinned.values, fine.values, rtol=0.02)


def test_what_differs_from_log_to_log_can_be_fitted(logs):
    turned = [replace(log, angle=log.angle + 0.01 * k, name=f"{k}") for k, log in enumerate(logs)]
    estimate = _fit(turned, per_log=("zero",), terms=("drag", "load", "stribeck", "bias"))
    zeros = [estimate.local[f"{k}"]["zero"] for k in range(len(turned))]
    assert np.median(np.diff(zeros)) == pytest.approx(0.01, abs=1e-4)
    assert np.median(DataSet.of(turned).simulations.fits(estimate)) > 99


def test_a_robust_loss_is_not_misled_by_a_log_that_jumps(logs):
    angle = logs[1].angle.copy()
    angle[6000:6600] += 0.5
    spoilt = [logs[0], replace(logs[1], angle=angle), *logs[2:]]
    plain, robust = (
        _fit(spoilt, loss=loss, check=False).parameters for loss in (Loss.LINEAR, Loss.CAUCHY)
    )
    robust_error, plain_error = (abs(p.coulomb / ROBOT.coulomb - 1) for p in (robust, plain))
    assert robust_error < 2e-3
    assert plain_error > 5 * robust_error


def test_one_added_mass_is_refused(logs):
    data = DataSet.of(logs[:4])
    with pytest.raises(IdentifiabilityError, match="common factor"):
        OutputError().of_logs(data.logs, ROBOT, data.equilibria)


def test_an_unknown_term_is_named():
    with pytest.raises(InputError, match="did you mean"):
        OutputError(terms=("drug",))


@pytest.fixture(scope="module")
def fitted(real):
    data = real.data
    start = real.estimate.parameters
    return OutputError().of_logs(data.logs, start, data.equilibria)


def test_the_real_logs_are_followed_closely(real, fitted):
    summary = FitSummary.of(real.data.simulations.fits(fitted))
    assert summary.median >= 96.9
    assert summary.mean >= 95.6
    assert summary.worst >= 87


def test_viscous_and_coulomb_friction_alone_follow_them_less(real):
    data, options = real.data, OutputError(terms=(), per_mass=("zero",), check=False)
    start = HarmonicBalance(terms=(), check=False)(data).parameters
    fits = data.simulations.fits(options.of_logs(data.logs, start, data.equilibria))
    assert 95 <= np.median(fits) < 96.5


def test_the_real_robot_s_values_are_in_the_known_ranges(fitted):
    p = fitted.parameters
    assert 0.00205 <= p.p1 <= 0.00217
    assert p.p2 < 6e-4
    assert abs(p.p3) < 0.003
    assert 2.40 <= p.p4 <= 2.50
    assert 0.0044 <= p.level(0.0) <= 0.0053
    assert 0.002 <= p.delay <= 0.004
    found = [resonance_frequency(p.with_added_mass(mass)) for mass in fitted.left_out]
    np.testing.assert_allclose(found, [4.50, 6.02, 6.46], rtol=0.01)
    for values in fitted.left_out.values():
        assert np.all((fitted.lower <= values) & (values <= fitted.upper))
