"""What no joint can have is told, and what is only within its error is not."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from butterfly.identification.diagnostics.findings import FindingKind
from butterfly.identification.diagnostics.plausibility import judge_physics
from butterfly.model.parameters import LumpedParameters
from butterfly.model.prior import Prior
from butterfly.model.terms import PARAMETERS
from butterfly.verdict import Level
from tests.conftest import MASSES

VALUES = {"p1": 3e-3, "p2": 1e-3, "p3": 0.04, "p4": 0.5, "coulomb": 1e-3, "delay": 2e-3}


def _estimate(share=0.1, told=None, freedom=None, **changed):
    """An estimate whose half-widths are a share of its values."""
    known = VALUES | changed
    values = np.array(list(known.values()))
    reach = share * np.abs(values)
    return SimpleNamespace(
        names=tuple(known),
        values=values,
        lower=values - reach,
        upper=values + reach,
        covariance=np.diag((reach / 2) ** 2),
        parameters=LumpedParameters(**known),
        known=Prior.of(told or {}),
        freedom=None if freedom is None else np.full(values.size, freedom),
    )


def _judged(*, masses=MASSES, **options):
    found = judge_physics(_estimate(**options), masses)
    return [(each.kind, each.parameters, each.severity) for each in found]


def test_a_joint_s_parameters_are_not_accused():
    assert _judged() == []
    assert set(VALUES) == set(PARAMETERS)


def test_inertia_that_no_added_mass_makes_positive_is_a_warning():
    warned = (FindingKind.NO_INERTIA, ("p1",), Level.WARNING)
    assert _judged(p1=-1e-4) == [warned]
    assert _judged(p1=-1e-4, masses=MASSES[1:]) == []
    assert _judged(p1=-1e-4, masses=()) == [warned]
    assert _judged(p1=np.nan) == [warned]


@pytest.mark.parametrize("name", ["p2", "coulomb", "drag", "stribeck"])
def test_friction_that_drives_is_a_warning_but_not_within_its_error(name):
    assert _judged(**{name: -1e-3}) == [(FindingKind.NEGATIVE, (name,), Level.WARNING)]
    assert _judged(**{name: -1e-3}, share=1.5) == []


def test_torque_before_its_command_needs_care_as_stamps_may_be_late():
    assert _judged(delay=-5e-3) == [(FindingKind.NEGATIVE, ("delay",), Level.CARE)]
    assert _judged(delay=-5e-3, p2=-1e-3) == [
        (FindingKind.NEGATIVE, ("p2", "delay"), Level.WARNING)
    ]


def test_an_input_that_counts_the_other_way_needs_care():
    assert _judged(p4=-0.5) == [(FindingKind.NEGATIVE_GAIN, ("p4",), Level.CARE)]
    assert _judged(p4=-0.5, told={"p4": -0.5}) == []


def test_a_delay_that_no_stamp_resolves_is_not_accused():
    assert _judged(delay=-5e-5) == []


def test_load_may_relieve_the_bearing_but_not_drive_it():
    heaviest = max(mass.weight for mass in MASSES)
    relieved, driving = -0.9e-3 / heaviest, -2e-3 / heaviest
    assert _judged(load=relieved) == []
    assert _judged(load=driving) == [(FindingKind.NEGATIVE, ("load",), Level.WARNING)]
    assert _judged(load=driving, share=3.0) == []


@pytest.mark.parametrize(("freedom", "accused"), [(1.0, False), (30.0, True), (None, True)])
def test_load_drives_for_certain_by_the_degrees_of_freedom_of_its_error(freedom, accused):
    """It does by 2.2 standard errors, which is enough with 30 degrees of freedom, not with 1."""
    driving = -2e-3 / max(mass.weight for mass in MASSES)
    found = _judged(load=driving, share=0.4, freedom=freedom)
    assert bool(found) == accused
