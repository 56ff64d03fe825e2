"""Residual torque, input kind, resampling and experiment design."""

from dataclasses import replace

import numpy as np
import pytest

from butterfly.errors import IdentifiabilityError, InputError
from butterfly.identify.data import DataSet
from butterfly.identify.design import rank_experiments
from butterfly.identify.estimators import HarmonicBalance, OutputError, Thesis
from butterfly.identify.findings import FindingKind
from butterfly.identify.input_kind import judge_input
from butterfly.identify.resampling import bootstrap, profile
from butterfly.identify.residual import residual_torque
from butterfly.logs.log import InputKind, Intersample, Log, Sine
from butterfly.model.greybox import simulate
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass, LumpedParameters
from butterfly.report.words import sentences
from tests.conftest import MASSES

ROBOT = LumpedParameters(p1=0.003, p2=0.0, p3=0.05, p4=0.5)


def _log(robot, mass=MASSES[1], omega=4.0, noise=0.0, seed=0):
    amplitude = 0.02
    time = np.arange(0, 20, 1e-3)
    instants = np.column_stack([time[:-1], time[:-1] + 5e-4, time[1:]])
    angle, _ = simulate(
        robot.with_added_mass(mass), time, amplitude * np.sin(omega * instants), 0.2
    )
    angle += noise * np.random.default_rng(seed).standard_normal(time.size)
    return Log(
        time=time,
        input=amplitude * np.sin(omega * time),
        angle=angle,
        input_kind=InputKind.TORQUE,
        intersample=Intersample.FIRST_ORDER_HOLD,
        added_mass=mass,
        excitation=Sine(omega=omega, amplitude=amplitude),
        source=f"{mass}-{omega}-{seed}",
    )


@pytest.mark.parametrize(
    ("term", "value", "name"),
    [
        ("coulomb", 2e-3, "Coulomb friction"),
        ("p2", 1e-3, "viscous friction"),
        ("drag", 1e-3, "quadratic drag"),
    ],
)
def test_the_residual_torque_is_recognised_and_of_the_right_size(term, value, name):
    log = _log(replace(ROBOT, **{term: value}), noise=1e-4)
    residual = residual_torque(log, ROBOT, 0.0)
    assert residual.looks_like.startswith(name)
    v = residual.velocity
    expected = {"coulomb": np.sign(v), "p2": v, "drag": np.abs(v) * v}[term] * -value
    moving = np.abs(v) > 0.3 * np.std(v)
    error = residual.torque[moving] - expected[moving]
    assert np.sqrt(np.mean(error**2)) < 0.2 * np.sqrt(np.mean(expected[moving] ** 2))


def test_the_real_robot_s_residual_torque_looks_like_coulomb_friction(real):
    data, parameters = real.data, real.estimate.parameters
    names = [
        residual_torque(log, parameters, data.equilibria[log.added_mass]).looks_like
        for log in data.logs[::4]
    ]
    assert sum(name.startswith("Coulomb") for name in names) >= 8


def test_a_current_controlled_drive_called_a_voltage_is_noticed(real):
    said = judge_input(real.estimate, InputKind.VOLTAGE)
    assert len(said) == 1
    assert said[0].kind is FindingKind.TORQUE_DRIVEN
    assert "resistance below" in sentences(real.estimate.with_findings(*said))[-1]
    assert judge_input(real.estimate, InputKind.TORQUE) == []
    motor = replace(
        real.estimate,
        values=np.array([0.00325, 0.00145, 0.049, 0.025, 3e-4, 0.0]),
        upper=np.array([0.0033, 0.0015, 0.05, 0.026, 4e-4, 1e-3]),
    )
    assert judge_input(motor, InputKind.VOLTAGE) == []


def test_the_bootstrap_agrees_with_the_sandwich(real):
    drawn = bootstrap(
        real.data, lambda d: HarmonicBalance().of_points(d.sines), repetitions=100, seed=1
    )
    spread = np.std(drawn.values, axis=0)
    np.testing.assert_allclose(spread / real.estimate.standard_errors, 1.0, atol=0.35)
    assert np.all(drawn.lower < real.estimate.values)
    assert np.all(real.estimate.values < drawn.upper)
    again = bootstrap(
        real.data, lambda d: HarmonicBalance().of_points(d.sines), repetitions=20, seed=1
    )
    np.testing.assert_array_equal(again.values, drawn.values[:20])
    with pytest.raises(InputError, match="at least 20"):
        bootstrap(real.data, lambda d: HarmonicBalance().of_points(d.sines), repetitions=3)


def test_a_profile_is_lowest_at_the_estimate_and_its_interval_is_finite():
    robot = replace(ROBOT, coulomb=1e-3, p2=5e-4, delay=0.003)
    logs = [
        _log(robot, mass, omega, 3e-3, k)
        for k, (mass, omega) in enumerate((m, w) for m in MASSES for w in (2.5, 4.5, 7.0))
    ]
    data, options = DataSet.of(logs), OutputError(terms=(), check=False)
    start = HarmonicBalance().of_points(data.sines).parameters
    found = options.of_logs(data.logs, start, data.equilibria)
    best = found.parameters.p1
    values = best * np.linspace(0.98, 1.02, 9)
    curve = profile(data, found, "p1", values, options)
    assert int(np.argmin(curve.costs)) == 4
    assert curve.costs[4] == pytest.approx(1.0, abs=1e-3)
    lower, upper = curve.interval
    assert values[0] < lower < best < upper < values[-1]
    with pytest.raises(InputError, match="name"):
        profile(data, found, "drag", values, options)


def test_the_best_candidate_brings_what_was_promised():
    """An estimate after the run that was ranked first is more certain than after the last."""
    robot = replace(ROBOT, coulomb=1e-3, p2=5e-4, delay=0.003)
    near = [(m, w) for m in MASSES for w in (4.0, 4.6, 6.5)]
    logs = [_log(robot, m, w, 5e-3, k) for k, (m, w) in enumerate(near)]
    found = HarmonicBalance()(DataSet.of(logs))
    ranked = rank_experiments(found, [NO_ADDED_MASS, AddedMass(mass=0.2, arm=0.104)], 0.02)
    good = [candidate for candidate in ranked if not candidate.warning]
    assert [c.score for c in good] == sorted(c.score for c in good)
    assert all(np.all(c.errors <= 1 + 1e-9) for c in ranked)
    assert good[0].score < 0.9 * good[-1].score
    assert all(c.swing <= 1.0 for c in good)
    assert any(c.warning for c in ranked)


def test_an_estimate_without_covariance_cannot_be_improved_on(real):
    thesis = Thesis()(real.data)
    with pytest.raises(IdentifiabilityError, match="no covariance"):
        rank_experiments(thesis, real.data.masses, 0.1)
