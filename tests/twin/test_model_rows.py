"""What is said of a model's attributes, by hand: armature from p1 and the links' inertia."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from butterfly.identification.estimate import Estimate
from butterfly.logs.log import InputKind
from butterfly.logs.model_facts import ActuatorFacts, LinkMasses, ModelFacts, PoseFacts
from butterfly.model.parameters import JointKind
from butterfly.twin.model_rows import facts_of, model_rows
from butterfly.verdict import SPREADS

LINKS, MOMENT, ROTORS = 0.05, 1.5, 0.004
VALUES = {"p1": 0.08, "p2": 0.11, "p3": 1.56, "p4": 0.9, "coulomb": 0.2}
ERRORS = {"p1": 1e-3, "p2": 4e-3, "p3": 0.03, "p4": 0.01, "coulomb": 5e-3}  # standard
MOTOR = ActuatorFacts(name="motor", gear=20.0, gain=20.0)


def _identified(correlation=0.0, *, names=tuple(VALUES), fixed=None, **told):
    """An identification with a model; ``correlation`` is that of p1 and p3."""
    about = {
        "file": "arm.xml",
        "joint": "elbow",
        "kind": JointKind.HINGE,
        "gravity": 9.81,
        "poses": [PoseFacts(inertia=LINKS, moment=MOMENT, zero=0.0)],
        "armature": 0.02,
        "rotors": ROTORS,
        "damping": 0.1,
        "motor_damping": 0.03,
        "frictionloss": 0.3,
        "actuators": [MOTOR],
    }
    facts = ModelFacts(**(about | told))
    values = np.array([VALUES[name] for name in names])
    errors = np.array([ERRORS[name] for name in names])
    covariance = np.diag(errors**2)
    if correlation:
        one, other = names.index("p1"), names.index("p3")
        covariance[one, other] = covariance[other, one] = correlation * errors[one] * errors[other]
    estimate = Estimate(
        method="any",
        names=names,
        values=values,
        covariance=covariance,
        lower=values - SPREADS * errors,
        upper=values + SPREADS * errors,
        fixed=fixed or {},
    )
    manifest = {"facts": facts.model_dump(mode="json")}
    origin = {"manifest": manifest, "input": InputKind.TORQUE.value}
    return SimpleNamespace(estimate=estimate, origin=origin)


def _row(identified, attribute):
    (row,) = [each for each in model_rows(identified) if each.attribute == attribute]
    return row


@pytest.mark.parametrize("correlation", [0.0, 0.7])
def test_a_common_error_of_all_masses_cancels_in_armature(correlation):
    """armature = p1 - J p3 / (the model's gravity moment) - rotors."""
    row = _row(_identified(correlation), "armature")
    share = LINKS / MOMENT
    assert row.value == pytest.approx(VALUES["p1"] - share * VALUES["p3"] - ROTORS)
    own, gravity = ERRORS["p1"], share * ERRORS["p3"]
    error = math.sqrt(own**2 + gravity**2 - 2 * correlation * own * gravity)
    assert row.half_width == pytest.approx(SPREADS * error, rel=1e-6)
    assert (row.element, row.name, row.unit, row.now) == ("joint", "elbow", "kg m²", 0.02)


def test_independent_errors_of_masses_are_errors_of_the_links_inertia():
    links = LinkMasses(uncertainty=0.04, independent=True)
    row = _row(_identified(0.7, links=links), "armature")
    assert row.value == pytest.approx(VALUES["p1"] - LINKS - ROTORS)
    error = math.hypot(ERRORS["p1"], 0.04 * LINKS)
    assert row.half_width == pytest.approx(SPREADS * error, rel=1e-6)


def test_without_gravity_an_error_of_all_masses_is_one_of_the_links_inertia():
    poses = [PoseFacts(inertia=LINKS, moment=0.0, zero=0.0)]
    row = _row(_identified(poses=poses, gravity=0.0), "armature")
    assert row.value == pytest.approx(VALUES["p1"] - LINKS - ROTORS)
    error = math.hypot(ERRORS["p1"], 0.05 * LINKS)
    assert row.half_width == pytest.approx(SPREADS * error, rel=1e-6)


def test_damping_is_without_that_of_the_motors_and_friction_is_coulomb():
    identified = _identified()
    damping, friction = _row(identified, "damping"), _row(identified, "frictionloss")
    assert damping.value == pytest.approx(VALUES["p2"] - 0.03)
    assert damping.half_width == pytest.approx(SPREADS * ERRORS["p2"])
    assert friction.value == VALUES["coulomb"]
    assert (damping.inside, friction.inside) == (False, False)
    assert _row(_identified(damping=0.08), "damping").inside


def test_a_motors_gear_is_the_torque_for_one_unit_of_ctrl():
    row = _row(_identified(), "gear")
    assert (row.element, row.name, row.now) == ("motor", "motor", 20.0)
    assert row.value == pytest.approx(VALUES["p4"])
    assert row.half_width == pytest.approx(SPREADS * ERRORS["p4"])


@pytest.mark.parametrize("shortcut", ["motor", "general"])
def test_the_gain_of_an_actuator_is_that_of_its_file(shortcut):
    """Of gear 20 and gainprm 3: 60 N m for ctrl 1; one of the two is said to be another."""
    actuator = ActuatorFacts(name="m", gear=20.0, gain=60.0, shortcut=shortcut)
    attribute, kept, now = ("gear", 3.0, 20.0) if shortcut == "motor" else ("gainprm", 20.0, 3.0)
    row = _row(_identified(actuators=[actuator]), attribute)
    assert row.now == pytest.approx(now)
    assert row.value == pytest.approx(VALUES["p4"] / kept)
    assert row.half_width == pytest.approx(SPREADS * ERRORS["p4"] / kept)


def test_a_known_gain_is_no_row_of_an_actuator():
    names = ("p1", "p2", "p3", "coulomb")
    rows = model_rows(_identified(names=names, fixed={"p4": 1.0}))
    assert [row.attribute for row in rows] == ["armature", "damping", "frictionloss"]


def test_numbers_for_programs_have_limits_and_what_the_file_says():
    row = _row(_identified(), "damping")
    numbers = row.numbers()
    assert numbers["upper"] - numbers["value"] == pytest.approx(row.half_width)
    assert numbers["value"] - numbers["lower"] == pytest.approx(row.half_width)
    assert numbers["in_file"] == 0.1


def test_ratios_and_answers_without_a_model_say_nothing_of_attributes():
    names = ("p2", "p3", "p4", "coulomb")
    assert model_rows(_identified(names=names)) == []
    plain = SimpleNamespace(estimate=_identified().estimate, origin={"input": "torque"})
    assert facts_of(plain) is None
    assert model_rows(plain) == []
