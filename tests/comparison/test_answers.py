"""Whether a robot has changed between two identifications."""

from dataclasses import replace

import numpy as np
import pytest

from butterfly.comparison.answers import LEVEL, change
from butterfly.errors import InputError
from butterfly.identification.limits import (
    Evidence,
    cluster_covariance,
    half_widths,
)
from butterfly.model.prior import Prior
from tests.identification.simulated import estimate_of

NAMES = ("p1", "p2", "p3", "p4", "coulomb", "delay")
TRUTH = np.array([0.003, 0.001, 0.05, 0.5, 0.001, 0.002])
ERRORS = 0.02 * TRUTH


def estimate(values, covariance, freedom=None, *, names=NAMES, left_out=()):
    """Return an estimate with the intervals that its errors make."""
    free = np.full(len(names), np.inf) if freedom is None else freedom
    half = half_widths(covariance, np.minimum(free, 1e9))
    half = Evidence(values=values, half=half, least=-half, left_out=left_out).half_widths
    limits = {"lower": values - half, "upper": values + half}
    limits["left_out"] = dict(enumerate(left_out))
    return replace(estimate_of(values, covariance, names=names), **limits, freedom=freedom)


def drawn(rng, covariance, truth=TRUTH, freedom=None):
    return estimate(rng.multivariate_normal(truth, covariance), covariance, freedom)


def of_scale(share):
    """Return a covariance of which all torques share most, as their scale is known worst."""
    common = np.array([1.0, 1.0, 1.0, 1.0, 1.0, 0.0])
    correlation = (1 - share) * np.eye(6) + share * np.outer(common, common)
    correlation[5, 5] = 1.0
    return correlation * np.outer(ERRORS, ERRORS)


@pytest.mark.parametrize("share", [0.0, 0.95])
def test_a_robot_that_has_not_changed_is_seldom_said_to_have(share):
    rng, covariance, count = np.random.default_rng(1), of_scale(share), 150
    found = [change(drawn(rng, covariance), drawn(rng, covariance)) for _ in range(count)]
    alarms = sum(bool(each.changed) or each.jointly_changed for each in found)
    spread = np.sqrt(LEVEL * (1 - LEVEL) * count)
    assert 0.02 * count < alarms < LEVEL * count + 2 * spread
    assert sum(each.jointly_changed for each in found) == pytest.approx(
        LEVEL / 2 * count, abs=2 * spread
    )


def test_errors_that_are_estimated_from_few_logs_raise_no_more_alarms():
    rng = np.random.default_rng(2)

    def identified():
        rows = rng.standard_normal((12, 4, 6)) @ (np.eye(6) + 0.8)
        noise = 0.1 * (rng.standard_normal((12, 4)) + rng.standard_normal((12, 1)))
        target = rows.sum(axis=2) + noise
        values = np.linalg.lstsq(rows.reshape(-1, 6), target.ravel(), rcond=None)[0]
        return estimate(values, *cluster_covariance(rows, target - rows @ values))

    found = [change(identified(), identified()) for _ in range(100)]
    assert np.mean([bool(each.changed) or each.jointly_changed for each in found]) <= LEVEL


def test_a_change_as_large_as_is_said_to_be_detectable_is_found_four_times_in_five():
    rng, covariance = np.random.default_rng(3), of_scale(0.0)
    least = change(drawn(rng, covariance), drawn(rng, covariance)).parameters[4].detectable
    moved = TRUTH + np.array([0, 0, 0, 0, least, 0])
    found = [change(drawn(rng, covariance), drawn(rng, covariance, moved)) for _ in range(200)]
    named = [{each.name for each in one.changed} for one in found]
    assert np.mean(["coulomb" in each for each in named]) == pytest.approx(0.8, abs=0.08)


def test_a_ratio_that_is_known_better_than_the_scale_tells_of_a_change():
    rng, covariance = np.random.default_rng(4), of_scale(0.999)
    heavier = TRUTH * np.array([1, 1, 1.02, 1, 1, 1])
    found = change(drawn(rng, covariance), drawn(rng, covariance, heavier))
    assert not found.changed
    assert found.jointly_changed
    assert found.ratio.name == "p3/p1"
    assert found.ratio.relative == pytest.approx(0.02, abs=0.005)


def test_what_widens_an_interval_widens_the_error_of_a_difference():
    covariance = np.diag(ERRORS**2)
    apart = TRUTH + np.array([0, 0, 10, 0, 0, 0]) * ERRORS
    wide = estimate(TRUTH, covariance, left_out=[apart])
    errors = {
        each.name: each.error for each in change(wide, estimate(TRUTH, covariance)).parameters
    }
    assert errors["p1"] == pytest.approx(np.sqrt(2) * ERRORS[0], rel=1e-6)
    assert errors["p3"] > 5 * ERRORS[2]


def test_student_counts_where_logs_are_few():
    covariance = np.diag(ERRORS**2)
    moved = TRUTH + 4.5 * ERRORS
    few, many = (
        [estimate(values, covariance, np.full(6, freedom)) for values in (TRUTH, moved)]
        for freedom in (4.0, 400.0)
    )
    assert not change(*few).changed
    assert len(change(*many).changed) == 6
    assert change(*few).parameters[0].freedom == pytest.approx(8)


def test_what_was_known_or_fitted_once_is_no_evidence():
    covariance = np.diag(ERRORS**2)
    plain = estimate(TRUTH, covariance)
    told = replace(plain, known=Prior.of({"p4": (0.5, 0.01)}))
    assert "given in both" in change(told, told).untested["p4"]
    assert "p4" not in change(told, plain).untested
    vague = replace(plain, known=Prior.of({"p4": (0.5, 0.05)}))
    assert "p4" not in change(vague, vague).untested
    names = (*NAMES[:5], "drag")
    other = estimate(TRUTH, covariance, names=names)
    assert change(plain, other).untested == {
        "delay": "fitted only in the first",
        "drag": "fitted only in the second",
    }
    held = replace(other, fixed={"delay": 0.002})
    assert change(plain, held).untested["delay"] == "fixed in the second"
    nothing = replace(plain, covariance=np.full((6, 6), np.nan))
    with pytest.raises(InputError, match="no common parameter"):
        change(plain, nothing)
