"""Terms that the independent integrator's joints have are found unasked, at their size.

A joint of the program stands beside none of these: dead zones are of the command, springs and
inertias of the integrator, and friction that differs by direction of a time stepping written here.
"""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from butterfly.api.verbs import identify
from butterfly.identification.agreement import Condition
from butterfly.identification.data import DataSet
from butterfly.identification.estimators import OutputError
from butterfly.model.greybox import simulate
from butterfly.model.parameters import LumpedParameters
from tests.independent import defects

CHOOSING = OutputError(workers=1)
SEED, NUMBER = 31, 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("row", "term", "size"),
    [
        ("own inertia", "mass_inertia", 0.05),
        ("dead zone", "dead_zone", None),
        ("base", "base_compliance", None),
    ],
)
def test_a_term_that_a_bench_has_is_found_unasked(row, term, size):
    robot = defects.draw(row, NUMBER, SEED)
    found = CHOOSING(DataSet.of(robot.logs))
    for name, truth in (robot.truth | ({term: size} if size else {})).items():
        if name in ("p1", "p3", "p4", term):
            assert found.parameters.terms().get(name, getattr(found.parameters, name)) == (
                pytest.approx(truth, rel=0.03)
            )
    assert getattr(found.parameters, term) > 0


@pytest.mark.slow
def test_a_dead_zone_is_found_whichever_way_the_input_counts():
    logs = defects.draw("dead zone", NUMBER, SEED).logs
    turned = [replace(log, input=-log.input) for log in logs]
    found, mirrored = (CHOOSING(DataSet.of(each)) for each in (logs, turned))
    assert "dead_zone" in mirrored.names == found.names
    np.testing.assert_allclose(np.abs(mirrored.values), np.abs(found.values), rtol=1e-4)


@pytest.mark.slow
def test_friction_is_chosen_once_more_where_a_rarer_term_was_missing():
    """Without the masses' inertia Stribeck friction looked like the drag, p2 44 % off."""
    robot = defects.draw("own inertia", 0, 1117)
    found = CHOOSING(DataSet.of(robot.logs)).parameters
    for name in ("p1", "p2", "coulomb", "drag"):
        assert getattr(found, name) == pytest.approx(robot.truth[name], rel=0.01)


CAUSES = {
    "control": (None, ""),
    "backlash": (("delay", Condition.SPEED), "backlash"),
    "falling friction": (("p2", Condition.TIME), "warm-up"),
    "friction by log": (None, "Scatter between logs: p2, coulomb"),  # which is no contrast too
}


@pytest.mark.parametrize("row", CAUSES)
def test_what_a_parameter_follows_and_why_is_among_what_is_always_shown(row):
    data = DataSet.of(defects.draw(row, 0, 1117).few_logs)
    found = identify(data, OutputError(terms=("drag",), workers=1))
    followed = [(each.parameter, each.condition) for each in found.estimate.agreement]
    expected, cause = CAUSES[row]
    assert (followed or [None])[0] == expected
    assert any(cause in sentence for sentence in found.notes[:3])
    if row == "backlash":
        _assert_play(found)


def _assert_play(found):
    told = re.search(r"backlash of about (\S+) rad \((\S+)°\)", " ".join(found.notes[:3]))
    assert float(told[1]) == pytest.approx(np.radians(0.3), rel=0.3)
    assert float(told[2]) == pytest.approx(0.3, rel=0.3)


def test_backlash_is_named_with_its_size_by_free_runs_under_chirps_and_sums_of_sines():
    data = DataSet.of(defects.draw("backlash", 5).few_logs)
    _assert_play(identify(data, OutputError(terms=("drag",), workers=1)))


@pytest.mark.slow
def test_a_resistance_that_differs_from_log_to_log_is_in_the_interval_of_the_gain():
    robot = defects.draw("resistance", 1, 2203)
    found = identify(DataSet.of(robot.logs), CHOOSING)
    assert "p4 by 3.5 %" in " ".join(found.notes[:3])
    (p4,) = (row for row in found.estimate.table() if row.name == "p4")
    assert p4.lower < robot.truth["p4"] < p4.upper


@pytest.mark.slow
@pytest.mark.parametrize("number", range(3))
def test_a_spring_is_found_or_in_the_interval_of_gravity(number):
    robot = defects.draw("spring", number, SEED)
    found = identify(DataSet.of(robot.logs), CHOOSING)
    (p3,) = (row for row in found.estimate.table() if row.name == "p3")
    if "spring" in found.estimate.names:
        assert p3.value == pytest.approx(robot.truth["p3"], rel=0.01)
    else:
        assert "spring is not fitted and would move p3" in found.notes[0]
    assert p3.lower < robot.truth["p3"] < p3.upper


def test_coulomb_friction_that_differs_by_direction_is_coulomb_friction_and_a_bias():
    """By Moreau's time stepping, whose friction holds between two unequal limits."""
    inertia, gravity, forwards, backwards, step = 3e-3, 0.04, 1.2e-2, 4e-3, 2e-5
    time = np.arange(0.0, 4.0, step)
    torque = 0.03 * np.sin(2.0 * time) * np.exp(-time / 2.0)
    angle, velocity, x, v = np.empty(time.size), np.empty(time.size), 0.3, 0.0
    for k, pull in enumerate(torque.tolist()):
        angle[k], velocity[k] = x, v
        free = v + step * (pull - gravity * math.sin(x)) / inertia
        v = free - min(max(free, -step * backwards / inertia), step * forwards / inertia)
        x += step * v
    dry = {"coulomb": (forwards + backwards) / 2, "bias": -(forwards - backwards) / 2}
    same = LumpedParameters(p1=inertia, p2=0.0, p3=gravity, p4=1.0, **dry)
    coarse = time[::50].copy()
    middle = torque[25::50][: coarse.size - 1]
    inputs = np.column_stack([torque[::50][:-1], middle, torque[::50][1:]])
    found, _ = simulate(same, coarse, inputs, 0.3)
    assert np.mean(velocity == 0) > 0.1  # it sticks as well
    np.testing.assert_allclose(found, angle[::50], atol=2e-4)
