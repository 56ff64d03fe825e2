import pytest
from hypothesis import given
from hypothesis import strategies as st

from butterfly.errors import InputError
from butterfly.model.parameters import AddedMass
from butterfly.model.prior import NO_PRIOR, Known, Prior, known_of

NUMBERS = st.floats(-1e6, 1e6, allow_nan=False)
SIZES = st.floats(0, 1e3)


@given(NUMBERS, SIZES)
def test_a_value_is_read_back_from_every_form(value, uncertainty):
    known = Known(value=value, uncertainty=uncertainty)
    texts = (f"{value!r}{sign}{uncertainty!r}" for sign in ("+-", " ± "))
    pair = {"value": value, "uncertainty": uncertainty}
    for form in (known, (value, uncertainty), pair, *texts):
        assert known_of(form) == known
    assert known_of(value) == Known(value=value)


NO_VALUES = [True, None, "one", {"valu": 1}, [1, 2, 3], float("nan"), 10**400, "1+-x"]


@pytest.mark.parametrize(
    ("told", "message"),
    [
        *(({"p4": value}, r"known.p4: got .*expected a") for value in NO_VALUES),
        ({"p5": 1}, "known.p5: got an unknown name; expected"),
        ({"p2": -1}, "known.p2: got -1; expected 0 or more"),
        ({"resistance": 0}, "known.resistance: got 0; expected a positive number"),
        ({"p4": (1, -1)}, "uncertainty: got -1; expected 0 or a positive number"),
        (["p4"], "expected a mapping"),
    ],
)
def test_slips_are_named(told, message):
    with pytest.raises(InputError, match=message):
        Prior.of(told)


def test_what_is_said_later_goes_before():
    first = Prior.of({"p4": 1, "p3": 0, "hand_mass": 0.3})
    both = first | Prior.of({"p4": (1.1, 0.1)})
    assert both.uncertain == {"p4": Known(value=1.1, uncertainty=0.1)}
    assert both.fixed == {"p3": 0.0}
    assert Prior.of(both.to_dict()) == both
    assert both.fitted(("p1", "p3")) == ("p1", "p4")
    assert (both.scale(), both.reference(), NO_PRIOR.reference()) == (("p4",), "p4", None)
    assert both.holding("p4").reference() is None


def test_a_known_mass_tells_the_scale_where_the_rest_of_its_torque_is_known():
    mass = AddedMass(mass=0.49, arm=0.1)
    assert Prior.of({"p3": 0}).scale(mass) == ("p3",)
    assert Prior.of({"p3": 0}).scale() == ()
    assert Prior.of({"p1": -mass.inertia}).scale(mass) == ()
    both = Prior.of({"p3": (0, 0.01), "p4": (1, 0.1)})  # 0.48 N m within 2 %, p4 within 10 %
    assert (both.reference(mass), both.reference()) == ("p3", "p4")


def test_what_two_know_of_a_robot_agrees():
    one, other = Prior.of({"p4": (1, 0.1)}), Prior.of({"p4": (1, 0.1), "p3": 2})
    assert one.agreeing(other, "b") == other
    with pytest.raises(InputError, match=r"b: known.p4: got 2; expected 1 ± 0.1"):
        one.agreeing(Prior.of({"p4": 2}), "b")


@pytest.mark.parametrize(
    ("told", "reference"),
    [
        ({"p4": (1, 0.1), "p3": (2, 0.1)}, "p3"),
        ({"p1": (0.003, 0.001), "p4": (1, 0.1)}, "p4"),  # of parameters of different size, by share
        ({"p4": (1, 0.1), "compression": 0.1, "load": 0.01, "delay": 0.1}, "p4"),
        ({"p4": (1, 0.1), "coulomb": 0.1}, None),
        ({"p3": (0, 0.1)}, None),
    ],
)
def test_the_best_known_torque_tells_the_scale(told, reference):
    assert Prior.of(told).reference() == reference
