"""Formulas of derived quantities: closed forms, and their errors to first order."""

import control
import numpy as np
import pytest

from butterfly.identification.derived_quantities import WAYS, Quantities
from butterfly.identification.physical import physical_parameters
from butterfly.logs.log import InputKind
from butterfly.model.control_bridge import linearised
from butterfly.model.linear import LinearJoint, resonance_frequency
from butterfly.model.parameters import (
    NO_ADDED_MASS,
    AddedMass,
    Friction,
    Hand,
    JointKind,
    LumpedParameters,
    VoltageDrive,
)
from butterfly.model.prior import Known, Prior
from butterfly.plant.robot import Robot
from tests.identification.simulated import estimate_of

HAND = Hand(mass=0.1, com_distance=0.05, inertia=0.003)
DRIVE = VoltageDrive(resistance=2.0, torque_constant=0.05, back_emf_constant=0.05)
TRUTH = Robot(hand=HAND, drive=DRIVE, friction=Friction(viscous=2e-4)).lumped
NAMES = ("p1", "p2", "p3", "p4")
VALUES = np.array([getattr(TRUTH, name) for name in NAMES])
SLIDE = AddedMass(joint=JointKind.SLIDE)
DERIVED = {way.name for way in WAYS if way.symbol}


def _covariance(share):
    """All scaled by one unknown, as masses alone leave it, and errors of their own."""
    own = np.diag((0.3 * share * VALUES) ** 2)
    return own + share**2 * np.outer(VALUES, VALUES)


def _of_logs(told, values=VALUES, covariance=None, kind=InputKind.VOLTAGE, carrier=NO_ADDED_MASS):
    """Return what is told of an estimate that knows nothing but its logs."""
    covariance = _covariance(0.01) if covariance is None else covariance
    return physical_parameters(estimate_of(values, covariance), Prior.of(told), kind, carrier)


def test_resonance_damping_decay_and_speed_per_volt_are_those_of_the_linearised_joint():
    found = _of_logs({})
    assert found["resonance"].value == pytest.approx(resonance_frequency(TRUTH), rel=1e-12)
    _, ratios, poles = control.damp(linearised(TRUTH), doprint=False)
    assert found["damping_ratio"].value == pytest.approx(ratios[0], rel=1e-9)
    assert found["decay_time"].value == pytest.approx(-1 / (2 * poles[0].real), rel=1e-9)
    units = {each.name: each.unit for each in found.parameters}
    assert units["resonance"] == "rad/s"
    assert units["speed_gain"] == "rad/s/V"
    values = np.array([0.6, 0.1, 0.0, 2.0])
    found = _of_logs({}, values, np.diag([1e-4, 1e-6, 0, 1e-4]), carrier=SLIDE)
    parameters = LumpedParameters(**dict(zip(NAMES, values, strict=True)))
    speed = abs(1j * 1e-6 * LinearJoint.of(parameters).response(1e-6))  # per V, at low frequency
    assert found["speed_gain"].value == pytest.approx(speed, rel=1e-6)
    assert found["speed_gain"].unit == "m/s/V"
    assert "resonance" not in {each.name for each in found.parameters}


def test_a_derived_quantity_that_is_not_known_from_0_or_does_not_exist_is_not_told():
    loose = np.diag([1e-12, VALUES[1] ** 2, 1e-12, 1e-12])
    names = {each.name for each in _of_logs({}, covariance=loose).parameters}
    assert names & DERIVED == {"resonance"}  # p2 may be 0, p1 and p3 are known
    balanced = np.where(np.array(NAMES) == "p3", 0.0, VALUES)
    names = {each.name for each in _of_logs({}, balanced).parameters}
    assert names & DERIVED == {"decay_time", "speed_gain"}


