"""Harmonic balance of exact responses, and of sines that settle, whose middles tell the zero."""

from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from butterfly.api.verbs import identify
from butterfly.errors import IdentifiabilityError
from butterfly.identification.data import DataSet
from butterfly.identification.estimators import HarmonicBalance, Linear
from butterfly.identification.estimators.fast_look import Phasors, balanced
from butterfly.identification.trust import Ending, FindingKind
from butterfly.logs.log import Sine
from butterfly.model.linear import quasi_linear_response
from butterfly.model.parameters import AddedMass, LumpedParameters
from butterfly.model.prior import NO_PRIOR
from butterfly.model.terms import PARAMETERS
from tests.conftest import MASSES, ROBOT
from tests.identification.simulated import ROBOT as HAND
from tests.identification.simulated import response, simulated

PLAIN = HarmonicBalance(terms=())
OMEGAS = (2.0, 3.0, 3.5, 4.5, 5.5, 6.0, 7.0, 9.0)


def _vector(parameters):
    return np.array([getattr(parameters, name) for name in PARAMETERS])


def _points(parameters, *, masses=MASSES, omegas=OMEGAS, swing=0.15, noise=0.0, seed=0):
    """Steady responses that obey the harmonic balance exactly, each with some phase of its own."""
    rng = np.random.default_rng(seed)
    points = []
    for mass, omega in product(masses, omegas):
        gain = complex(quasi_linear_response(parameters.with_added_mass(mass), omega, swing))
        angle = swing * np.exp(1j * rng.uniform(-3, 3))
        noisy = angle + noise * complex(*rng.standard_normal(2))
        points.append(response(mass, omega, noisy, input_=angle / gain, error=max(noise, 1e-9)))
    return points


RANGES = {"p1": (5e-4, 5e-2), "p2": (1e-5, 5e-3), "p3": (-5e-3, 0.2), "p4": (0.01, 5.0)}
RANGES |= {"coulomb": (0.0, 5e-3), "delay": (0.0, 0.02)}
robots = st.builds(LumpedParameters, **{n: st.floats(*ends) for n, ends in RANGES.items()})


@settings(max_examples=15)
@given(robots)
def test_a_noise_free_balance_gives_back_the_robot(robot):
    estimate = PLAIN.of_points(_points(robot))
    scale = np.array([robot.p1, 1e-3, 0.05, robot.p4, 1e-3, 0.01])
    np.testing.assert_allclose(estimate.values / scale, _vector(robot) / scale, atol=1e-6)


@cache
def _repeated():
    """Estimates of 200 repetitions of one experiment."""
    return [PLAIN.of_points(_points(ROBOT, noise=5e-4, seed=k)) for k in range(200)]


@pytest.mark.slow
def test_standard_errors_match_repeated_experiments_and_intervals_cover():
    truth = _vector(ROBOT)
    fits = _repeated()
    spread = np.std([fit.values for fit in fits], axis=0)
    claimed = np.sqrt(np.mean([fit.standard_errors**2 for fit in fits], axis=0))
    np.testing.assert_allclose(claimed, spread, rtol=0.2)
    covered = np.mean([(fit.lower <= truth) & (truth <= fit.upper) for fit in fits], axis=0)
    assert np.all((covered > 0.92) & (covered < 0.99))


@pytest.mark.slow
def test_the_spread_reaches_the_cramer_rao_bound():
    """The bound of the angle's phasors with Gaussian noise, by numerical differentiation."""
    clean = _points(ROBOT)
    truth = _vector(ROBOT)

    def predicted(values):
        parameters = LumpedParameters(**dict(zip(PARAMETERS, values, strict=True)))
        angles = []
        for point in clean:
            loaded = parameters.with_added_mass(point.added_mass)

            def excess(a, p=point, loaded=loaded):
                return abs(complex(quasi_linear_response(loaded, p.omega, a)) * p.input) - a

            swing = brentq(excess, 0.5 * point.amplitude, 1.5 * point.amplitude, xtol=1e-14)
            angles.append(complex(quasi_linear_response(loaded, point.omega, swing)) * point.input)
        return np.concatenate([np.real(angles), np.imag(angles)])

    steps = np.diag(1e-5 * np.abs(truth))
    slopes = [(predicted(truth + d) - predicted(truth - d)) / (2 * d.sum()) for d in steps]
    jacobian = np.column_stack(slopes)
    bound = 5e-4 * np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    fits = np.array([fit.values for fit in _repeated()])
    rmse = np.sqrt(np.mean((fits - truth) ** 2, axis=0))
    assert np.all(rmse < 1.15 * bound)


@pytest.mark.parametrize(
    ("design", "said"),
    [
        *(({"masses": [mass]}, "only up to a common factor") for mass in MASSES),
        ({"omegas": [3.0]}, "equations for 6 parameters"),
        (
            {"masses": [AddedMass(mass=0.02 * k, arm=0.104) for k in range(8)], "omegas": [3.0]},
            "cannot be identified",
        ),
    ],
    ids=[*("one added mass leaves the scale free",) * 3, "too few logs", "one frequency only"],
)
def test_logs_that_do_not_determine_the_robot_are_refused(design, said):
    with pytest.raises(IdentifiabilityError, match=said):
        PLAIN.of_points(_points(ROBOT, **design))


