"""A search ends when its time is over and says what it left out; in time it changes nothing."""

import subprocess
import sys
import time
from dataclasses import replace

import numba
import numpy as np
import pytest

import butterfly as bf
from butterfly import progress
from butterfly.identification.data import DataSet
from butterfly.identification.estimators import HarmonicBalance, Linear, OutputError, WeakForm
from butterfly.identification.estimators.start import starts
from butterfly.identification.identify import judged
from butterfly.identification.predict import LEAST, draw_parameters, predict_logs
from butterfly.identification.problem import Problem
from butterfly.identification.trust import Ending, Finding, FindingKind
from butterfly.identification.validate import bootstrap, cross_validate, select_terms
from butterfly.progress import budget, current_search, in_threads, untracked
from butterfly.verdict import Level
from tests.conftest import MASSES
from tests.identification.simulated import ROBOT, SWINGS, next_runs, steady

STOPPED = "Search stopped after 0 s. Skipped: "


@pytest.fixture(scope="module")
def data():
    logs = steady(ROBOT, dict(list(SWINGS.items())[::2]), duration=12.0)
    rows = np.arange(0, 2400, 2)
    return DataSet.of([replace(log.take(rows), name=f"{k}") for k, log in enumerate(logs)])


@pytest.mark.slow
def test_with_time_to_spare_an_answer_is_the_same_to_the_last_digit(data):
    _, plain = judged(data, OutputError())
    with budget(1e9) as search:
        _, same = judged(data, OutputError())
    assert same.to_dict() == plain.to_dict()
    assert not search.left_out
    assert search.simulations > 0


def test_an_estimate_that_was_not_searched_to_the_end_says_so_and_is_not_good(data):
    with budget(0.0):
        found = bf.identify(data, "output-error")
    (stopped,) = [e for e in found.estimate.findings if e.kind is FindingKind.SEARCH_STOPPED]
    assert stopped.parameters[0] == "iterations of a fit that had not converged"
    assert "the selection of terms" in stopped.parameters
    assert found.estimate.ending is Ending.STOPPED
    assert found.estimate.level is Level.CARE
    assert "did not converge" not in str(found)
    assert STOPPED in found.verdict[0]
    again = bf.Identification.from_dict(found.to_dict())
    assert again.verdict == found.verdict


def test_the_work_of_an_identification_is_counted_and_ends_at_its_most(data, monkeypatch):
    monkeypatch.setattr("butterfly.progress.SIMULATIONS", 6)
    few, again = (bf.identify(data, "output-error", workers=count) for count in (1, 4))
    assert few.standing == "use with care"
    assert "Search stopped after 6 simulations of all logs" in few.verdict[0]
    assert few.estimate.to_dict() == again.estimate.to_dict()
    assert not current_search().left_out
    monkeypatch.setattr("butterfly.progress.STEPS", 1)
    one = bf.identify(data, "output-error")
    assert one.standing == "use with care"
    truth = np.array([getattr(ROBOT, name) for name in one.estimate.names])
    assert np.mean((one.estimate.lower <= truth) & (truth <= one.estimate.upper)) > 0.8


def test_an_answer_is_the_same_beside_busy_processes_and_with_any_number_of_threads(data):
    """Nothing of it depends on the clock on the wall."""
    alone = bf.identify(data, "output-error", workers=1).to_dict()
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(2)]
    try:
        beside = bf.identify(data, "output-error", workers=4).to_dict()
    finally:
        for each in busy:
            each.kill()
            each.wait()
    for each in (alone, beside):
        each["chosen"]["options"].pop("workers")
    assert beside == alone
    assert not {"date", "seconds"} & {*alone}


def test_a_settled_estimate_whose_search_was_stopped_is_to_be_used_with_care(data):
    with budget(0.0) as search:
        search.left_out.append("something of another estimate")
        _, found = judged(data, WeakForm(terms=()))
    assert found.level is Level.GOOD
    assert found.with_findings(Finding(FindingKind.SEARCH_STOPPED, ("terms",))).level is Level.CARE


def test_what_is_tried_one_after_the_other_is_left_out_and_said(data):
    balance = HarmonicBalance(terms=())
    with budget(0.0) as search:
        held = cross_validate(data, balance)
        drawn = bootstrap(data, Linear(), Linear()(data), repetitions=100)
        passed = select_terms(data, OutputError(), ("drag", "bias"))
        answer = bf.validate(data, "linear")
    assert len(held.estimates) == 1
    assert np.isnan(held.fits).any()
    assert len(drawn.values) == 20
    assert [each.terms for each in passed] == [()]
    for part in ("parts of the cross-validation", "repetitions", "the selection of terms"):
        assert any(part in each for each in search.left_out)
    assert sum(STOPPED in line for line in answer.summary) == 1


