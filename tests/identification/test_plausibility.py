"""What no joint can have, and what does not follow the logs, is said; what is within errors not."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from butterfly.errors import InputError
from butterfly.identification import physical
from butterfly.identification.derived_quantities import implied
from butterfly.identification.trust import Finding, FindingKind
from butterfly.logs.log import InputKind
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass, LumpedParameters
from butterfly.model.prior import SCALES, Prior
from butterfly.model.terms import PARAMETERS
from tests.conftest import MASSES
from tests.identification.simulated import estimate_of

VALUES = {"p1": 3e-3, "p2": 1e-3, "p3": 0.04, "p4": 0.5, "coulomb": 1e-3, "delay": 2e-3}
HEAVIEST = max(mass.weight for mass in MASSES)


def _physics(*, masses=MASSES, share=0.1, told=None, freedom=None, **changed):
    """Judge an estimate whose half-widths are a share of its values."""
    values = VALUES | changed
    reach = share * np.abs(list(values.values()))
    estimate = SimpleNamespace(
        names=tuple(values),
        values=np.array(list(values.values())),
        lower=np.array(list(values.values())) - reach,
        upper=np.array(list(values.values())) + reach,
        covariance=np.diag((reach / 2) ** 2),
        parameters=LumpedParameters(**values),
        known=Prior.of(told or {}),
        freedom=None if freedom is None else np.full(len(values), freedom),
    )
    return [(each.kind, each.parameters) for each in physical.judge_physics(estimate, masses)]


NO_INERTIA = (FindingKind.NO_INERTIA, ("p1",))
EARLY = (FindingKind.EARLY, ("delay",))


def _negative(*names):
    return FindingKind.NEGATIVE, names


@pytest.mark.parametrize(
    ("changed", "found"),
    [
        ({}, []),
        ({"p1": -1e-4}, [NO_INERTIA]),
        ({"p1": -1e-4, "masses": MASSES[1:]}, []),  # which make up for it
        ({"p1": -1e-4, "masses": ()}, [NO_INERTIA]),
        ({"p1": np.nan}, [NO_INERTIA]),
        *(({name: -1e-3}, [_negative(name)]) for name in ("p2", "coulomb", "drag", "stribeck")),
        *(
            ({name: -1e-3, "share": 1.5}, [])  # within its error
            for name in ("p2", "coulomb", "drag", "stribeck")
        ),
        ({"delay": -5e-3}, [EARLY]),  # stamps may be late
        ({"delay": -5e-3, "p2": -1e-3}, [_negative("p2"), EARLY]),
        ({"delay": -5e-5}, []),  # no stamp resolves it
        ({"p4": -0.5}, [(FindingKind.NEGATIVE_GAIN, ("p4",))]),
        ({"p4": -0.5, "told": {"p4": -0.5}}, []),
        ({"load": -0.9e-3 / HEAVIEST}, []),  # relieves the bearing
        ({"load": -2e-3 / HEAVIEST}, [_negative("load")]),  # drives it
        ({"load": -2e-3 / HEAVIEST, "share": 3.0}, []),
        # by 2.2 standard errors, which is enough with 30 degrees of freedom, not with 1
        ({"load": -2e-3 / HEAVIEST, "share": 0.4, "freedom": 1.0}, []),
        ({"load": -2e-3 / HEAVIEST, "share": 0.4, "freedom": 30.0}, [_negative("load")]),
        ({"load": -2e-3 / HEAVIEST, "share": 0.4}, [_negative("load")]),
    ],
)
def test_what_no_joint_can_have_is_said_and_what_is_within_its_error_not(changed, found):
    assert set(VALUES) == set(PARAMETERS)
    assert _physics(**changed) == found


@pytest.mark.parametrize(("resistance", "accused"), [(0.005, True), (0.05, False), (0.9, False)])
def test_only_a_resistance_that_no_motor_has_is_noticed(resistance, accused):
    """p4 = k/R and p2 = k^2/R, so the bound on the resistance is p2/p4^2."""
    p2, p4 = resistance * 2.0**2, 2.0
    found = LumpedParameters(p1=0.003, p2=p2, p3=0.05, p4=-p4)
    both = SimpleNamespace(names=("p2", "p4"), upper=np.array([p2, 2.1]), parameters=found)
    known = SimpleNamespace(names=("p4",), upper=np.array([2.1]), parameters=found)
    for estimate in (both, known):
        said = physical.judge_input(estimate, InputKind.VOLTAGE)
        assert [each.number for each in said] == pytest.approx([resistance] if accused else [])
        assert all(each.kind is FindingKind.TORQUE_DRIVEN for each in said)
    assert physical.judge_input(both, InputKind.TORQUE) == []


@pytest.mark.parametrize(
    ("fits", "found"),
    [
        ((70.0, 79.0, 60.0, 95.0), False),
        ((70.0, 20.0, 10.0, 49.0), True),
        ((-np.inf, -np.inf, -np.inf, 95.0), True),
        ((np.nan, 95.0, 95.0, 95.0), True),
    ],
)
def test_a_median_that_does_not_follow_is_said(fits, found):
    said = physical.judge_fit(np.array(fits))
    numbers = [each.number for each in said if each.kind is FindingKind.POOR_FIT]
    assert numbers == ([pytest.approx(np.median(fits), nan_ok=True)] if found else [])


def _basis(known, *, integrated=False, **masses):
    """Return what values rest on, with what is known and an added mass of some uncertainty."""
    load = AddedMass(mass=0.05, arm=0.1, **masses)
    about = {"integrated": integrated, "closed": False}
    logs = [SimpleNamespace(added_mass=m, **about) for m in (NO_ADDED_MASS, load)]
    data = SimpleNamespace(known=Prior.of(known), logs=logs)
    found = physical.judge_basis(SimpleNamespace(names=("p1", "p4", "delay")), data)
    return found[0].parameters if found else ()


def test_what_no_log_shows_is_named_unless_its_uncertainty_was_told():
    every = ("mass_scale", "arm", "gravity_scale", "input_scale", "angle_scale")
    every += ("time_scale", "lag")
    assert _basis({}) == every
    told = {**dict.fromkeys(SCALES, (1.0, 0.01)), "lag": (0.0, 0.01)}
    assert _basis({}, integrated=True)[4:] == ("velocity_scale", "time_scale", "lag")
    assert _basis(told) == _basis(told, integrated=True) == ("arm",)
    assert _basis(told, arm_uncertainty=1e-4) == ()
    assert _basis({}, mass_uncertainty=1e-4) == every[1:]
    with pytest.raises(InputError, match="1 ± its uncertainty"):
        Prior.of({"mass_scale": 1.02})
    with pytest.raises(InputError, match="0 ± its uncertainty"):
        Prior.of({"lag": 0.002})


def _knowledge(**known):
    """Judge what is known of motor and hand beside values with errors of 1 %."""
    values = np.array([0.00325, 0.00145, 0.04905, 0.025])
    told, errors = Prior.of(known), 0.01 * values
    estimate = estimate_of(values, np.diag(errors**2), reach=2)
    kind = InputKind.VOLTAGE
    about = {"given": told, "known": implied(told, kind), "input_kind": kind}
    data = SimpleNamespace(**about, logs=[SimpleNamespace(added_mass=NO_ADDED_MASS)])
    return physical.judge_knowledge(estimate, data)


TWO_GAINS = {"torque_constant": (0.05, 0.0005), "resistance": 2.0, "p4": (0.027, 0.0003)}
DAMPING_APART = 3e-4 / np.hypot(0.0000145, 0.07 * 0.00025)  # below that of the back EMF
GAINS_APART = 0.002 / np.hypot(0.00025, 0.0003)
MORE = {"hand_mass": 0.005, "rotor_inertia": 1e-4}  # inertia than there is


@pytest.mark.parametrize(
    ("known", "kind", "name", "apart"),
    [
        ({"back_emf_constant": 0.07}, "contradicted", "viscous_friction", DAMPING_APART),
        (MORE, FindingKind.CONTRADICTED, "inertia", None),
        ({"rotor_inertia": 0.005}, FindingKind.CONTRADICTED, "hand_inertia", None),
        (TWO_GAINS, FindingKind.SOURCES_CONFLICT, "p4", GAINS_APART),
    ],
)
def test_what_is_known_and_cannot_all_be_true_is_remarked(known, kind, name, apart):
    (said,) = _knowledge(**known)
    assert (said.kind, said.parameters) == (kind, (name,))
    assert said.number > 3
    if apart is not None:
        assert said.number == pytest.approx(apart, rel=0.05)


def test_what_agrees_is_not_remarked():
    motor = {"torque_constant": 0.05, "resistance": (2.0, 0.02), "back_emf_constant": 0.05}
    hand = {"hand_mass": 0.1, "rotor_inertia": 1e-4, "p4": (0.0255, 0.0003)}
    about_one_error = {"back_emf_constant": 0.059}
    for known in ({}, motor | hand, about_one_error):
        assert not _knowledge(**known)


@pytest.mark.parametrize(
    ("finding", "impossible", "forbids"),
    [
        (Finding(FindingKind.NO_INERTIA, number=-1.0), True, True),
        (Finding(FindingKind.NEGATIVE), True, True),
        (Finding(FindingKind.EARLY, ("delay",)), False, False),
        (Finding(FindingKind.POOR_FIT, number=-math.inf), True, True),
        (Finding(FindingKind.POOR_FIT, number=30.0), False, True),
        (Finding(FindingKind.UNIT_ERROR, ("degrees",), number=57.3), False, True),
        (Finding(FindingKind.SUSPECTED, ("mass", "50 g", "3"), number=0.051), False, False),
        (Finding(FindingKind.FEW_MASSES, number=2), False, False),
        (Finding(FindingKind.PRIOR_CONFLICT, ("p1",), number=4.0), False, False),
        (Finding(FindingKind.KNOWN_CONFLICT, ("p4",), number=0.03), False, False),
    ],
)
def test_only_what_no_joint_has_what_does_not_follow_and_slips_forbid(finding, impossible, forbids):
    assert (finding.impossible, finding.forbids) == (impossible, forbids)
