"""Good models are seldom accused; what is missing is, and by its name."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators import OutputError
from butterfly.identification.fit import MissingTerms
from butterfly.identification.free_run import FreeRun, Setting
from butterfly.identification.identify import diagnose, identify
from butterfly.identification.residuals import LogResiduals, Residuals, residuals_of
from butterfly.identification.sensor_errors import Curve
from butterfly.identification.test_functions import ResidualTorque
from butterfly.identification.trust import FindingKind
from butterfly.model.terms import PARAMETERS
from butterfly.plant.sensors import Encoder
from butterfly.report.log_figures import residual_sentences
from tests.conftest import MASSES
from tests.identification.simulated import ROBOT, TONES, estimate_of, simulated

FIT = OutputError(terms=(), workers=1)
MISSING = {"drag": 2e-4, "p3_offset": 1e-3, "load": 5e-4, "load_friction": 0.05, "bias": 1e-3}
MISSING = {name: {name: size} for name, size in MISSING.items()}
MISSING |= {"stribeck": {"stribeck": 6e-4, "stribeck_velocity": 0.4}}


def _read(logs, encoder, seed=0):
    rng = np.random.default_rng(seed)
    return DataSet.of([replace(log, angle=encoder.read(log.time, log.angle, rng)) for log in logs])


def _tame(robot):
    """Two sums of sines for each mass, below the horizontal."""

    def tones(seed):
        phases = np.random.default_rng(seed).uniform(0, 2 * np.pi, len(TONES))
        pairs = list(zip(TONES, phases, strict=True))
        return lambda t: 0.008 * sum(np.sin(w * t + p) - np.sin(p) for w, p in pairs)

    both = list(product(MASSES, range(2)))
    timed = {"start": 0.3, "step": 4e-3}
    logs = [simulated(robot, mass, tones(k), 14.0, **timed) for k, (mass, _) in enumerate(both)]
    assert max(np.abs(log.angle).max() for log in logs) < 1.5
    return logs


@pytest.fixture(scope="module")
def logs():
    return _tame(ROBOT)


@pytest.fixture(scope="module")
def noisy(logs):
    """Logs of a noisy encoder, and the estimate from them."""
    data = _read(logs, Encoder(steps=8192, noise=1e-3))
    return data, FIT(data)


def _lacking(term, **encoder):
    """Logs of a robot with a term that the model lacks, and the robot."""
    robot = replace(ROBOT, **MISSING[term])
    return _read(_tame(robot), Encoder(**{"steps": 8192, "noise": 1e-4} | encoder)), robot


@pytest.mark.parametrize(("steps", "noise"), [(1024, 0.0), (65536, 1e-3)])
def test_a_good_model_is_not_accused(logs, steps, noise):
    data = _read(logs, Encoder(steps=steps, noise=noise))
    misfit = residuals_of(data, FIT(data))
    assert not misfit.beyond_sensors
    assert misfit.outside <= 1
    assert misfit.times == pytest.approx(1.0, abs=0.1)
    assert misfit.missing.terms == ()
    followed, finding = misfit.findings
    assert followed.number == misfit.remaining
    assert finding.kind is FindingKind.NO_MISFIT


def test_logs_of_white_and_of_lasting_errors_are_judged_together(logs):
    """Noise above half a step of the encoder in half of the logs, none in the others."""
    parts = [
        _read(logs[k::2], Encoder(steps=8192, noise=noise)) for k, noise in enumerate((0, 1e-3))
    ]
    data = DataSet.of([*parts[0].logs, *parts[1].logs])
    found = residuals_of(data, FIT(data))
    assert [log.sensor.white for log in found.logs] == [False] * 3 + [True] * 3
    assert found.outside == 0
    assert found.times == pytest.approx(1.0, abs=0.1)


def test_missing_terms_of_an_estimate_are_named_and_held_where_sensors_do_not_explain(
    noisy, monkeypatch
):
    monkeypatch.setattr("butterfly.identification.identify.find_unit_errors", lambda *_: [])
    lacking, _ = _lacking("drag")
    for data, named in ((lacking, True), (noisy[0], False)):
        found = FIT(data)
        shares = {log.name: 0.1 * k for k, log in enumerate(data.logs)}
        told = {"terms": ("drag",), "others": (("load",),), "share": 0.6, "moved": ("p1",)}
        missing = MissingTerms(**told, shares=shares, rival=1.5 * found.values)
        told = replace(found, missing=missing)
        judged = diagnose(data, FIT, told, residuals_of(data, told))
        again = Estimate.from_dict(judged.to_dict()).missing
        np.testing.assert_equal(vars(again), vars(missing))
        misfit = residuals_of(data, judged)
        assert misfit.missing.terms == (("drag",) if named else ())
        expected = [*shares.values()] if named else [0.0] * len(shares)
        assert [log.share for log in misfit.logs] == expected
        said = [each for each in judged.findings if each.kind is FindingKind.MISSING_TERM]
        assert [each.parameters for each in said] == ([("drag or load", "p1")] if named else [])
        assert (judged.upper >= missing.rival).all() == named


@pytest.mark.parametrize("term", MISSING)
def test_a_missing_term_is_seen_and_named_and_intervals_hold_what_it_would_give(term, monkeypatch):
    monkeypatch.setattr("butterfly.identification.identify.find_unit_errors", lambda *_: [])
    data, _ = _lacking(term)
    found = identify(data, FIT)
    misfit, missing = found.residuals, found.residuals.missing
    assert misfit.beyond_sensors
    assert misfit.outside == len(misfit.logs)
    assert (term,) in {missing.terms, *missing.others}
    assert missing.share > 0.5
    assert missing.share == pytest.approx(np.mean([log.share for log in misfit.logs]), abs=0.2)
    _, misses, said = misfit.findings
    assert misses.kind is FindingKind.MISFIT
    assert said.kind is FindingKind.MISSING_TERM
    assert said.parameters[1:] == missing.moved
    assert term in said.parameters[0]
    assert (missing.rival is None) == (not missing.moved)
    if missing.rival is not None:
        assert (found.estimate.lower <= missing.rival).all()
        assert (missing.rival <= found.estimate.upper).all()


@pytest.mark.parametrize("term", ["drag", "stribeck"])
def test_a_term_that_the_model_has_is_never_named(term):
    """The model has Coulomb friction, and so has the robot: that is no news."""
    data, robot = _lacking(term)
    told = FIT.with_terms((term,))
    estimate = replace(told(data), fixed={"stribeck_velocity": robot.stribeck_velocity})
    found = residuals_of(data, estimate).missing
    assert not {"coulomb", "p1", "p2", "p3", term} & {*found.terms, *sum(found.others, ())}


def test_a_value_that_is_a_little_off_is_an_error_and_no_misfit(noisy):
    data, estimate = noisy
    off = replace(estimate, values=estimate.values * (1 + 0.002 * np.array([1, -5, 1, 1, 5, 5])))
    misfit, before = residuals_of(data, off), residuals_of(data, estimate)
    assert misfit.relative > 1.2 * before.relative
    assert misfit.remaining == pytest.approx(before.remaining, rel=0.05)
    assert not misfit.beyond_sensors
    again = residuals_of(data, estimate)
    assert [log.excess for log in again.logs] == [log.excess for log in before.logs]


def test_a_run_that_fails_is_outside_and_hides_no_other(noisy):
    data, estimate = noisy
    wrong = np.where(np.array(estimate.names) == "p1", -1e-6, estimate.values)
    misfit = residuals_of(data, replace(estimate, values=wrong))
    assert misfit.logs[0].outside
    assert misfit.logs[0].autocorrelation is None
    assert len(misfit.logs) == 6
    assert misfit.logs[-1].autocorrelation is not None


def test_a_log_near_the_upright_that_no_free_run_follows_does_not_judge_the_model(noisy):
    data, estimate = noisy
    first = data.logs[0]
    over = 4.0 * np.clip(first.time - first.time[0] - 6.0, 0.0, 1.0)
    astray = replace(first, name="astray", angle=first.angle + over)
    residuals = residuals_of(DataSet.of([*data.logs, astray]), estimate)
    alone = residuals_of(data, estimate)
    assert [log.counted for log in residuals.logs] == [True] * len(data.logs) + [False]
    assert residuals.logs[-1].error > 1.0
    assert residuals.remaining == pytest.approx(alone.remaining, rel=0.1)
    assert not residuals.beyond_sensors
    (said,) = [line for line in residual_sentences(residuals) if "Not counted" in line]
    assert said.endswith("astray.")


def _true():
    """The true values, and next to no errors."""
    values = np.array([getattr(ROBOT, name) for name in PARAMETERS])
    found = estimate_of(values, 1e-24 * np.eye(values.size), names=PARAMETERS, reach=0)
    return replace(found, local={None: {"zero": 0.0}})


def _torques(data, **known):
    """Residual torques of logs with the true values of all but what is missing."""
    true = replace(_true(), fixed=known)
    for number, log in enumerate(data.logs):
        setting = data.simulations.setting(number, true)
        yield ResidualTorque.of(log, setting.parameters, setting.zero)


@pytest.mark.parametrize("term", ["drag", "p3_offset", "bias"])
def test_the_residual_torque_is_that_of_the_missing_term(term):
    data, robot = _lacking(term, steps=65536, noise=0.0)
    for each in _torques(data):
        v = each.velocity
        shape = {"drag": np.abs(v) * v, "p3_offset": np.cos(each.angle), "bias": -np.ones(v.size)}
        expected = shape[term] * -getattr(robot, term)
        error = np.sqrt(np.mean((each.torque - expected) ** 2))
        assert error < 0.3 * np.sqrt(np.mean(expected**2))


def test_the_friction_of_a_gear_leaves_no_residual_torque():
    data, robot = _lacking("load_friction", steps=65536, noise=0.0)
    for each in _torques(data, load_friction=robot.load_friction):
        lost = robot.load_friction * robot.p3 * np.sin(each.angle)
        assert np.std(each.torque) < 0.3 * np.sqrt(np.mean(lost**2))


def test_readings_of_a_good_model_lie_inside_its_bands(logs, noisy):
    """More than 95 % where the encoder's step, which nothing goes beyond, is most of the error."""
    for data, found in (noisy, (_read(logs, Encoder(steps=8192, noise=1e-4)), _true())):
        inside = []
        for log, misfit in zip(data.logs, residuals_of(data, found).logs, strict=True):
            run = FreeRun.of(log, Setting(parameters=found.parameters, zero=data.zero_of(log)))
            near = np.interp(log.time, misfit.band.time, misfit.band.half_width)
            inside.append(np.mean(np.abs(run.simulated - log.angle) <= near))
        assert 0.93 <= np.mean(inside) <= 0.99


