from dataclasses import replace

import numpy as np
import pytest

from butterfly.identification.data import DataSet, read_data_set
from butterfly.identification.estimators import WeakForm
from butterfly.identification.free_run import FitSummary, FreeRun, Setting, Simulations
from butterfly.identification.identify import identify, judged
from butterfly.identification.other_parameters import best_gain, try_parameters
from butterfly.logs.log import Intersample
from butterfly.logs.manifest import read_manifest
from butterfly.model.greybox import simulate
from butterfly.model.linear import resonance_frequency
from butterfly.model.parameters import LumpedParameters
from butterfly.thesis.scripts import fit_thesis
from tests.conftest import ROBOT


def _simulated(template, intersample, parameters=ROBOT, swing=0.1, rest=0.7):
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
    assert FreeRun.of(log, Setting(parameters=ROBOT, zero=0.7)).fit > 99.9


def test_the_fit_is_the_formula_s():
    rng = np.random.default_rng(0)

    class _Log:
        angle = rng.standard_normal(50)

    simulated = _Log.angle + 0.1
    fit = FreeRun(log=_Log, simulated=simulated).fit
    expected = 1 - np.sqrt(50 * 0.01) / np.sqrt(np.sum((_Log.angle - _Log.angle.mean()) ** 2))
    assert fit == pytest.approx(100 * expected)


def test_wrong_parameters_follow_worse_and_a_missing_gain_is_found(sine_log):
    log = _simulated(sine_log, Intersample.ZERO_ORDER_HOLD, swing=0.0)
    data = DataSet.of([log])
    own = try_parameters("own", ROBOT, data)
    blind = try_parameters("no gain", replace(ROBOT, p4=float("nan")), data)
    wrong = try_parameters("heavy", replace(ROBOT, p1=1.1 * ROBOT.p1), data)
    assert blind.gain_fitted
    assert blind.parameters.p4 == pytest.approx(ROBOT.p4, rel=2e-3)
    assert blind.summary.median == pytest.approx(own.summary.median, abs=0.3)
    assert wrong.summary.median < 95 < own.summary.median


def test_the_real_logs_are_followed(real):
    assert real.summary.median >= 92
    assert real.summary.mean >= 92
    assert real.summary.worst >= 75


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
    assert found.estimate.horizon == found.summary.horizon == 3.0
    assert judged(data, estimator).horizon == 3.0
