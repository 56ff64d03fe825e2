import math

import pytest
from hypothesis import given

from butterfly.errors import InputError
from butterfly.model.parameters import (
    AddedMass,
    Friction,
    JointKind,
    LumpedParameters,
    VoltageDrive,
)
from tests.model.joints import positive


@given(mass=positive, arm=positive, first=positive)
def test_added_masses_on_one_arm_add_up(mass, arm, first):
    bare = LumpedParameters(p1=1, p2=1, p3=1, p4=1)
    one, other, sum_ = (AddedMass(mass=each, arm=arm) for each in (first, mass, first + mass))
    both, together = bare.with_added_mass(one).with_added_mass(other), bare.with_added_mass(sum_)
    assert both.p1 == pytest.approx(together.p1)
    assert both.p3 == pytest.approx(together.p3)


@pytest.mark.parametrize("bad", [-1.0, math.nan, math.inf])
def test_impossible_values_are_refused_by_name(bad):
    with pytest.raises(InputError, match="mass: got"):
        AddedMass(mass=bad, arm=0.1)
    with pytest.raises(InputError, match="coulomb: got"):
        Friction(coulomb=bad)
    with pytest.raises(InputError, match="resistance: got"):
        VoltageDrive(resistance=bad, torque_constant=1, back_emf_constant=1)


def test_a_disc_has_an_inertia_of_its_own_and_no_more_moment():
    point, disc = (AddedMass(mass=0.2, arm=0.1, own_inertia=own) for own in (0.0, 1e-4))
    assert disc.inertia - point.inertia == pytest.approx(1e-4)
    assert disc.inertia_and_moment == pytest.approx((2.1e-3, point.gravity_moment))
    assert str(disc) == "200 g at 100 mm with 0.0001 kg m²"
    assert AddedMass(mass=0.0, own_inertia=1e-4) == AddedMass()
    assert AddedMass(mass=0.2, own_inertia=1e-4, joint=JointKind.SLIDE).own_inertia == 0
    with pytest.raises(InputError, match="own_inertia: got -1"):
        AddedMass(mass=0.2, arm=0.1, own_inertia=-1.0)


def test_a_slide_carries_masses_and_an_upright_axis_no_moments_but_weight():
    slide = AddedMass(mass=0.2, arm=0.3, joint=JointKind.SLIDE)
    assert slide.inertia_and_moment == (0.2, 0.0)
    assert str(slide) == "200 g"
    upright = AddedMass(mass=0.2, arm=0.3, gravity=0.0)
    assert upright.inertia_and_moment == (pytest.approx(0.018), 0.0)
    assert (upright.weight, upright.gravity_moment) == (pytest.approx(0.2 * 9.81), 0)
    assert AddedMass(mass=0.2, arm=0.1, gravity=4.0).weight == pytest.approx(0.8)
    assert AddedMass(mass=0.0, arm=0.3) == AddedMass()


def test_one_added_mass_is_one_in_every_spelling():
    kilograms = AddedMass(mass=0.052, arm=0.15)
    for other in (
        AddedMass(mass=52 * 1e-3 * (1 + 1e-15), arm=15 * 1e-2),
        AddedMass(mass=0.052, arm=0.15, mass_uncertainty=1e-12, arm_uncertainty=1e-3),
    ):
        assert other == kilograms
        assert hash(other) == hash(kilograms)
        assert other.inertia_and_moment == kilograms.inertia_and_moment
        assert str(other) == str(kilograms)
    assert sorted([AddedMass(mass=0.1, arm=0.1), kilograms])[0] is kilograms
    others = {"mass": 0.0521, "arm": 0.1501, "own_inertia": 1e-6, "gravity": 0.0}
    for name, value in (others | {"joint": JointKind.SLIDE}).items():
        assert AddedMass(**{"mass": 0.052, "arm": 0.15, name: value}) != kilograms
    assert kilograms != 0.052
