"""Ranges of one unit are its intervals, those of several hold 95 % of all units."""

import math
from dataclasses import replace
from statistics import NormalDist

import numpy as np
import pytest

from butterfly.errors import InputError
from butterfly.logs.log import InputKind
from butterfly.model.servo import ServoLoop
from butterfly.twin.randomisation import Range, ranges_of, tolerance_factor
from tests.twin.moving import twin
from tests.twin.units import estimated, unit_of_product

EXACT = {2: 37.674, 3: 9.916, 5: 5.079, 10: 3.379, 30: 2.549, 100: 2.233}
"""Two-sided factors for 95 % of a normal population, with confidence 95 % (ISO 16269-6)."""


def _by_attribute(*units):
    return {each.attribute: each for each in ranges_of(units)}


@pytest.mark.parametrize(("units", "exact"), EXACT.items())
def test_the_factor_is_that_of_tables_within_two_per_cent_and_not_less(units, exact):
    assert exact - 5e-4 <= tolerance_factor(units) <= 1.02 * exact


def test_of_many_products_the_range_holds_95_per_cent_of_units_in_95_per_cent():
    drawn = np.random.default_rng(0).standard_normal((4000, 4))
    half = tolerance_factor(4) * drawn.std(axis=1, ddof=1)
    held = [
        NormalDist().cdf(mean + some) - NormalDist().cdf(mean - some)
        for mean, some in zip(drawn.mean(axis=1), half, strict=True)
    ]
    assert np.mean(np.array(held) >= 0.95) == pytest.approx(0.95, abs=0.01)


def test_a_range_of_one_unit_is_its_interval():
    ranges = _by_attribute(estimated(twin("motor"), p2=3e-4, p4=1e-3))
    assert ranges["damping"].ends == pytest.approx((1.7e-3, 2.3e-3))
    assert ranges["gain"].ends == pytest.approx((0.039, 0.041))
    assert ranges["frictionloss"].ends == pytest.approx((2e-3, 2e-3))  # which is exact
    assert not ranges["frictionloss"].varies
    inertia = ranges["inertia_about_axis"]
    assert inertia.row.value == pytest.approx(0.003 + 0.05 * 0.1**2)  # with what it carries
    assert ranges["damping"].numbers() == {
        "element": "joint",
        "name": "hinge",
        "attribute": "damping",
        "unit": "N m s/rad",
        "value": 0.002,
        "lower": 0.0017,
        "upper": 0.0023,
    }


def test_two_units_by_hand():
    """Values 2 and 4: mean 3, deviation sqrt(2); factor sqrt(3.8415 * 1.5 / 0.0039321) = 38.28."""
    row = _by_attribute(unit_of_product(p2=2e-3), unit_of_product(p2=4e-3))["damping"]
    assert row.row.value == pytest.approx(3e-3)
    assert row.deviation == pytest.approx(math.sqrt(2) * 1e-3)
    assert row.half_width == pytest.approx(38.28 * math.sqrt(2) * 1e-3, rel=1e-4)
    assert row.ends == pytest.approx((0.0, 3e-3 + 38.28 * math.sqrt(2) * 1e-3), rel=1e-4)
    assert row.numbers()["deviation"] == 0.00141421


def test_the_gains_of_a_loop_and_its_effort_are_as_uncertain_as_p4():
    loop = ServoLoop.of({"law": "pid-torque", "kp": 3.0, "kd": 0.2, "limit": 5.0})
    driven = twin(servo=loop, kind=InputKind.TORQUE)
    ranges = _by_attribute(estimated(driven, p4=4e-3))
    assert ranges["kp"].ends == pytest.approx((0.108, 0.132))
    assert ranges["kv"].ends == pytest.approx((7.2e-3, 8.8e-3))
    assert ranges["effort"].ends == pytest.approx((0.18, 0.22))


def test_a_delay_is_a_range_too_and_what_is_unknown_has_no_ends():
    ranges = _by_attribute(estimated(twin("delayed"), delay=1e-3, p3=math.inf))
    assert ranges["delay"].ends == pytest.approx((2.1e-3, 4.1e-3))
    assert ranges["gravity_moment"].ends is None
    assert ranges["gravity_moment"].numbers()["lower"] is None


def test_nothing_is_less_than_0_but_a_gain():
    (row,) = (each for each in ranges_of((twin(),)) if each.attribute == "damping")
    assert Range(row=row.row, half_width=1.0).ends[0] == 0.0
    gain = replace(row.row, attribute="gain")
    assert Range(row=gain, half_width=1.0).ends[0] < 0.0


@pytest.mark.parametrize(
    ("other", "said"),
    [
        (twin("slide"), "units of one joint"),
        (twin(kind=InputKind.CURRENT), "same kind of input"),
        (unit_of_product(), "each unit once"),
    ],
    ids=["slide", "current", "twice"],
)
def test_units_of_other_joints_and_the_same_one_twice_are_refused(other, said):
    with pytest.raises(InputError, match=said):
        ranges_of((unit_of_product(), other))
