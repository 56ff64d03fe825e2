"""Which sines have settled, and what the middles of their swings say of zero and bias."""

from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.findings import FindingKind
from butterfly.identification.estimators import HarmonicBalance
from butterfly.identification.estimators.steady_response import RestAngles, steady_sines
from butterfly.logs.log import Sine
from tests.conftest import MASSES
from tests.identification.simulated import ROBOT, SWINGS, response, simulated, steady

ZERO, BIAS = 0.4, 2e-3
SIZES = (0.05, 0.3, 0.6, 1.0)
DRIVES = (2.0, 3.0, 7.5)


@cache
def _middle(moment, bias, swing):
    """Where gravity's mean torque at a swing, by quadrature, is in balance with a bias."""

    def excess(middle):
        mean, _ = quad(lambda phase: np.sin(middle + swing * np.sin(phase)), 0, 2 * np.pi)
        return moment * mean / (2 * np.pi) - bias

    return brentq(excess, -1.5, 1.5)


def _points(bias, noise=0.0, turns=0, seed=0):
    rng = np.random.default_rng(seed)
    points = []
    for mass, swing in product(MASSES, SIZES):
        middle = _middle(ROBOT.p3 + mass.gravity_moment, bias, swing)
        middle += noise * rng.standard_normal() + 2 * np.pi * turns * (not points)
        points.append(response(mass, 3.0, swing + 0j, offset=ZERO + middle))
    return points


def _zeros(points):
    return {
        mass: float(np.median([p.angle.offset for p in points if p.added_mass == mass]))
        for mass in MASSES
    }


def _rest(points, *, asked):
    return RestAngles.of(points, ROBOT, _zeros(points), asked=asked)


@pytest.mark.parametrize("bias", [BIAS, -BIAS])
def test_bias_and_zero_are_read_off_the_middles_of_swings_whole_turns_off_too(bias):
    rest, turned = (_rest(_points(bias, turns=turns), asked=None) for turns in (0, 1))
    assert rest.bias == pytest.approx(bias, rel=2e-3)
    np.testing.assert_allclose(rest.zeros, ZERO, atol=2e-4)
    assert turned.bias == pytest.approx(rest.bias, rel=1e-9)
    assert _rest(_points(bias), asked=False).bias is None


def test_middles_that_tell_of_no_bias_leave_each_mass_its_zero():
    points = _points(0.0, noise=1e-3)
    rest = _rest(points, asked=None)
    assert rest.bias is None
    zeros = _zeros(points)
    np.testing.assert_array_equal(rest.zeros, [zeros[p.added_mass] for p in points])
    assert _rest(points, asked=True).bias == pytest.approx(0.0, abs=1e-4)


def test_the_error_of_the_bias_is_its_spread():
    found = [_rest(_points(BIAS, noise=1e-3, seed=seed), asked=True) for seed in range(200)]
    claimed = [1 / np.linalg.norm(rest.solved.rows) for rest in found]
    spread = np.std([rest.bias for rest in found])
    assert np.sqrt(np.mean(np.square(claimed))) == pytest.approx(spread, rel=0.15)


def test_harmonic_balance_finds_a_bias_unasked_and_the_encoder_s_zero():
    robot = replace(ROBOT, bias=BIAS)
    logs = [replace(log, angle=log.angle + ZERO) for log in steady(robot, SWINGS)]
    found = HarmonicBalance()(DataSet.of(logs))
    assert found.parameters.bias == pytest.approx(BIAS, rel=0.02)
    assert found.local[None]["zero"] == pytest.approx(ZERO, abs=1e-3)


@pytest.fixture(scope="module")
def calm():
    """Six logs of sines that settle."""
    sines = [Sine(omega=omega, amplitude=0.005) for omega in DRIVES]
    return [
        simulated(ROBOT, mass, sine.sample, 40.0, sine=sine)
        for mass in MASSES[:2]
        for sine in sines
    ]


def _turning(log):
    return log.angle + np.where(log.time > 25.0, 2 * np.pi * (log.time - 25.0) / 3.0, 0.0)


@pytest.mark.parametrize(
    "changed",
    [
        pytest.param(_turning, id="turns-over"),
        pytest.param(lambda log: log.angle * (1.7 / np.abs(log.angle[-4000:]).max()), id="wide"),
        pytest.param(lambda log: log.angle * np.exp(0.1 * (log.time - 40.0)), id="unsettled"),
        pytest.param(lambda log: log.angle + 1.5, id="rests-elsewhere"),
    ],
)
def test_a_sine_without_a_steady_swing_at_home_is_left_out(calm, changed):
    data = DataSet.of([replace(calm[0], angle=changed(calm[0])), *calm[1:]])
    steady, (finding,) = steady_sines(data)
    assert steady == [1, 2, 3, 4, 5]
    assert finding.kind is FindingKind.LEFT_OUT
    assert (finding.logs, finding.number) == ((data.logs[0].name,), 6)


@pytest.mark.parametrize(
    ("change", "kept"),
    [
        (lambda log: log, [0, 1, 2, 3, 4, 5]),
        (lambda log: replace(log, angle=log.angle + 2 * np.pi), [0, 1, 2, 3, 4, 5]),
        (lambda log: replace(log, excitation=None), [1, 2, 3, 4, 5]),
    ],
    ids=["as they are", "a whole turn off", "another input"],
)
def test_of_sines_that_settle_and_of_other_inputs_nothing_is_said(calm, change, kept):
    assert steady_sines(DataSet.of([change(calm[0]), *calm[1:]])) == (kept, [])


def test_what_is_left_out_is_named_and_the_rest_kept(calm):
    moved = [replace(log, angle=log.angle + 1.5) for log in (calm[0], calm[3])]
    data = DataSet.of([moved[0], *calm[1:3], moved[1], *calm[4:]])
    steady, (said,) = steady_sines(data)
    assert steady == [1, 2, 4, 5]
    assert said.logs == (data.logs[0].name, data.logs[3].name)
