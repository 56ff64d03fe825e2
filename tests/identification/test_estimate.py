"""An estimate: what its limits rest on, whatever the order, and that JSON keeps it whole."""

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest

from butterfly.identification.estimate import Estimate
from butterfly.identification.limits import Rival
from tests.identification.simulated import estimate_of

NAMES = ("p1", "p2", "p3", "p4")
VALUES = np.array([3e-3, 1e-3, 0.04, 0.5])
FOUND = estimate_of(VALUES, np.diag((1e-3 * VALUES) ** 2))


def test_rivals_widen_by_their_distance_to_either_side_whatever_their_order():
    near, far = Rival(1.02 * VALUES), Rival(0.9 * VALUES, 1e-3 * VALUES)
    limits = []
    for rivals in permutations([near, far, near]):
        found = replace(FOUND, freedom=np.full(4, np.inf))
        for rival in rivals:
            found = found.with_evidence(rival)
        limits.append((found.lower, found.upper))
    np.testing.assert_allclose(limits, np.broadcast_to(limits[0], np.shape(limits)), rtol=1e-12)
    np.testing.assert_allclose(limits[0][1] - VALUES, (0.1 + 1e-3) * VALUES, rtol=1e-9)


def test_an_error_of_the_simulator_adds_in_squares_and_says_so():
    found = replace(FOUND, freedom=np.full(4, np.inf))
    rests = found.resting_on(2e-3 * VALUES)
    assert rests.findings[-1].kind == "plant"
    widths = (rests.upper - VALUES) / VALUES
    np.testing.assert_allclose(widths, 1.96 * np.hypot(1e-3, 2e-3), rtol=1e-3)


def test_json_keeps_all_that_limits_rest_on():
    found = replace(FOUND, freedom=np.full(4, 7.0)).with_evidence(Rival(1.01 * VALUES))
    again = Estimate.from_dict(found.to_dict())
    np.testing.assert_array_equal(again.lower, found.lower)
    np.testing.assert_array_equal(again.evidence.half_widths, found.evidence.half_widths)
    assert again.names == NAMES
    assert again.level is found.level


def test_a_covariance_that_is_0_but_for_rounding_is_symmetric_and_a_damaged_one_is_not():
    content, matrix = FOUND.to_dict(), FOUND.covariance.tolist()
    first, second = np.sqrt(np.diag(FOUND.covariance))[:2]
    matrix[0][1], matrix[1][0] = 3e-16 * first * second, -2e-16 * first * second
    content["covariance"]["matrix"] = matrix
    assert Estimate.from_dict(content).covariance[0, 1] == matrix[0][1]
    matrix[0][1] = 1e-3 * first * second
    with pytest.raises(ValueError, match="not symmetric"):
        Estimate.from_dict(content)


@pytest.mark.parametrize("key", ["parameters", "covariance", "method"])
def test_a_damaged_estimate_is_no_estimate(key):
    content = {name: value for name, value in FOUND.to_dict().items() if name != key}
    with pytest.raises((KeyError, TypeError, ValueError)):
        Estimate.from_dict(content)
