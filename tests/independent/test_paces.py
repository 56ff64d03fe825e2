"""Short runs and slow films: numbers draw them, and a few are answered with the truth inside."""

import numpy as np
import pytest

from tests.benchmarks.paces import ANSWERED, counts, score
from tests.independent.paces import KINDS, draw

SEED = 3


def test_numbers_determine_a_robot_and_what_its_owner_says():
    first, again, other = (draw("slow", 1, seed) for seed in (1, 1, 2))
    assert first.truth == again.truth != other.truth
    assert first.owner["input"] == "none"
    assert (first.main, first.asked[0]) == ("p3", "p3")
    np.testing.assert_array_equal(first.tables[0]["angle"], again.tables[0]["angle"])


@pytest.mark.parametrize("kind", KINDS)
def test_logs_have_little_time_or_few_samples_for_it(kind):
    for number in range(4):
        robot = draw(kind, number, SEED)
        time, values = robot.tables[0]["time"], robot.truth | robot.owner["known"]
        if "p3" in values:
            period = 2 * np.pi * np.sqrt(values["p1"] / values["p3"])
            few = {"short": (time[-1], 1.9, 2.1), "slow": (period, 7 * time[1], 15 * time[1])}
            length, least, most = few[kind]
            assert least < length / (period if kind == "short" else 1.0) < most
        elif kind == "short":
            assert time[-1] == pytest.approx(5 * values["p1"] / values["p2"], rel=0.05)


@pytest.mark.parametrize(("kind", "number"), [("short", 1), ("short", 2), ("slow", 3), ("slow", 4)])
def test_they_are_answered_with_the_truth_inside(kind, number):
    found = score(kind, number, "default", SEED)
    assert found.verdict in ANSWERED
    assert next(iter(found.readings.values())).covered
    assert "| 1/1 | 1/1 |" in counts([found])
    assert counts([found]).endswith("misses:")
