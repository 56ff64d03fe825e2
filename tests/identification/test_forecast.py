"""What `inspect` says before a fit of the parameters that logs can tell."""

from dataclasses import replace

import numpy as np
import pytest

from butterfly.identification.data import DataSet
from butterfly.identification.estimators import DEFAULT_ESTIMATOR
from butterfly.identification.forecast import Identifiability, expected, forecast
from butterfly.identification.simulation import Simulation
from butterfly.logs.log import InputKind
from butterfly.model.parameters import LumpedParameters
from butterfly.model.prior import NO_PRIOR, Known, Prior
from butterfly.model.terms import PARAMETERS
from butterfly.report.parameter_table import forecast_rows
from tests.benchmarks.before_fit import SETS, Row, report, scored
from tests.independent.defects import draw


@pytest.fixture(scope="module")
def robot():
    return draw("control", 2)


def _words(rows):
    return {each.name: each.word for each in rows}


def test_logs_with_three_masses_tell_every_parameter(robot):
    rows = forecast(robot.logs, NO_PRIOR)
    assert [each.name for each in rows] == [*PARAMETERS]
    assert {*_words(rows).values()} == {Identifiability.IDENTIFIABLE}
    for each in rows:
        assert 0 < each.expected <= 0.1
        assert (each.why, each.mend) == ("", "")
    assert rows[0].half_width / robot.truth["p1"] == pytest.approx(rows[0].expected, rel=0.2)


def test_a_forecast_is_of_the_fit_that_identify_begins_with(robot):
    data = DataSet.of(robot.logs)
    _, fit = DEFAULT_ESTIMATOR().fit(data)
    estimate = expected(data)
    assert estimate.named.items() >= {n: fit.named[n] for n in estimate.names}.items()


def test_a_gravity_moment_small_beside_the_drive_needs_nothing_if_it_is_0(robot):
    truth = {name: robot.truth[name] for name in PARAMETERS} | {"p3": 0.0}
    balanced, rng = LumpedParameters(**truth), np.random.default_rng(1)
    logs = []
    for log in robot.logs:
        started = replace(log, angle=0 * log.time, zero=Known(value=0.0))
        angle = Simulation(started, balanced).run(balanced, 0.0).at(log.time)
        logs.append(replace(started, angle=angle + 1e-3 * rng.standard_normal(angle.size)))
    (row,) = (row for row in forecast(logs, NO_PRIOR) if row.name == "p3")
    assert row.word is Identifiability.NOT
    assert (row.why, row.mend) == ("it may be 0", "none needed if it is 0")


def test_a_term_that_logs_cannot_tell_leaves_what_is_said_of_others(robot):
    first = robot.logs[0]
    bump = 3 * np.sin(np.pi * np.clip((first.time - first.time[0] - 3) / 3, 0, 1))
    logs = [*robot.logs, replace(first, name="pushed", angle=first.angle + bump)]
    assert {row.word for row in forecast(logs, NO_PRIOR)} - {Identifiability.NOT}


def test_logs_with_one_mass_ask_for_another_or_a_known_value_and_use_it(robot):
    bare = [log for log in robot.logs if not log.added_mass.mass]
    rows = forecast(bare, NO_PRIOR)
    assert {*_words(rows).values()} == {Identifiability.NOT}
    assert all("no log has an added mass" in each.why for each in rows)
    assert all("manifest" in each.mend and "--known p4=" in each.mend for each in rows)
    told = forecast(bare, Prior.of({"p4": robot.truth["p4"]}))
    assert _words(told) == dict.fromkeys(PARAMETERS, Identifiability.IDENTIFIABLE) | {
        "p4": Identifiability.KNOWN
    }


def test_the_table_is_for_what_is_told_beside_given_values(robot):
    given = Prior.of({"delay": 0.0})
    refused = forecast([log for log in robot.logs if not log.added_mass.mass], given)
    assert {*_words(refused).values()} == {Identifiability.KNOWN, Identifiability.NOT}
    assert forecast_rows(refused) == []
    weak = replace(refused[0], word=Identifiability.NOT, half_width=1.0, mend="a larger motion")
    assert forecast_rows([weak])[0][2:] == ("not identifiable", "over 100 %", "a larger motion")


def test_noise_ten_times_the_motion_hides_parameters_and_says_that_the_motion_is_small(robot):
    rng = np.random.default_rng(3)
    hidden = [
        replace(log, angle=log.angle + 10 * np.std(log.angle) * rng.standard_normal(log.angle.size))
        for log in robot.logs
    ]
    rows = forecast(hidden, NO_PRIOR)
    assert Identifiability.IDENTIFIABLE not in {each.word for each in rows if each.name != "delay"}
    assert all(each.why and each.mend for each in rows if each.name != "delay")


def test_joints_that_only_fall_say_what_no_input_tells(robot):
    idle = [
        replace(log, input=np.zeros_like(log.input), input_kind=InputKind.NONE, excitation=None)
        for log in robot.logs
    ]
    rows = {each.name: each for each in forecast(idle, NO_PRIOR)}
    for name in ("p4", "delay"):
        assert rows[name].word is Identifiability.NOT
    assert forecast([], NO_PRIOR) == ()


def test_friction_needs_motion_both_ways(robot):
    one_way = [
        replace(log, angle=np.cumsum(abs(np.diff(log.angle, prepend=0.0)))) for log in robot.logs
    ]
    rows = {each.name: each for each in forecast(one_way, NO_PRIOR)}
    assert rows["coulomb"].word in {Identifiability.WEAK, Identifiability.NOT}
    drawn = scored("no reversal", 0, 5)
    assert _words(drawn) == dict.fromkeys(_words(drawn), Identifiability.IDENTIFIABLE) | {
        "coulomb": Identifiability.WEAK
    }


@pytest.mark.parametrize(
    ("kind", "number", "known"),
    [("no reversal", 0, ["p3"]), ("free decays, drive known", 1, ["p4", "delay"])],
)
def test_a_term_that_these_logs_cannot_tell_hides_no_parameter(kind, number, known):
    rng = np.random.default_rng([68, [*SETS].index(kind), number])
    data, _ = SETS[kind](rng)
    rows = forecast(data.recorded, data.given)
    words = dict.fromkeys(PARAMETERS, Identifiability.IDENTIFIABLE)
    words |= {"coulomb": Identifiability.WEAK}
    words |= dict.fromkeys(known, Identifiability.KNOWN)
    assert _words(rows) == words
    assert {each.name for each in rows if each.why} == {"coulomb"}


def test_the_count_of_forecasts_that_came_true_scores_a_set_and_lists_what_was_wrong():
    rows = scored("one mass, gain known", 0, 5)
    assert {each.word for each in rows} == {Identifiability.IDENTIFIABLE}
    assert all(each.below and each.error < 0.1 for each in rows)
    wrong = Row("p2", "some 1", Identifiability.NOT, 0.02, 0.01)
    text = report([*rows, wrong])
    assert "some 1: p2 not identifiable, ends ± 2 %, off by 1 %" in text
    assert "| all | 5 (0) | 0 (0) | 0 (0) | 0 (0) | 1 (0) | 0 (0) |" in text
