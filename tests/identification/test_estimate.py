"""An estimate: what its limits rest on, whatever the order, and that JSON keeps it whole."""

import json
from dataclasses import replace
from itertools import permutations

import hypothesis
import hypothesis.extra.numpy
import numpy as np
import pytest
from hypothesis import strategies as st

from butterfly.identification.estimate import Estimate
from butterfly.identification.fit import MissingTerms
from butterfly.identification.limits import Rival
from butterfly.identification.trust import Ending
from butterfly.logs.log import InputKind
from butterfly.model.parameters import AddedMass
from butterfly.model.prior import Prior
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


NUMBERS = st.just(0.0) | st.floats(1e-60, 1e60) | st.floats(-1e60, -1e-60)
MASSES = st.builds(AddedMass, mass=st.floats(0.01, 1), arm=st.floats(0.01, 1))
FOUR = hypothesis.extra.numpy.arrays(np.float64, 4, elements=NUMBERS)
RIVALS = st.builds(Rival, FOUR, st.none() | FOUR, st.booleans())


@hypothesis.given(
    st.fixed_dictionaries(
        {
            "values": FOUR,
            "lower": FOUR,
            "upper": FOUR,
            "left_out": st.dictionaries(MASSES | st.text(), FOUR, max_size=2),
            "rivals": st.lists(RIVALS, max_size=2).map(tuple),
            "condition": NUMBERS | st.just(np.nan),
            "bias": st.none() | FOUR,
            "least": st.none() | FOUR | st.just(np.full(4, -np.inf)),
            "resonances": st.dictionaries(MASSES, NUMBERS, max_size=2),
            "local": st.dictionaries(
                st.none() | st.text() | MASSES, st.dictionaries(st.text(), NUMBERS), max_size=2
            ),
            "horizon": st.none() | st.just(np.inf) | NUMBERS,
            "known": st.dictionaries(st.just("drag"), st.floats(0.01, 9)).map(Prior.of),
            "fixed": st.dictionaries(st.sampled_from(["drag", "load"]), NUMBERS),
            "ending": st.sampled_from(Ending),
            "input_kind": st.none() | st.sampled_from(InputKind),
        }
    )
)
def test_every_number_comes_back_from_json_as_it_was(fields):
    found = replace(FOUND, freedom=np.full(4, 7.0), **fields)
    again = Estimate.from_dict(json.loads(json.dumps(found.to_dict())))
    for name in FOUND.__dataclass_fields__:
        if name in {"values", "lower", "upper"} and found.open:
            continue  # of an open parameter a document has limits alone
        _assert_same(getattr(again, name), getattr(found, name))


def _assert_same(again, before):
    """Numbers to the last bit, whatever holds them."""
    if isinstance(before, Rival | MissingTerms):
        again, before = vars(again), vars(before)
    if isinstance(before, dict):
        assert {*map(str, again)} == {*map(str, before)}
        again, before = [*again.values()], [*before.values()]
    if isinstance(before, list | tuple):
        assert len(again) == len(before)
        for one, other in zip(again, before, strict=True):
            _assert_same(one, other)
    elif isinstance(before, np.ndarray | float):
        np.testing.assert_array_equal(again, before)
    else:
        assert again == before
