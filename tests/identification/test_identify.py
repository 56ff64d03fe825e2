"""An identification step by step: each begins with the fit that the one before ended with."""

from dataclasses import replace

import numpy as np
import pytest

from butterfly.identification.chosen_terms import choose
from butterfly.identification.data import DataSet
from butterfly.identification.estimators import OutputError
from butterfly.identification.estimators.assumptions import weigh_by_scatter
from butterfly.identification.identify import diagnose, identify, simulated
from butterfly.identification.residuals import residuals_of
from butterfly.identification.trust import FindingKind
from tests.conftest import MASSES
from tests.identification.simulated import ROBOT, noisy, wild

DRAGGED = replace(ROBOT, drag=2e-4)
BARE, FREE = OutputError(terms=(), workers=1), OutputError(workers=1)


@pytest.fixture(scope="module")
def data():
    logs = wild(DRAGGED, (*MASSES, *MASSES), duration=6.0)
    return DataSet.of(noisy(logs, 1e-4, np.random.default_rng(0)))


SHARES = (1.0, 1.2, 0.9, 1.3, 0.8, 1.1)


@pytest.fixture(scope="module")
def scattering():
    """Logs of which each has a friction of its own."""
    masses, logs = (*MASSES, *MASSES), []
    for number, share in enumerate(SHARES):
        robot = replace(ROBOT, coulomb=share * ROBOT.coulomb, p2=share * ROBOT.p2)
        logs.append(wild(robot, masses, duration=6.0)[number])
    return DataSet.of(noisy(logs, 1e-4, np.random.default_rng(1)))


@pytest.fixture(scope="module")
def begun(data):
    return BARE.fit(data)


def test_a_fit_ends_where_no_step_makes_the_errors_smaller(begun):
    problem, fit = begun
    assert fit.converged
    assert fit.linearisation.names == problem.labels
    about = problem.with_scaled_prior(problem.equations(fit.values))
    step = about.step(*problem.box.about(fit.values, np.inf))
    assert about.decrease(step) < 1e-4 * about.cost


def test_the_choice_adds_what_the_joint_has_and_leaves_less(data, begun):
    problem, first = FREE.fit(data)
    problem, fit = FREE.choose(problem, first)
    assert fit.path[-1] == ("drag",)
    assert fit.named["drag"] == pytest.approx(DRAGGED.drag, rel=0.05)
    assert fit.cost < 0.5 * begun[1].cost
    assert not fit.missing


def test_of_given_terms_the_choice_says_what_is_missing_and_what_it_would_give(begun):
    problem, fit = BARE.choose(*begun)
    assert fit.linearisation.names == begun[1].linearisation.names
    best = fit.missing[0]
    assert best.name == "drag"
    assert best.share > 0.5
    assert best.values["drag"] == pytest.approx(DRAGGED.drag, rel=0.3)
    estimate = BARE.infer(problem, fit)
    for name, value in best.values.items():
        if name in estimate.names:
            lower, upper = estimate.limits_of(name, value)
            assert lower <= value <= upper


def test_nothing_is_offered_where_there_are_no_rows(begun):
    problem, fit = begun
    assert choose(problem, fit, (), ()) is fit


def test_logs_that_differ_in_friction_are_weighed_by_it(scattering):
    problem, fit = BARE.fit(scattering)
    found = BARE.weigh(problem, fit)
    (scatter,) = [each for each in found.findings if each.kind is FindingKind.SCATTER]
    assert scatter.parameters == ("p2", "coulomb")
    assert found.scatter.friction == pytest.approx(np.std(SHARES), rel=0.3)
    assert found.plain.linearisation is fit.linearisation
    rows, residuals = found.linearisation.stack
    assert residuals.shape == rows.shape[:2]
    truth = np.array([getattr(ROBOT, name) for name in ("p1", "p3", "p4")])
    before, after = ([each.named[n] for n in ("p1", "p3", "p4")] for each in (fit, found))
    assert np.abs(after / truth - 1).max() < np.abs(before / truth - 1).max()


def test_of_few_logs_no_scatter_can_be_told(data):
    problem, fit = BARE.fit(data.take([0, 1, 2]))
    assert weigh_by_scatter(problem, fit) is fit


def test_the_whole_is_its_steps(data):
    problem, fit = FREE.choose(*FREE.fit(data))
    found, whole = FREE.infer(problem, FREE.weigh(problem, fit)), FREE(data)
    assert found.named == whole.named
    np.testing.assert_array_equal(found.lower, whole.lower)


@pytest.mark.parametrize("count", [1, 2])
def test_a_quarter_of_the_logs_that_are_not_followed_make_it_use_with_care(data, count):
    found = identify(data, BARE)
    lost = [replace(log, angle=-log.angle) for log in data.logs[:count]]
    some = DataSet.of([*lost, *data.logs[count:]])
    run = simulated(some, found.estimate)
    sure = diagnose(some, BARE, run.estimate, residuals_of(some, run.estimate, run.runs))
    said = [finding for finding in sure.findings if finding.kind is FindingKind.LOGS_LOST]
    assert [finding.logs for finding in said] == [tuple(log.name for log in lost)] * (count > 1)
    assert FindingKind.POOR_FIT not in {finding.kind for finding in sure.findings}
    assert all(finding.doubts for finding in said)
