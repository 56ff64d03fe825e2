"""Bands hold what they promise, and are what a closed form says where there is one."""

from dataclasses import replace

import numpy as np
import pytest

from butterfly.identification import predict
from butterfly.identification.data import DataSet
from butterfly.identification.estimators import HarmonicBalance, OutputError
from butterfly.identification.free_run import FreeRun, Setting
from butterfly.identification.simulation import Simulation
from butterfly.model.parameters import AddedMass
from tests.identification.simulated import ROBOT, noisy, simulated, steady

NOISE = 2e-3  # rad
RELATIVE_NOISE = 0.02
SWINGS = {2.0: 0.2, 4.4: 0.3, 8.5: 0.5}


@pytest.fixture(scope="module")
def clean():
    return steady(ROBOT, SWINGS)


def _noisy(logs, seed, noise=NOISE):
    return DataSet.of(noisy(logs, noise, np.random.default_rng(seed)))


@pytest.fixture(scope="module")
def data(clean):
    return _noisy(clean, 0)


@pytest.fixture(scope="module")
def found(data):
    """An estimate that was checked by leaving each mass out."""
    return HarmonicBalance(terms=())(data)


def _predicted(data, found, draws, errors=()):
    return predict.predict_logs(
        data.logs, found, data.simulations.setting, draws=draws, errors=errors
    )


@pytest.mark.slow
def test_the_band_of_the_parameters_is_the_closed_form_s_where_the_model_is_linear():
    """For small errors: 1.96 times the root of the diagonal of J Cov J^T."""
    data = _noisy(steady(ROBOT, SWINGS, duration=40.0), 0)
    found = HarmonicBalance(terms=())(data)
    reach = 0.196 * found.standard_errors
    found = replace(found, lower=found.values - reach, upper=found.values + reach)
    found = replace(found, covariance=1e-2 * found.covariance, left_out={}, freedom=None)
    (prediction,) = _predicted(data.take([4]), found, predict.draw_parameters(found, 4000))
    log, samples = data.logs[4], prediction.samples
    setting = Setting(parameters=found.parameters, zero=data.equilibria[log.added_mass])
    trajectory = Simulation(log, found.parameters)
    rows = []
    for name, error in zip(found.names, found.standard_errors, strict=True):
        ends = [
            trajectory.run(
                replace(found.parameters, **{name: getattr(found.parameters, name) + step}),
                setting.zero,
            ).at(log.time)
            for step in (-1e-2 * error, 1e-2 * error)
        ]
        rows.append((ends[1] - ends[0])[samples] / (2e-2 * error))
    jacobian = np.array(rows).T
    expected = 1.96 * np.sqrt(np.sum(jacobian @ found.covariance * jacobian, axis=1))
    band = prediction.bands[predict.OF_PARAMETERS]
    moving = expected > 0.2 * expected.max()
    ratio = (band.upper - band.lower)[moving] / (2 * expected[moving])
    assert np.median(ratio) == pytest.approx(1, abs=0.03)
    assert np.all(np.abs(ratio - 1) < 0.12)


def _noisy_by_its_motion(logs, seed):
    """Slow errors in proportion to each log's motion, and a first sample without any."""
    rng, slow = np.random.default_rng(seed), np.hanning(40)
    found = []
    for log in logs:
        noise = np.convolve(rng.standard_normal(log.angle.size), slow, "same")
        noise *= RELATIVE_NOISE * np.std(log.angle) / np.std(noise)
        noise[0] = 0.0
        found.append(replace(log, angle=log.angle + noise))
    return DataSet.of(found)