def test_friction_that_is_not_there_ends_on_its_bound_and_is_said_to():
    robot = replace(ROBOT, coulomb=0.0)
    fits = [PLAIN.of_points(_points(robot, noise=5e-4, seed=k)) for k in range(10)]
    bounded = [fit for fit in fits if fit.values[4] == 0]
    assert bounded
    for fit in bounded:
        assert "coulomb" in fit.on_bound
        assert FindingKind.ON_BOUND in {each.kind for each in fit.findings}
    assert all(fit.values[4] >= 0 for fit in fits)


def test_an_iteration_that_does_not_settle_is_said_to(monkeypatch):
    points = _points(ROBOT, noise=5e-4)
    assert PLAIN.of_points(points).ending is Ending.CONVERGED
    monkeypatch.setattr("butterfly.identification.estimators.fast_look.MOST", 2)
    stopped = PLAIN.of_points(points)
    assert stopped.ending is Ending.STOPPED


def test_two_added_masses_suffice_but_cannot_be_checked_by_leaving_one_out():
    estimate = PLAIN.of_points(_points(ROBOT, masses=MASSES[:2]))
    np.testing.assert_allclose(estimate.values, _vector(ROBOT), rtol=1e-6)
    assert estimate.left_out == {}
    (few,) = [each for each in estimate.findings if each.kind is FindingKind.FEW_MASSES]
    assert few.number == 2


def _weights(relative, noise=1e-9):
    """Weights of 24 responses times slope; their swings differ."""
    rng = np.random.default_rng(0)
    swings = np.tile([0.02, 0.3], 12)
    points = [
        _points(ROBOT, masses=[mass], omegas=[omega], swing=swing, noise=noise)[0]
        for swing, (mass, omega) in zip(swings, product(MASSES, OMEGAS), strict=True)
    ]
    errors = 1 + relative * (rng.standard_normal(24) + 1j * rng.standard_normal(24))
    points = [
        replace(point, angle=replace(point.angle, phasors=point.angle.phasors * error))
        for point, error in zip(points, errors, strict=True)
    ]
    phasors = Phasors.of(points, PARAMETERS, NO_PRIOR, small=False)
    fit = balanced(phasors)
    by_gain = fit.linearisation.stack[0][:, :, PARAMETERS.index("p4")]  # the input, weighed
    weights = np.linalg.norm(by_gain, axis=1) / np.abs(phasors.input)
    return weights * phasors.slope(fit.values), swings


def test_a_misfit_in_proportion_to_the_swing_is_weighed_by_the_swing():
    """So that errors that a model leaves count alike; those of the encoder count as they are."""
    weights, swings = _weights(relative=0.02)
    np.testing.assert_allclose(weights * swings / np.mean(weights * swings), 1, rtol=0.1)
    assert np.mean(weights * swings) == pytest.approx(1 / 0.02, rel=0.3)
    weights, _ = _weights(relative=0.0, noise=1e-5)
    np.testing.assert_allclose(weights, 1e5, rtol=1e-2)


DRIVES = (2.0, 3.0, 7.5)


@pytest.fixture(scope="module")
def calm():
    """Six logs of sines that settle."""
    sines = [Sine(omega=omega, amplitude=0.005) for omega in DRIVES]
    return [
        simulated(HAND, mass, sine.sample, 40.0, sine=sine) for mass in MASSES[:2] for sine in sines
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
def test_sines_without_a_steady_swing_at_home_are_left_out_and_named(calm, changed):
    logs = [replace(log, angle=changed(log)) if k in {0, 3} else log for k, log in enumerate(calm)]
    data = DataSet.of(logs)
    assert data.steady == [1, 2, 4, 5]
    found = identify(data, PLAIN)
    (finding,) = (each for each in found.estimate.findings if each.kind is FindingKind.LEFT_OUT)
    assert (finding.logs, finding.number) == ((data.logs[0].name, data.logs[3].name), 6)


def test_of_sines_that_settle_and_of_other_inputs_nothing_is_said(calm):
    for first, kept in (
        (calm[0], [0, 1, 2, 3, 4, 5]),
        (replace(calm[0], angle=calm[0].angle + 2 * np.pi), [0, 1, 2, 3, 4, 5]),
        (replace(calm[0], excitation=None), [1, 2, 3, 4, 5]),
    ):
        data = DataSet.of([first, *calm[1:]])
        assert data.steady == kept
        assert FindingKind.LEFT_OUT not in {each.kind for each in PLAIN(data).findings}


@pytest.mark.parametrize("method", [PLAIN, Linear()])
def test_a_fast_look_is_to_be_used_with_care_at_best(calm, method):
    assert identify(DataSet.of(calm), method).standing == "use with care"


def test_the_linear_fit_is_called_in_tables_what_its_help_calls_it(calm):
    assert Linear.summary.startswith(identify(DataSet.of(calm), Linear()).estimate.method)