def test_a_band_is_as_wide_as_what_the_interval_of_a_parameter_moves(logs):
    data = _read(logs, Encoder(steps=65536, noise=0.0))
    found = sharp = replace(_true(), covariance=np.zeros((6, 6)))
    k = found.names.index("p3")
    lower, upper, covariance = found.values.copy(), found.values.copy(), sharp.covariance.copy()
    lower[k], upper[k], covariance[k, k] = 0.98 * lower[k], 1.02 * upper[k], 1e-12
    wide = replace(sharp, lower=lower, upper=upper, covariance=covariance)
    bands = [residuals_of(data, each).logs[0].band for each in (sharp, wide)]
    log = data.logs[0]
    angles = [
        FreeRun.of(log, Setting(parameters=each, zero=data.zero_of(log))).simulated
        for each in (found.parameters, replace(found.parameters, p3=upper[k]))
    ]
    moved = np.interp(bands[0].time, log.time, np.abs(angles[1] - angles[0]))
    reach = np.sqrt(bands[1].half_width ** 2 - bands[0].half_width ** 2)
    assert np.linalg.norm(reach - moved) < 0.1 * np.linalg.norm(moved)


@pytest.mark.parametrize(("outside", "beyond"), [(0, False), (2, False), (5, True), (10, True)])
def test_half_of_the_logs_outside_their_bands_are_no_chance(outside, beyond):
    curve = Curve.of(np.arange(3.0), np.zeros((3, 1)), 100, 0.0)
    blank = LogResiduals(name="", label="", motion=1.0, autocorrelation=curve)
    far = replace(blank, autocorrelation=replace(curve, value=np.ones(3)))
    logs = tuple(far if k < outside else blank for k in range(10))
    assert Residuals(logs=logs).beyond_sensors is beyond
