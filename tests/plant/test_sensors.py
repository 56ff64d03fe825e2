import numpy as np
import pytest

from butterfly.errors import InputError
from butterfly.plant import sensors


def test_the_noise_is_held_white_and_of_the_power_asked_for():
    source = sensors.BandLimitedNoise(power=2e-6, sample_time=0.05, seed=1)
    time = np.arange(400_000) * 0.01
    values = source.sample(time).reshape(-1, 5)
    assert np.all(np.ptp(values, axis=1) == 0)
    samples = values[:, 0]
    assert samples.var() == pytest.approx(2e-6 / 0.05, rel=0.02)
    assert np.corrcoef(samples[1:], samples[:-1])[0, 1] == pytest.approx(0, abs=0.01)
    assert np.mean(np.abs(samples) > 1.96 * samples.std()) == pytest.approx(0.05, abs=0.003)


def test_a_number_does_not_depend_on_how_many_are_drawn():
    source = sensors.BandLimitedNoise(power=1.0, sample_time=1.0, seed=222)
    whole = source.sample(np.arange(1000.0))
    np.testing.assert_array_equal(
        [source.sample(np.array([float(k)]))[0] for k in range(50)], whole[:50]
    )


def test_the_encoder_reads_whole_steps_around_the_true_angle():
    angle, step = np.linspace(-3, 3, 999), 2 * np.pi / 1000
    read = sensors.Encoder(steps=1000).read(angle, angle, np.random.default_rng(0))
    np.testing.assert_allclose(read / step, np.round(read / step), atol=1e-9)
    assert np.abs(read - angle).max() <= step / 2 + 1e-12


@pytest.mark.parametrize(
    "build",
    [
        lambda: sensors.BandLimitedNoise(power=-1, sample_time=1),
        lambda: sensors.BandLimitedNoise(power=1, sample_time=0),
        lambda: sensors.BandLimitedNoise(power=1, sample_time=1, seed=-1),
        lambda: sensors.BandLimitedNoise(power=1, sample_time=1e-9).sample(np.array([1.0])),
        lambda: sensors.Faults(dropped=1.0),
        lambda: sensors.Faults(duplicated=-0.1),
        lambda: sensors.Clock(step=0),
        lambda: sensors.Clock(step=1e-3, jitter=1e-3),
        lambda: sensors.ClockRegime(begin=1.0, step=0.0),
        lambda: sensors.ClockRegime(begin=1.0, step=1e-3, delay=-1e-3),
        lambda: sensors.Clock(regimes=2 * (sensors.ClockRegime(begin=1.0, step=1e-3),)),
        lambda: sensors.Encoder(steps=0),
        lambda: sensors.Encoder(noise=-1),
        lambda: sensors.FilteredDifference(0.0),
        lambda: sensors.FilteredDifference(-1.0),
    ],
)
def test_what_makes_no_sense_is_refused(build):
    with pytest.raises(InputError):
        build()


def test_the_clock_has_the_jitter_it_was_given():
    steps = sensors.Clock(step=1e-3, jitter=2e-4).cycles(50.0, np.random.default_rng(0))
    assert steps.min() > 0
    assert steps.mean() == pytest.approx(1e-3, rel=5e-3)
    assert steps.std() == pytest.approx(2e-4, rel=0.02)


def test_faults_lose_and_repeat_the_share_of_samples_asked_for(sine_log):
    faulty = sensors.Faults(dropped=0.02, duplicated=0.01).apply(sine_log, np.random.default_rng(0))
    repeated = np.sum(np.diff(faulty.time) == 0)
    lost = sine_log.time.size - np.unique(faulty.time).size
    assert lost == pytest.approx(0.02 * sine_log.time.size, rel=0.1)
    assert repeated == pytest.approx(0.01 * sine_log.time.size, rel=0.1)
    assert np.isin(faulty.time, sine_log.time).all()
    assert np.all(np.diff(faulty.time) >= 0)
    assert sensors.Faults().apply(sine_log, np.random.default_rng(0)) is sine_log


def test_the_filtered_difference_lags_a_ramp_by_its_time_constant():
    time = np.cumsum(np.random.default_rng(0).uniform(0.5e-3, 1.5e-3, 4000))
    velocity = sensors.filtered_difference(time, 3.0 * time, lag=0.006)
    assert velocity[0] == 0
    assert velocity[-1] == pytest.approx(3.0)
    after = time[1:] - time[0]
    np.testing.assert_allclose(velocity[1:], 3 * (1 - np.exp(-after / 0.006)), atol=1e-9)


def test_the_filtered_difference_of_a_loop_is_that_of_its_log():
    rng = np.random.default_rng(1)
    time = np.cumsum(rng.uniform(0.5e-3, 1.5e-3, 500))
    angle = rng.standard_normal(500)
    loop = sensors.FilteredDifference(time_constant=0.006)
    found = [loop.update(t, x, 0.0) for t, x in zip(time.tolist(), angle.tolist(), strict=True)]
    np.testing.assert_allclose(
        sensors.filtered_difference(time, angle), found, rtol=1e-12, atol=1e-9
    )
    assert loop.update(time[-1], 5.0, 0.0) == found[-1]  # a clock that stood still
