"""Input kind, resampling and experiment design."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from butterfly.errors import IdentifiabilityError, InputError
from butterfly.identification.data import DataSet
from butterfly.identification.design import rank_experiments
from butterfly.identification.diagnostics.findings import FindingKind
from butterfly.identification.diagnostics.plausibility import judge_input
from butterfly.identification.estimators import (
    Estimator,
    HarmonicBalance,
    Linear,
    OutputError,
    WeakForm,
)
from butterfly.identification.validate import bootstrap
from butterfly.logs.log import InputKind, Intersample, Log, Sine
from butterfly.model.greybox import simulate
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass, LumpedParameters
from butterfly.model.terms import PARAMETERS
from butterfly.report.finding_texts import estimate_sentences
from butterfly.thesis.method import fit_thesis
from butterfly.verdict import Level
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


@pytest.mark.parametrize(("resistance", "accused"), [(0.005, True), (0.05, False), (0.9, False)])
def test_only_a_resistance_that_no_motor_has_is_noticed(resistance, accused):
    """p4 = k/R and p2 = k^2/R, so the bound on the resistance is p2/p4^2."""
    p4 = 2.0
    estimate = SimpleNamespace(
        names=("p2", "p4"),
        upper=np.array([resistance * p4**2, 2.1]),
        parameters=replace(ROBOT, p4=-p4),
    )
    said = judge_input(estimate, InputKind.VOLTAGE)
    assert [each.number for each in said] == pytest.approx([resistance] if accused else [])
    found = replace(ROBOT, p2=resistance * p4**2, p4=p4)
    known = SimpleNamespace(names=("p4",), upper=np.array([2.1]), parameters=found)
    assert bool(judge_input(known, InputKind.VOLTAGE)) == accused


def test_a_candidate_tells_two_numbers_of_the_model_s_relative_error():
    """What it would leave, from sensitivities simulated here and the sum of information."""
    near = [(m, w) for m in MASSES for w in (4.0, 4.6, 6.5)]
    robot = replace(ROBOT, coulomb=1e-3, p2=5e-4, delay=0.003)
    found = HarmonicBalance()(
        DataSet.of([_log(robot, m, w, 5e-3, k) for k, (m, w) in enumerate(near)])
    )
    candidates = rank_experiments(found, [MASSES[1]], 0.05)
    chosen = next(c for c in candidates if c.what.startswith("sine") and not c.warning)
    omega, amplitude = (float(part) for part in re.findall(r"[\d.]+\d", chosen.what))
    time = np.arange(0, 40, 5e-3)
    instants = np.column_stack([time[:-1], time[:-1] + 2.5e-3, time[1:]])

    def angle(values):
        p = LumpedParameters(**dict(zip(found.names, values, strict=True)))
        late = np.maximum(instants - p.delay, 0.0)
        loaded = p.with_added_mass(MASSES[1])
        return simulate(loaded, time, amplitude * np.sin(omega * late), 0.0)[0]

    there = angle(found.values)
    steps = np.diag(found.standard_errors)
    slopes = np.column_stack([angle(found.values + h) - there for h in steps])
    slopes /= found.standard_errors
    noise = (0.05 * np.std(there)) ** 2
    information = 2 / time.size * slopes.T @ slopes / noise
    prior = found.covariance
    gain = prior @ np.linalg.inv(np.eye(6) + information @ prior)
    expected = np.sqrt(np.diag(gain)) / found.standard_errors
    np.testing.assert_allclose(chosen.errors, expected, rtol=1e-3)


def test_a_current_controlled_drive_called_a_voltage_is_noticed(real):
    said = judge_input(real.estimate, InputKind.VOLTAGE)
    assert len(said) == 1
    assert said[0].kind is FindingKind.TORQUE_DRIVEN
    assert said[0].severity is Level.NOTE
    assert "resistance below" in estimate_sentences(real.estimate.with_findings(*said))[-1]
    assert judge_input(real.estimate, InputKind.TORQUE) == []
    motor = replace(
        real.estimate,
        names=PARAMETERS,
        values=np.array([0.00325, 0.00145, 0.049, 0.025, 3e-4, 0.0]),
        upper=np.array([0.0033, 0.0015, 0.05, 0.026, 4e-4, 1e-3]),
    )
    assert judge_input(motor, InputKind.VOLTAGE) == []


class DescribingFunctions(HarmonicBalance):
    """Without the remainder."""

    def __call__(self, data):
        return self.of_points(data.sines)


def test_the_bootstrap_agrees_with_the_sandwich(real):
    estimator = DescribingFunctions(terms=())
    whole = estimator(real.data)
    drawn = bootstrap(real.data, estimator, whole, repetitions=100, seed=1)
    spread = np.std(drawn.values, axis=0)
    np.testing.assert_allclose(spread / whole.standard_errors, 1.0, atol=0.35)
    assert np.all(drawn.lower < whole.values)
    assert np.all(whole.values < drawn.upper)
    again = bootstrap(real.data, estimator, whole, repetitions=20, seed=1)
    np.testing.assert_array_equal(again.values, drawn.values[:20])
    with pytest.raises(InputError, match="at least 20"):
        bootstrap(real.data, estimator, whole, repetitions=3)


@pytest.mark.slow
def test_the_bootstrap_keeps_the_terms_that_were_chosen_from_all_logs(real):
    drawn = bootstrap(real.data, HarmonicBalance(), real.estimate, repetitions=20)
    assert len(real.estimate.names) > len(PARAMETERS)
    assert drawn.values.shape == (20, len(real.estimate.names))


class Forgetful(Estimator):
    """Drops its term where a draw is one log only."""

    def __call__(self, data):
        names = ("p1", "drag") if len({log.name for log in data.logs}) > 1 else ("p1",)
        return SimpleNamespace(names=names, values=np.array([1.0, 2.0])[: len(names)])


def test_draws_that_cannot_tell_a_term_are_drawn_again_or_refused():
    logs = [_log(ROBOT, MASSES[0], omega) for omega in (2.5, 4.5, 7.0)]
    data = DataSet.of([replace(log, name=f"{k}") for k, log in enumerate(logs)])
    whole = SimpleNamespace(names=("p1", "drag"))
    drawn = bootstrap(data, Forgetful(), whole, repetitions=20, seed=3)
    assert drawn.values.shape == (20, 2)
    with pytest.raises(IdentifiabilityError, match="cannot tell load"):
        bootstrap(data, Forgetful(), SimpleNamespace(names=("p1", "load")), repetitions=20)


@pytest.mark.parametrize(
    ("estimator", "terms"),
    [
        (HarmonicBalance(), ("stribeck", "bias")),
        (WeakForm(terms=("drag", "load"), half_width=0.2), ("drag",)),
        (OutputError(window=20.0), ("drag", "stribeck", "stribeck_velocity")),
        (OutputError(terms=("drag",)), ()),
    ],
)
def test_an_estimator_holds_the_terms_of_an_estimate_and_all_else_as_it_was(estimator, terms):
    held = estimator.holding_terms_of(SimpleNamespace(names=(*PARAMETERS, *terms)))
    assert held == estimator.with_terms(terms)


def test_one_that_offers_no_terms_is_held_as_it_is():
    estimate = SimpleNamespace(names=("p1", "p2", "p3", "p4"))
    assert Linear().holding_terms_of(estimate) == Linear()


def test_an_estimate_with_the_terms_held_is_the_one_that_chose_them(real):
    chosen = HarmonicBalance(check=False)(real.data)
    held = HarmonicBalance(check=False).holding_terms_of(chosen)(real.data)
    assert held.names == chosen.names
    np.testing.assert_allclose(
        (held.values - chosen.values) / chosen.standard_errors, 0.0, atol=0.3
    )


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
    thesis = fit_thesis(real.data.recorded)
    with pytest.raises(IdentifiabilityError, match="no covariance"):
        rank_experiments(thesis, real.data.masses, 0.1)
