"""Free runs and their FIT, from logs whose parameters and start are known."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest

from butterfly.identification.data import DataSet, read_data_set
from butterfly.identification.estimators import OutputError, WeakForm
from butterfly.identification.free_run import FitSummary, FreeRun, Setting, Simulations
from butterfly.identification.identify import identify, judged
from butterfly.identification.parameters_by_hand import best_gain, try_parameters
from butterfly.identification.simulation import Simulation
from butterfly.logs.log import InputKind, Intersample, Log
from butterfly.logs.manifest import read_manifest
from butterfly.model.greybox import simulate
from butterfly.model.linear import resonance_frequency
from butterfly.model.parameters import LumpedParameters
from butterfly.thesis.method import fit_thesis
from tests.conftest import MASSES
from tests.conftest import ROBOT as BUTTERFLY
from tests.identification.simulated import ROBOT
from tests.independent.integrator import Joint, motion

SPEED = 2.5
ZERO = 0.2


def _thrown(mass, seed):
    """A free decay that begins in motion."""
    time = np.arange(0, 5, 2.5e-3)
    inputs = 0.02 * np.sin((3 + seed) * np.column_stack([time[:-1], time[:-1], time[:-1]]))
    angle, _ = simulate(ROBOT.with_added_mass(mass), time, inputs, 0.1, SPEED)
    return Log(
        time=time,
        input=np.append(inputs[:, 0], 0.0),
        angle=angle + ZERO,
        input_kind=InputKind.TORQUE,
        intersample=Intersample.ZERO_ORDER_HOLD,
        added_mass=mass,
        name=f"throw {seed}",
    )


@pytest.fixture(scope="module")
def data():
    return DataSet.of([_thrown(mass, k) for k, mass in enumerate(MASSES)])


def test_fit_is_the_published_percentage_and_does_not_mind_where_zero_is(data):
    log = data.logs[0]
    angle = log.angle
    run = FreeRun(log=log, simulated=angle + 0.1 * np.cos(log.time))
    error = np.sqrt(np.sum((run.simulated - angle) ** 2))
    expected = 100 * (1 - error / np.sqrt(np.sum((angle - np.mean(angle)) ** 2)))
    assert run.fit == pytest.approx(expected)
    moved = FreeRun(log=replace(log, angle=angle + 5.0), simulated=run.simulated + 5.0)
    assert moved.fit == pytest.approx(run.fit, abs=1e-9)
    assert run.rms == pytest.approx(error / angle.size**0.5)
    mean = FreeRun(log=log, simulated=np.full(angle.size, angle.mean()))
    assert mean.fit == pytest.approx(0.0, abs=1e-9)


def test_a_summary_is_median_mean_and_worst():
    assert FitSummary.of(np.array([90.0, 50.0, 97.0])) == FitSummary(90.0, 79.0, 50.0)


def test_a_run_begins_with_the_velocity_it_is_told(data):
    told = Setting(parameters=ROBOT, zero=ZERO, velocity=SPEED)
    assert FreeRun.of(data.logs[1], told).fit > 99.9
    assert FreeRun.of(data.logs[1], replace(told, velocity=0.0)).fit < 80
    assert data.simulations.run_with(1, told).fit > 99.9


def test_the_velocity_and_zero_found_for_each_log_are_used_to_predict_it(data):
    start = replace(ROBOT, p1=0.0031, p4=0.48)
    estimator = OutputError(terms=(), per_log=("velocity",), check=False, workers=1)
    found = estimator.of_logs(data.logs, start, dict.fromkeys(MASSES, ZERO))
    speeds = [found.local[log.name]["velocity"] for log in data.logs]
    assert speeds == pytest.approx([SPEED] * 3, rel=2e-3)
    assert found.local[None]["zero"] == pytest.approx(ZERO, abs=1e-3)
    assert data.simulations.fits(found).min() > 99.5


def test_a_drive_whose_gain_falls_is_differentiated_by_that_too(data):
    log, drive = data.logs[1], replace(ROBOT, compression=0.4)
    trajectory, step = Simulation(log, drive), 1e-5
    _, rows, mixture = trajectory.linearised(["compression", "p4"], drive, ZERO, SPEED)
    for k, name in enumerate(("compression", "p4")):
        there, back = (
            trajectory.linearised(
                [], replace(drive, **{name: getattr(drive, name) + by}), ZERO, SPEED
            )[0]
            for by in (step, -step)
        )
        found, expected = (rows @ mixture)[:, k], (there - back) / (2 * step)
        np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())


def test_noise_of_a_law_is_simulated_sample_by_sample():
    """Where the joint turns back, each sample counts: their mean over a step was 0.6 mrad off."""
    joint = Joint(inertia=0.2, viscous=0.02, gravity=0.5, gain=1.0, coulomb=0.4, delay=5e-3)
    same = LumpedParameters(p1=0.2, p2=0.02, p3=0.5, p4=1.0, coulomb=0.4, delay=5e-3)
    time = np.arange(0, 6, 2e-3)
    inputs = np.sin(2 * time) + 0.1 * np.random.default_rng(1).standard_normal(time.size)
    angle, _ = motion(joint, time, inputs)
    run = Simulation(Log(time=time, input=inputs, angle=angle), same)
    assert run.step <= time[1] / 2
    np.testing.assert_allclose(run.at_stamps(same, 0.0), angle, atol=1e-6)


def test_a_fit_that_was_asked_for_is_simulated_once_and_held_out_logs_too(data, monkeypatch):
    estimator = OutputError(terms=(), fixed=("p1",), per_log=("velocity",), check=False, workers=1)
    found = estimator.of_logs(data.logs, ROBOT, dict.fromkeys(MASSES, ZERO))
    runs, run = [], Simulation.run
    monkeypatch.setattr(Simulation, "run", lambda *each: runs.append(1) or run(*each))
    fresh = data.take(range(len(data.logs)))
    fits = fresh.simulations.fits(found)
    np.testing.assert_array_equal(fresh.simulations.fits(found), fits)
    assert len(runs) == len(data.logs)
    assert pickle.loads(pickle.dumps(fresh)).simulations.fits(found).tolist() == fits.tolist()  # noqa: S301 - our own


def test_logs_that_are_held_out_are_simulated_once(data, monkeypatch):
    apart = data.holding([0])
    runs, run = [], Simulation.run

    def counted(self, *rest):
        runs.append(self.log.name)
        return run(self, *rest)

    monkeypatch.setattr(Simulation, "run", counted)
    found = identify(apart, WeakForm(terms=(), check=False))
    assert runs.count(apart.test_logs.logs[0].name) == 1
    assert list(found.held_out) == [apart.test_logs.logs[0].name]


def _simulated(template, intersample, parameters=BUTTERFLY, swing=0.1, rest=0.7):
    """A log of the grey-box robot, its delayed input integrated on a ten times finer grid."""
    fine = np.arange(0, 40, 1e-4)
    step = 1e-3
    late = fine - parameters.delay
    held = (
        step * np.floor(late / step + 1e-9) if intersample is Intersample.ZERO_ORDER_HOLD else late
    )
    signal = np.where(late >= 0, 0.2 * np.sin(5 * held), 0.0)
    inputs = np.repeat(signal[:-1, None], 3, axis=1)
    loaded = parameters.with_added_mass(template.added_mass)
    angle, _ = simulate(loaded, fine, inputs, swing)
    time = fine[::10]
    return replace(
        template,
        time=time,
        input=0.2 * np.sin(5 * time),
        angle=rest + angle[::10],
        velocity=None,
        intersample=intersample,
    )


@pytest.mark.parametrize("intersample", list(Intersample))
def test_a_simulated_log_is_followed_with_its_own_parameters(sine_log, intersample):
    log = _simulated(sine_log, intersample)
    assert FreeRun.of(log, Setting(parameters=BUTTERFLY, zero=0.7)).fit > 99.9


def test_wrong_parameters_follow_worse_and_a_missing_gain_is_found(sine_log):
    log = _simulated(sine_log, Intersample.ZERO_ORDER_HOLD, swing=0.0)
    data = DataSet.of([log])
    own = try_parameters("own", BUTTERFLY, data)
    blind = try_parameters("no gain", replace(BUTTERFLY, p4=float("nan")), data)
    wrong = try_parameters("heavy", replace(BUTTERFLY, p1=1.1 * BUTTERFLY.p1), data)
    assert blind.gain_fitted
    assert blind.parameters.p4 == pytest.approx(BUTTERFLY.p4, rel=2e-3)
    assert blind.summary.median == pytest.approx(own.summary.median, abs=0.3)
    assert wrong.summary.median < 95 < own.summary.median


def test_the_real_logs_are_followed(real):
    assert real.fit.median >= 92
    assert real.fit.mean >= 92
    assert real.fit.worst >= 75


def test_the_real_robot_s_linearised_resonances_are_the_known_ones(real):
    parameters = real.estimate.parameters
    found = [resonance_frequency(parameters.with_added_mass(mass)) for mass in real.data.equilibria]
    np.testing.assert_allclose(found, [4.50, 6.02, 6.46], rtol=0.012)


def test_table_5_follows_the_same_logs_far_worse(real):
    """With its best p4, as it is found on fewer logs."""
    table_5 = LumpedParameters(p1=0.0028, p2=0.0188, p3=0.0583, p4=3.625)
    other = try_parameters("Table 5", table_5, real.data)
    known = FitSummary(median=37.4, mean=35.4, worst=2.8)
    assert other.summary.median == pytest.approx(known.median, abs=1.0)
    assert other.summary.mean == pytest.approx(known.mean, abs=1.0)
    assert other.summary.worst == pytest.approx(known.worst, abs=1.0)
    few = real.data.take(range(0, 41, 6))
    assert best_gain(table_5, few) == pytest.approx(table_5.p4, rel=0.15)


@pytest.mark.parametrize(
    ("decimation", "published"), [(25, "4.1915 5.7650 6.2847"), (5, "4.1889 5.7606 6.2810")]
)
def test_thesis_mode_prints_the_published_resonances(real, decimation, published):
    estimate = fit_thesis(real.data.recorded, decimation)
    assert " ".join(f"{omega:.4f}" for omega in estimate.resonances.values()) == published
    assert "p2" in estimate.on_bound
    assert np.isnan(estimate.standard_errors).all()


def test_an_identification_is_judged_over_the_horizon_that_its_logs_are_simulated_over(
    quick_data, monkeypatch
):
    monkeypatch.setattr(Simulations, "horizon", lambda self, estimate: 3.0)  # noqa: ARG005 - a method
    data, estimator = read_data_set(read_manifest(quick_data / "manifest.yaml")), WeakForm()
    found = identify(data, estimator)
    assert found.estimate.horizon == found.fit.horizon == 3.0
    assert judged(data, estimator).horizon == 3.0