def test_a_combination_is_told_where_what_it_is_made_of_is_not_known():
    values = np.array([0.6, 0.1, 3.0, 2.0, 0.5])
    names = (*NAMES, "coulomb")
    alike = 0.3 * np.array([0.6, 0.0, 3.0, 0.0, 0.0])  # p1 and p3 are uncertain together
    apart = np.array([0.0, 0.05, 0.0, 0.0, -0.2])  # friction is known at 4 rad/s
    covariance = np.diag((1e-3 * values) ** 2) + np.outer(alike, alike) + np.outer(apart, apart)
    found = physical_parameters(
        estimate_of(values, covariance, names=names), Prior(), InputKind.VOLTAGE, NO_ADDED_MASS
    )
    assert found["stiffness_ratio"].value == pytest.approx(5.0)
    assert found["stiffness_ratio"].standard_error == pytest.approx(5 * 2**0.5 * 1e-3, rel=0.01)
    assert found["friction_speed"].value == pytest.approx(4.0, rel=1e-3)
    assert found["friction"].value == pytest.approx(0.9, rel=1e-3)
    assert found["friction"].standard_error < 1e-3
    sure = estimate_of(values, np.diag((1e-4 * values) ** 2), names=names)
    told = physical_parameters(sure, Prior(), InputKind.VOLTAGE, NO_ADDED_MASS).parameters
    assert not {each.name for each in told} & {"stiffness_ratio", "friction", "friction_speed"}


def test_derivatives_are_exact_and_a_division_by_zero_is_no_number():
    found = Quantities(names=("a", "b"), values=np.array([1.2, 0.3]), covariance=np.eye(2))
    slopes = found.gradient(lambda of: of["a"] ** 3 * np.cos(of["b"]) / of["b"])
    a, b = found.values
    by_b = a**3 * (-np.sin(b) / b - np.cos(b) / b**2)
    np.testing.assert_allclose(slopes, [3 * a**2 * np.cos(b) / b, by_b], rtol=1e-14)
    told = Quantities.of({"a": Known(value=1.0), "b": Known(value=0.0, uncertainty=0.1)})
    assert told.find(lambda of: of["a"] / of["b"]).value == np.inf


def test_linear_relations_are_gaussian_conditioning_whether_they_were_used_or_not():
    """Against the joint Gaussian of all, conditioned on x0 = c0 + 2 c1 by its closed form."""
    rng = np.random.default_rng(0)
    root = rng.standard_normal((3, 3))
    lumped = Quantities(
        names=("x", "y", "z"), values=np.array([1.0, 2, 3]), covariance=root @ root.T
    )
    causes = Quantities.of(
        {"c": Known(value=0.3, uncertainty=0.4), "d": Known(value=0.5, uncertainty=0.2)}
    )
    formulas = {"x": lambda of: of["c"] + 2 * of["d"]}
    whole = np.block([[lumped.covariance, np.zeros((3, 2))], [np.zeros((2, 3)), causes.covariance]])
    values = np.concatenate([lumped.values, causes.values])
    gap = np.array([1.0, 0, 0, -1, -2])
    gain = whole @ gap / (gap @ whole @ gap)
    mean, covariance = values - gain * (gap @ values), whole - np.outer(gain, gap @ whole)

    fresh = lumped.combined_with(causes, formulas, new=frozenset({"x"}))
    informed = Quantities(names=lumped.names, values=mean[:3], covariance=covariance[:3, :3])
    used = informed.combined_with(causes, formulas, new=frozenset())
    for found in (fresh, used):
        assert found.names == ("x", "y", "z", "c", "d")
        np.testing.assert_allclose(found.values, mean)
        np.testing.assert_allclose(found.covariance, covariance, atol=1e-14)


def test_what_is_exact_learns_nothing():
    lumped = Quantities(names=("x",), values=np.array([2.0]), covariance=np.array([[0.01]]))
    causes = Quantities.of({"c": Known(value=1.0)})
    found = lumped.combined_with(causes, {"x": lambda of: 2 * of["c"]}, new=frozenset())
    assert found.find(lambda of: of["c"]) == Known(value=1.0)
