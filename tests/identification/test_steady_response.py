"""Which sines have settled, and what the middles of their swings say of zero and bias."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.findings import FindingKind
from butterfly.identification.estimators import HarmonicBalance
from butterfly.identification.estimators.steady_response import RestAngles, steady_sines
from butterfly.logs.log import Sine
from butterfly.signals.frequency_response import ResponsePoint
from butterfly.signals.sine_fit import SineFit
from butterfly.verdict import Level
from tests.conftest import MASSES
from tests.identification.simulated import ROBOT, SWINGS, simulated, steady

ZERO, BIAS = 0.4, 2e-3
SIZES = (0.05, 0.3, 0.6, 1.0)
DRIVES = (2.0, 3.0, 7.5)


def _middle(moment, bias, swing):
    """Where gravity's mean torque at a swing, by quadrature, is in balance with a bias."""

    def excess(middle):
        mean, _ = quad(lambda phase: np.sin(middle + swing * np.sin(phase)), 0, 2 * np.pi)
        return moment * mean / (2 * np.pi) - bias

    return brentq(excess, -1.5, 1.5)


def _points(bias, noise=0.0, turns=0):
    rng = np.random.default_rng(0)
    points = []
    for mass in MASSES:
        for swing in SIZES:
            middle = _middle(ROBOT.p3 + mass.gravity_moment, bias, swing)
            fit = SineFit(
                omega=3.0,
                offset=ZERO + middle + noise * rng.standard_normal() + 2 * np.pi * turns,
                phasors=np.array([swing + 0j]),
                covariance=1e-12 * np.eye(2),
                residual_rms=0.0,
            )
            points.append(ResponsePoint(added_mass=mass, input=1.0, angle=fit, drift=0.0, label=""))
            turns = 0
    return points


def _zeros(points):
    return {
        mass: float(np.median([p.angle.offset for p in points if p.added_mass == mass]))
        for mass in MASSES
    }


def _rest(points, *, asked):
    return RestAngles.of(points, ROBOT, _zeros(points), asked=asked)


@pytest.mark.parametrize("bias", [BIAS, -BIAS])
def test_bias_and_zero_are_read_off_the_middles_of_swings(bias):
    rest = _rest(_points(bias), asked=None)
    assert rest.bias == pytest.approx(bias, rel=2e-3)
    np.testing.assert_allclose(rest.zeros, ZERO, atol=2e-4)
    assert rest.applied(ROBOT).bias == rest.bias
    assert rest.of_part(np.arange(12) >= 4) == pytest.approx(bias, rel=5e-3)


def test_a_whole_turn_makes_no_difference():
    plain, turned = (_rest(_points(BIAS, turns=turns), asked=True) for turns in (0, 1))
    assert turned.bias == pytest.approx(plain.bias, rel=1e-9)


def test_middles_that_tell_of_no_bias_leave_each_mass_its_zero():
    points = _points(0.0, noise=1e-3)
    rest = _rest(points, asked=None)
    assert rest.bias is None
    zeros = _zeros(points)
    np.testing.assert_array_equal(rest.zeros, [zeros[p.added_mass] for p in points])
    assert rest.applied(ROBOT).bias == 0.0


def test_what_is_asked_for_is_done():
    assert _rest(_points(BIAS), asked=False).bias is None
    assert _rest(_points(0.0, noise=1e-3), asked=True).bias == pytest.approx(0.0, abs=1e-4)


def test_the_error_of_the_bias_is_its_spread():
    found = [_of_noise(seed) for seed in range(200)]
    spread = np.std([bias for bias, _ in found])
    claimed = np.sqrt(np.mean([error**2 for _, error in found]))
    assert claimed == pytest.approx(spread, rel=0.15)


def _of_noise(seed):
    rng = np.random.default_rng(seed)
    points = []
    for point in _points(BIAS):
        moved = replace(point.angle, offset=point.angle.offset + 1e-3 * rng.standard_normal())
        points.append(replace(point, angle=moved))
    rest = _rest(points, asked=True)
    solved = rest.solved
    return rest.bias, float(1 / np.linalg.norm(solved.jacobian))


def test_harmonic_balance_finds_a_bias_unasked_and_the_encoder_s_zero():
    robot = replace(ROBOT, bias=BIAS)
    logs = [replace(log, angle=log.angle + ZERO) for log in steady(robot, SWINGS)]
    found = HarmonicBalance(check=False)(DataSet.of(logs))
    assert found.parameters.bias == pytest.approx(BIAS, rel=0.02)
    assert found.local[None]["zero"] == pytest.approx(ZERO, abs=1e-3)


@pytest.fixture(scope="module")
def calm():
    """Six logs of sines that settle."""
    logs = []
    for mass in MASSES[:2]:
        for omega in DRIVES:
            sine = Sine(omega=omega, amplitude=0.005)
            logs.append(simulated(ROBOT, mass, sine.sample, 40.0, sine=sine))
    return logs


def _changed(logs, angle):
    return DataSet.of([replace(logs[0], angle=angle), *logs[1:]])


def _left_out(data):
    steady, said = steady_sines(data)
    assert steady == [1, 2, 3, 4, 5]
    (finding,) = said
    assert finding.kind is FindingKind.LEFT_OUT
    assert finding.logs == (data.logs[0].name,)
    assert finding.number == 6
    assert finding.severity is Level.NOTE


def test_sines_that_settle_are_all_used_and_nothing_is_said(calm):
    assert steady_sines(DataSet.of(calm)) == ([0, 1, 2, 3, 4, 5], [])


def test_other_inputs_are_passed_over_without_a_word(calm):
    mixed = DataSet.of([replace(calm[0], excitation=None), *calm[1:]])
    assert steady_sines(mixed) == ([1, 2, 3, 4, 5], [])


def test_a_hand_that_turns_over_is_left_out(calm):
    turning = np.where(calm[0].time > 25.0, 2 * np.pi * (calm[0].time - 25.0) / 3.0, 0.0)
    _left_out(_changed(calm, calm[0].angle + turning))


def test_a_swing_too_wide_for_a_sine_is_left_out(calm):
    _left_out(_changed(calm, calm[0].angle * (1.7 / np.abs(calm[0].angle[-4000:]).max())))


def test_a_swing_that_never_settles_is_left_out(calm):
    growing = calm[0].angle * np.exp(0.1 * (calm[0].time - 40.0))
    _left_out(_changed(calm, growing))


def test_one_that_rests_elsewhere_is_left_out_but_not_one_that_rests_a_whole_turn_off(calm):
    _left_out(_changed(calm, calm[0].angle + 1.5))
    assert steady_sines(_changed(calm, calm[0].angle + 2 * np.pi)) == ([0, 1, 2, 3, 4, 5], [])


def test_where_a_third_is_left_out_the_rest_needs_care(calm):
    moved = [replace(log, angle=log.angle + 1.5) for log in (calm[0], calm[3])]
    data = DataSet.of([moved[0], *calm[1:3], moved[1], *calm[4:]])
    steady, (said,) = steady_sines(data)
    assert steady == [1, 2, 4, 5]
    assert said.severity is Level.CARE