def test_a_band_is_made_of_the_draws_for_which_there_was_time(data):
    estimate, logs = HarmonicBalance(terms=())(data), data.logs[:1]
    drawn = draw_parameters(estimate, 100)
    first = replace(drawn, values=drawn.values[:LEAST])
    (expected,) = predict_logs(logs, estimate, data.simulations.setting, draws=first)
    with budget(0.0) as search:
        (stopped,) = predict_logs(logs, estimate, data.simulations.setting, draws=drawn)
    assert search.left_out == ["some of the draws"]
    for one, other in zip(expected.bands.values(), stopped.bands.values(), strict=True):
        np.testing.assert_array_equal(one.upper, other.upper)


def test_candidates_of_further_masses_are_left_out_when_time_is_over(data):
    estimate = HarmonicBalance(terms=())(data)
    with budget(0.0) as search:
        ranked = next_runs(data, estimate)
    assert {each.recipe.log.added_mass for each in ranked} == {MASSES[0]}
    assert search.left_out == ["candidates with some of the added masses"]


def test_threads_search_for_as_long_as_what_began_them():
    with budget(0.0):
        assert in_threads(lambda _: current_search().over, [1, 2], untracked, "") == [True, True]
    assert not current_search().over


@pytest.mark.parametrize("workers", [1, 2])
def test_a_trial_that_costs_too_much_stops_at_its_first_logs(data, monkeypatch, workers):
    start = OutputError(terms=(), horizon=np.inf, workers=workers)
    first = starts(data, ())[0]
    problem = start.problem(data.logs, first)
    away = problem.initial * 1.5
    count = len(data.logs)
    simulated = []
    for each in {type(each) for each in problem.simulations}:
        linearised = each.linearised

        def counted(self, *arguments, linearised=linearised):
            simulated.append(self)
            time.sleep(0.01)  # in which whoever counts the costs has a turn, on a busy machine too
            return linearised(self, *arguments)

        monkeypatch.setattr(each, "linearised", counted)
    whole = problem.equations(away)
    assert len(simulated) == count
    simulated.clear()
    stopped = problem.equations(away, most=0.01 * whole.cost)
    assert not stopped.is_finite
    assert len(simulated) < count
    anew = start.problem(data.logs, first)  # starts of logs are sought from the last ones
    assert anew.equations(away, most=2 * whole.cost).cost == whole.cost


@pytest.mark.slow
def test_a_descent_goes_the_same_way_whether_dear_trials_stop_or_not(data, monkeypatch):
    estimator = OutputError(terms=("drag",), workers=1)
    found = estimator(data)
    equations = Problem.equations
    monkeypatch.setattr(
        Problem, "equations", lambda self, at, near=None, **_: equations(self, at, near)
    )
    assert estimator(data).values.tolist() == found.values.tolist()


def test_compiling_takes_nothing_of_the_time_to_search():
    with budget(60.0) as search:
        begun = search.begun
        numba.njit(lambda x: x + 1)(1)
    assert search.begun > begun


def test_a_long_phase_is_told_once_and_a_short_one_not(monkeypatch):
    lines = []
    monkeypatch.setattr(progress, "tell", lines.append)
    monkeypatch.setattr(progress, "SILENT", 0.02)
    with progress.phase("Identifying"):
        time.sleep(0.2)
    assert lines == ["Identifying …"]
    monkeypatch.setattr(progress, "SILENT", 10.0)
    with progress.phase("Simulating"):
        pass
    assert lines == ["Identifying …"]


def _in_line(items, description):
    with progress.phase(description):
        yield from items


def test_a_phase_that_an_error_ended_is_not_told_later(monkeypatch):
    lines = []
    monkeypatch.setattr(progress, "tell", lines.append)
    monkeypatch.setattr(progress, "SILENT", 0.05)
    with pytest.raises(ZeroDivisionError) as kept:
        progress.tracked(_in_line, "Fitting", lambda: 1 / 0)
    time.sleep(0.2)
    assert (lines, kept.type) == ([], ZeroDivisionError)


def test_at_the_end_of_a_command_no_phase_is_told_though_an_error_left_it_open(monkeypatch):
    lines = []
    monkeypatch.setattr(progress, "tell", lines.append)
    monkeypatch.setattr(progress, "SILENT", 0.05)
    broken = _in_line([1], "Reading")
    next(broken)
    progress.end_phases()
    time.sleep(0.2)
    assert not lines
    broken.close()
