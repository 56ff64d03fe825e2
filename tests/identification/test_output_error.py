"""Output error: what it recovers, and its equations, their derivatives and parts of them."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from butterfly.errors import IdentifiabilityError
from butterfly.identification.data import DataSet
from butterfly.identification.estimators import Loss, OutputError
from butterfly.identification.estimators.start import starts
from butterfly.identification.problem import Start
from butterfly.identification.trust import Ending, FindingKind
from butterfly.logs.log import Sine
from butterfly.model.parameters import LumpedParameters
from tests.conftest import MASSES
from tests.identification.simulated import RICH, SWINGS, next_runs, noisy, simulated, steady
from tests.identification.simulated import ROBOT as PLAIN

ROBOT = RICH
ZERO = 0.6


@pytest.fixture(scope="module")
def logs():
    drives = ((2.0, 0.014), (4.0, 0.014), (8.0, 0.08))
    sines = [Sine(omega=omega, amplitude=amplitude) for omega, amplitude in drives]
    seen = {"start": 0.05, "step": 4e-3, "zero": ZERO}
    clean = [
        simulated(ROBOT, mass, sine.sample, 12.0, sine=sine, source=f"{mass}-{sine.omega}", **seen)
        for mass in MASSES
        for sine in sines
    ]
    return [noisy([log], 1e-3, np.random.default_rng(7))[0] for log in clean]


def _fit(logs, **options):
    data = DataSet.of(logs)
    return OutputError(**options).of_logs(data.logs, starts(data, options.get("terms")))


@pytest.fixture(scope="module")
def estimate(logs):
    return _fit(logs)


def test_every_term_is_recovered_within_its_interval(estimate):
    truth = np.array([getattr(ROBOT, name) for name in estimate.names])
    rounding = 1e-4 * np.abs(truth)
    assert np.all((estimate.lower - rounding <= truth) & (truth <= estimate.upper + rounding))
    np.testing.assert_allclose(estimate.values, truth, rtol=0.01)
    assert estimate.local[None]["zero"] == pytest.approx(ZERO, abs=1e-4)
    assert estimate.ending is Ending.CONVERGED


def test_runs_from_rest_do_not_depend_on_the_first_guess_of_the_delay():
    """They begin with their first sample, and not by what a guess is late."""
    logs = steady(replace(PLAIN, bias=1e-3), SWINGS, MASSES[:2])
    known = OutputError(terms=("bias",))
    guess = Start(PLAIN, dict.fromkeys(MASSES, 0.0))
    late = replace(guess, parameters=replace(PLAIN, delay=0.012))
    one, other = (known.of_logs(logs, [start]) for start in (guess, late))
    np.testing.assert_allclose(other.values, one.values, rtol=3e-3, atol=1e-5)
    assert one.parameters.p2 == pytest.approx(PLAIN.p2, rel=0.01)


def test_one_core_or_several_give_the_same_to_the_bit(logs):
    one, two = (_fit(logs[:6], terms=("drag",), workers=workers).values for workers in (1, 2))
    np.testing.assert_array_equal(one, two)


def test_what_differs_from_log_to_log_can_be_fitted(logs):
    turned = [replace(log, angle=log.angle + 0.01 * k, name=f"{k}") for k, log in enumerate(logs)]
    estimate = _fit(turned, per_log=("zero",), terms=("drag", "load", "stribeck", "bias"))
    zeros = [estimate.local[f"{k}"]["zero"] for k in range(len(turned))]
    assert np.median(np.diff(zeros)) == pytest.approx(0.01, abs=1e-4)
    assert np.median(DataSet.of(turned).simulations.fits(estimate)) > 99


DRIVES = ((2.0, 0.03), (3.5, 0.03), (5.5, 0.03), (7.0, 0.06), (9.0, 0.1))


def _scattering(drives, duration):
    """Logs of a joint whose friction differs by 20 % from log to log, and what it is on average."""
    rng, robot = np.random.default_rng(11), replace(ROBOT, drag=0.0, load=0.0, stribeck=0.0)
    seen = {"start": 0.05, "step": 4e-3, "zero": ZERO}
    found = []
    for mass in MASSES:
        for omega, amplitude in drives:
            factor = 1 + 0.2 * rng.standard_normal()
            own = replace(robot, p2=robot.p2 * factor, coulomb=robot.coulomb * factor)
            sine = Sine(omega=omega, amplitude=amplitude)
            named = f"{mass}-{omega}"
            log = simulated(own, mass, sine.sample, duration, sine=sine, source=named, **seen)
            found += noisy([log], 1e-4, rng)
    return robot, found


@pytest.mark.slow
def test_friction_that_differs_from_log_to_log_is_said_and_pulls_at_nothing_else():
    robot, logs = _scattering(DRIVES, 30.0)
    estimate = _fit(logs, terms=("bias", "p3_offset"))
    robust = _fit(logs, terms=("bias", "p3_offset"), loss=Loss.HUBER)
    said = [each for each in estimate.findings if each.kind is FindingKind.SCATTER]
    assert [each.parameters for each in said] == [("p2", "coulomb")]
    assert said[0].number == pytest.approx(0.2, rel=0.5)
    assert not [each for each in robust.findings if each.kind is FindingKind.SCATTER]
    errors = [abs(each.parameters.p1 / robot.p1 - 1) for each in (estimate, robust)]
    assert errors[0] < 0.001
    assert errors[0] < errors[1] / 2


def test_of_few_logs_or_of_logs_that_agree_no_scatter_is_said(estimate):
    robot, differing = _scattering(DRIVES[:1], 12.0)
    start = Start(robot, dict.fromkeys(MASSES, ZERO))
    few = OutputError(terms=("bias",)).of_logs(differing, [start])
    for found in (few, estimate):
        assert FindingKind.SCATTER not in {each.kind for each in found.findings}


def test_friction_of_a_gear_is_found_unasked_and_a_next_experiment_tells_more_of_it():
    plain = LumpedParameters(p1=0.003, p2=1e-3, p3=0.04, p4=0.5, coulomb=8e-4)
    robot = replace(plain, load_friction=0.15)
    logs = [
        simulated(robot, mass, lambda t, w=w: 0.02 * np.sin(w * t) + 0.01 * np.sin(7 * t), 10.0)
        for mass, w in product(MASSES, (2.0, 3.5))
    ]
    data = DataSet.of(noisy(logs, 1e-3, np.random.default_rng(0)))
    found = OutputError(workers=1)(data)
    assert "load_friction" in found.names
    assert found.parameters.load_friction == pytest.approx(0.15, rel=0.05)
    at = found.names.index("load_friction")
    assert found.lower[at] <= 0.15 <= found.upper[at] < 0.2
    assert next_runs(data, found)[0].errors[at] < 0.95


def test_biases_of_single_logs_stay_where_terms_are_chosen():
    """What was asked for of each log is no row of the choice."""
    robot = replace(PLAIN, bias=2e-3)
    logs, start = steady(robot, SWINGS), [Start(robot, dict.fromkeys(MASSES, 0.0))]
    found = OutputError(per_log=("bias",), workers=1).of_logs(logs, start)
    own = [values["bias"] for values in found.local.values() if "bias" in values]
    np.testing.assert_allclose(own, 2e-3, rtol=0.05)


def test_a_refusal_that_a_term_causes_is_retried_without_it(monkeypatch):
    robot = replace(PLAIN, drag=8e-4)
    logs, refused = steady(robot, SWINGS), []
    start = [Start(robot, dict.fromkeys(MASSES, 0.0))]
    inferred = OutputError._inferred  # noqa: SLF001 - what refuses

    def refusing(self, problem, fit):
        if "drag" in fit.linearisation.names:
            refused.append(fit.linearisation.names)
            raise IdentifiabilityError("drag cannot be identified")
        return inferred(self, problem, fit)

    monkeypatch.setattr(OutputError, "_inferred", refusing)
    found = OutputError(workers=1).of_logs(logs, start)
    assert len(refused) == 1
    assert "drag" not in found.names
