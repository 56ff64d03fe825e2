from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from butterfly.errors import IdentifiabilityError, InputError
from butterfly.identification.data import DataSet
from butterfly.identification.design import judged_candidate
from butterfly.identification.diagnostics.findings import Ending, FindingKind
from butterfly.identification.estimators import HarmonicBalance, Loss, OutputError
from butterfly.identification.estimators.multistart import Start
from butterfly.logs.log import Sine
from butterfly.model.parameters import LumpedParameters
from tests.conftest import MASSES
from tests.identification.simulated import RICH, noisy, simulated

ROBOT = RICH
ZERO = 0.6


@pytest.fixture(scope="module")
def logs():
    drives = ((2.0, 0.014), (4.0, 0.014), (5.5, 0.02), (8.0, 0.08))
    sines = [Sine(omega=omega, amplitude=amplitude) for omega, amplitude in drives]
    seen = {"start": 0.05, "step": 2e-3, "zero": ZERO}
    clean = [
        simulated(ROBOT, mass, sine.sample, 20.0, sine=sine, source=f"{mass}-{sine.omega}", **seen)
        for mass in MASSES
        for sine in sines
    ]
    return [noisy([log], 1e-3, np.random.default_rng(7))[0] for log in clean]


def _fit(logs, **options):
    data = DataSet.of(logs)
    start = Start(HarmonicBalance().of_points(data.sines).parameters, data.equilibria)
    return OutputError(**options).of_logs(data.logs, [start])


def test_every_term_is_recovered_within_its_interval(logs):
    estimate = _fit(logs)
    truth = np.array([getattr(ROBOT, name) for name in estimate.names])
    rounding = 1e-4 * np.abs(truth)
    assert np.all((estimate.lower - rounding <= truth) & (truth <= estimate.upper + rounding))
    np.testing.assert_allclose(estimate.values, truth, rtol=0.01)
    assert estimate.local[None]["zero"] == pytest.approx(ZERO, abs=1e-4)
    assert estimate.ending is Ending.CONVERGED


def test_one_core_or_several_give_the_same_to_the_bit(logs):
    one, two = (_fit(logs[:8], workers=workers).values for workers in (1, 2))
    np.testing.assert_array_equal(one, two)


def test_sign_unit_and_start_of_the_clock_and_order_of_logs_change_nothing_else(logs):
    part = [*logs[:4], *logs[8:]]
    moved = [replace(log, time=log.time + 100.0, input=-8.0 * log.input) for log in reversed(part)]
    before, after = (_fit(each, terms=("drag",)) for each in (part, moved))
    unit = np.where([name == "p4" for name in before.names], -8.0, 1.0)
    small = np.maximum(before.standard_errors, 1e-12) / np.abs(unit)
    np.testing.assert_allclose((after.values - before.values / unit) / small, 0, atol=0.1)


def test_a_third_of_the_sampling_rate_gives_the_same(logs):
    coarse = [log.take(np.arange(0, log.time.size, 3)) for log in logs]
    fine, thinned = (_fit(each) for each in (logs, coarse))
    shift = np.abs(thinned.values - fine.values)
    assert np.all(shift < 5 * np.hypot(fine.standard_errors, thinned.standard_errors))
    np.testing.assert_allclose(thinned.values, fine.values, rtol=0.02)


def test_what_differs_from_log_to_log_can_be_fitted(logs):
    turned = [replace(log, angle=log.angle + 0.01 * k, name=f"{k}") for k, log in enumerate(logs)]
    estimate = _fit(turned, per_log=("zero",), terms=("drag", "load", "stribeck", "bias"))
    zeros = [estimate.local[f"{k}"]["zero"] for k in range(len(turned))]
    assert np.median(np.diff(zeros)) == pytest.approx(0.01, abs=1e-4)
    assert np.median(DataSet.of(turned).simulations.fits(estimate)) > 99


def test_one_added_mass_and_an_unknown_term_are_refused(logs):
    data = DataSet.of(logs[:4])
    with pytest.raises(IdentifiabilityError, match="common factor"):
        OutputError().of_logs(data.logs, [Start(ROBOT, data.equilibria)])
    with pytest.raises(InputError, match="did you mean"):
        OutputError(terms=("drug",))


@pytest.fixture(scope="module")
def scattering():
    """Logs of a joint whose friction differs by 20 % from log to log, and what it is on average."""
    rng, robot = np.random.default_rng(11), replace(ROBOT, drag=0.0, load=0.0, stribeck=0.0)
    seen = {"start": 0.05, "step": 4e-3, "zero": ZERO}
    found = []
    for mass in MASSES:
        for omega, amplitude in ((2.0, 0.03), (3.5, 0.03), (5.5, 0.03), (7.0, 0.06), (9.0, 0.1)):
            factor = 1 + 0.2 * rng.standard_normal()
            own = replace(robot, p2=robot.p2 * factor, coulomb=robot.coulomb * factor)
            sine = Sine(omega=omega, amplitude=amplitude)
            named = f"{mass}-{omega}"
            log = simulated(own, mass, sine.sample, 30.0, sine=sine, source=named, **seen)
            found += noisy([log], 1e-4, rng)
    return robot, found


@pytest.mark.slow
def test_friction_that_differs_from_log_to_log_is_said_and_pulls_at_nothing_else(scattering):
    robot, logs = scattering
    estimate = _fit(logs, terms=("bias", "p3_offset"))
    robust = _fit(logs, terms=("bias", "p3_offset"), loss=Loss.HUBER)
    said = [each for each in estimate.findings if each.kind is FindingKind.SCATTER]
    assert [each.parameters for each in said] == [("p2", "coulomb")]
    assert said[0].number == pytest.approx(0.2, rel=0.5)
    assert not [each for each in robust.findings if each.kind is FindingKind.SCATTER]
    errors = [abs(each.parameters.p1 / robot.p1 - 1) for each in (estimate, robust)]
    assert errors[0] < 0.001
    assert errors[0] < errors[1] / 2


def test_of_few_logs_or_of_logs_that_agree_no_scatter_is_said(logs, scattering):
    robot, differing = scattering
    start = Start(robot, dict.fromkeys(MASSES, ZERO))
    few = OutputError(terms=("bias",)).of_logs(differing[::7], [start])
    for found in (few, _fit(logs, terms=("drag", "load", "bias", "p3_offset", "stribeck"))):
        assert FindingKind.SCATTER not in {each.kind for each in found.findings}


def test_friction_of_a_gear_is_found_unasked_and_a_next_experiment_tells_more_of_it():
    plain = LumpedParameters(p1=0.003, p2=1e-3, p3=0.04, p4=0.5, coulomb=8e-4)
    robot = replace(plain, load_friction=0.15)
    logs = [
        simulated(robot, mass, lambda t, w=w: 0.02 * np.sin(w * t) + 0.01 * np.sin(7 * t), 10.0)
        for mass, w in product(MASSES, (2.0, 3.5))
    ]
    found = OutputError(workers=1)(DataSet.of(noisy(logs, 1e-3, np.random.default_rng(0))))
    assert "load_friction" in found.names
    assert found.parameters.load_friction == pytest.approx(0.15, rel=0.05)
    at = found.names.index("load_friction")
    assert found.lower[at] <= 0.15 <= found.upper[at] < 0.2
    slow = Sine(omega=1.5, amplitude=0.04)
    assert judged_candidate(found, MASSES[1], slow, misfit=1e-3, limit=1.0).errors[at] < 1
