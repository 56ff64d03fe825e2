"""What scatter between logs hides is found once they are weighed by it, and nothing is made up."""

import pytest

import butterfly as bf
from butterfly.identification.estimators import OutputError
from butterfly.identification.inference.term_choice import RARER
from tests.independent.defects import draw


def _found(row, number):
    robot = draw(row, number, 9101)
    estimate = bf.identify(robot.logs, OutputError(workers=1)).estimate
    rows = zip(estimate.names, estimate.lower, estimate.values, estimate.upper, strict=True)
    return robot.truth, {name: limits for name, *limits in rows}


def test_a_base_and_regimes_are_found_beside_friction_that_differs_by_a_fifth():
    truth, found = _found("base, friction by log, regimes", 35)
    assert {"base_compliance", "slow_delay"} <= found.keys()
    for name in ("p1", "p3", "p4", "coulomb", "delay"):
        lower, _, upper = found[name]
        assert lower <= truth[name] <= upper, name
    lower, value, upper = found["p1"]
    assert value == pytest.approx(truth["p1"], rel=1e-3)  # 1.1 % where the base is not found
    assert upper - lower < 2e-3 * value


def test_friction_that_differs_alone_is_no_rarer_term():
    truth, found = _found("friction by log", 5)
    assert found.keys().isdisjoint(RARER)
    lower, _, upper = found["p1"]
    assert lower <= truth["p1"] <= upper