@pytest.mark.slow
def test_bands_hold_what_they_promise_of_a_new_mass_and_frequency(clean):
    """Of a known robot: its motion lies in the one band, a noisy log of it in the other."""
    truth, recorded, widths = [], [], []
    for seed in range(6):
        data = _noisy_by_its_motion(clean, seed)
        found = HarmonicBalance(terms=())(data)
        draws = predict.draw_parameters(found, 100, seed=seed)
        mass = AddedMass(mass=0.08, arm=0.104)
        new = simulated(ROBOT, mass, lambda t: 0.03 * np.sin(3.3 * t), 40.0)
        (prediction,) = predict.predict_logs(
            _noisy_by_its_motion([new], 100 + seed).logs,
            found,
            lambda _, estimate: Setting(parameters=estimate.parameters, zero=0.0),
            draws=draws,
            errors=predict.expected_errors(data, found),
        )
        truth.append(prediction.bands[predict.OF_PARAMETERS].share(new.angle[prediction.samples]))
        recorded.append(prediction.bands[predict.OF_NEW_LOG].share(prediction.measured))
        widths.append(prediction.bands[predict.OF_NEW_LOG].width / np.std(new.angle))
    assert np.mean(truth) > 0.85
    assert 0.93 <= np.mean(recorded) <= 1
    assert np.mean(widths) < 1.5 * 2 * 1.96 * RELATIVE_NOISE


def test_the_band_of_a_new_log_is_no_wider_than_it_has_to_be(clean):
    """Of logs whose errors are those of the estimate's: half of it would hold clearly less."""
    data = _noisy_by_its_motion(clean, 0)
    found = HarmonicBalance(terms=())(data)
    draws, errors = predict.draw_parameters(found, 100), predict.expected_errors(data, found)
    again = _noisy_by_its_motion(clean, 1)
    whole, half = [], []
    for each in _predicted(again.take([0, 4, 8]), found, draws, errors):
        band = each.bands[predict.OF_NEW_LOG]
        middle, reach = (band.upper + band.lower) / 2, (band.upper - band.lower) / 4
        whole.append(band.share(each.measured))
        half.append(predict.Band(lower=middle - reach, upper=middle + reach).share(each.measured))
    assert 0.9 < np.mean(whole) < 0.99
    assert np.mean(half) < 0.8


def test_a_band_of_forty_draws_goes_from_the_second_to_the_last_but_one(data, found):
    few, drawn = data.take([0]), predict.draw_parameters(found, 40)
    (prediction,) = _predicted(few, found, drawn)
    settings = (few.simulations.setting(0, each) for each in drawn.estimates())
    runs = [FreeRun.of(few.logs[0], each).simulated for each in settings]
    ranked = np.sort(np.array(runs)[:, prediction.samples], axis=0)
    band = prediction.bands[predict.OF_PARAMETERS]
    np.testing.assert_allclose((band.lower, band.upper), ranked[[1, 38]], atol=1e-9)
    run = FreeRun.of(few.logs[0], few.simulations.setting(0, found))
    np.testing.assert_allclose(prediction.run.simulated, run.simulated, atol=1e-3)
    assert band.share(prediction.run.simulated[prediction.samples]) > 0.95


def test_seeds_fix_bands_and_only_their_own_part(data, found):
    draws, errors = predict.draw_parameters(found, 40, seed=1), predict.expected_errors(data, found)
    assert draws.seed == 1
    one, same, other = (
        _predicted(data.take([0]), found, replace(draws, seed=seed), errors)[0].bands
        for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(one[predict.OF_NEW_LOG].upper, same[predict.OF_NEW_LOG].upper)
    np.testing.assert_array_equal(
        one[predict.OF_PARAMETERS].upper, other[predict.OF_PARAMETERS].upper
    )
    assert not np.array_equal(one[predict.OF_NEW_LOG].upper, other[predict.OF_NEW_LOG].upper)
    (plain,) = _predicted(data.take([0]), found, None)
    assert plain.bands == {}
    assert plain.run.fit > 95


def test_errors_are_those_of_logs_that_the_estimate_has_not_seen(data, found):
    errors = predict.expected_errors(data, found)
    assert all(each.held_out for each in errors)
    mass = data.logs[0].added_mass
    unseen = replace(found, values=found.left_out[mass])
    np.testing.assert_allclose(errors[0].relative, _relative(data, unseen), atol=1e-12)
    others = predict.donors(errors, mass)
    assert {each.log.added_mass for each in others} == {*data.masses} - {mass}
    assert predict.donors(others[:1], others[0].log.added_mass) == others[:1]
    # Those in the sample stand for those unseen, but larger.
    first, *_ = predict.expected_errors(data, replace(found, left_out={}))
    assert not first.held_out
    expected = np.sqrt(4 / 3) * _relative(data, found)
    np.testing.assert_allclose(first.relative, expected, atol=1e-12)


def _relative(data, estimate):
    """Errors of the first log over its motion."""
    run = data.simulations.run(0, estimate)
    return (run.log.angle - run.simulated) / np.std(run.log.angle)


def test_drawn_errors_keep_the_level_of_their_log_and_are_as_slow_and_as_loud(data, found):
    first, *_ = predict.expected_errors(data, found)
    slow = replace(first, relative=np.sin(2.0 * first.log.time))
    drawn = slow.drawn(np.arange(0, 300, 0.02), np.random.default_rng(0))
    assert np.std(drawn) == pytest.approx(np.sqrt(0.5), rel=0.1)
    assert np.mean(np.abs(np.diff(drawn)) > 0.05) < 0.02  # but where blocks meet
    noise = np.random.default_rng(0).standard_normal(first.log.time.size)
    loud = replace(first, relative=noise)
    drawn = loud.drawn(np.arange(0, 300, 0.0131), np.random.default_rng(1))
    assert np.std(drawn) == pytest.approx(1.0, rel=0.03)


def test_the_model_s_part_of_an_error_follows_the_swing_and_the_sensor_s_noise_stays(data, found):
    first, *_ = predict.expected_errors(data, found)
    own, size = first.log.rms_measured, np.sqrt(np.mean(first.relative**2))
    assert 0 < first.noise <= own * size
    assert first.scale(own) == pytest.approx(own)
    assert first.scale(0.0) * size == pytest.approx(first.noise)
    assert replace(first, noise=0.0).scale(3 * own) == pytest.approx(3 * own)
    large = (own * size) ** 2 - first.noise**2
    assert (first.scale(3 * own) * size) ** 2 == pytest.approx(9 * large + first.noise**2)


def test_a_small_swing_among_large_ones_lies_in_its_band(clean):
    """White noise alone: a band in proportion to the swing would hold 77 % of it."""
    data = _noisy(clean, 0)
    least = min(data.logs, key=lambda log: log.rms_measured)
    found = HarmonicBalance(terms=())(data)
    errors = max(predict.expected_errors(data, found), key=lambda each: each.log.rms_measured)
    (prediction,) = _predicted(
        data.take([data.logs.index(least)]), found, predict.draw_parameters(found, 100), [errors]
    )
    assert prediction.bands[predict.OF_NEW_LOG].share(prediction.measured) > 0.9


EVERY_TERM = ("drag", "load", "bias", "p3_offset", "stribeck")


@pytest.mark.slow
@pytest.mark.parametrize("estimator", [HarmonicBalance(terms=()), OutputError(terms=EVERY_TERM)])
def test_left_out_masses_of_the_real_robot_lie_in_the_band_of_a_new_log(real, estimator):
    """With an estimate from the other two masses only, where none could be checked.

    All of 13 logs may lie inside a band of 95 % by chance; inside half a right band they do not.
    """
    data = real.data
    for mass in data.masses[2 if estimator.method == "output-error" else 0 :]:
        own, rest = (
            data.take([k for k, log in enumerate(data.logs) if (log.added_mass == mass) == inside])
            for inside in (True, False)
        )
        found = estimator(rest)
        draws = predict.draw_parameters(found, 60, masses=data.masses)
        predictions = _predicted(own, found, draws, predict.expected_errors(rest, found))
        bands = [each.bands[predict.OF_NEW_LOG] for each in predictions]
        narrow = [
            predict.Band(lower=(3 * b.lower + b.upper) / 4, upper=(b.lower + 3 * b.upper) / 4)
            for b in bands
        ]
        assert np.mean(_shares(bands, predictions)) >= 0.85
        assert np.mean(_shares(narrow, predictions)) <= 0.85


def _shares(bands, predictions):
    """Return the share of each measured log that lies inside a band."""
    return [band.share(each.measured) for band, each in zip(bands, predictions, strict=True)]
