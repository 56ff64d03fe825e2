"""The draft of a motor's file: what a motor takes along, and results that tell of none."""

from dataclasses import replace

import numpy as np
import pytest

from butterfly.errors import InputError
from butterfly.identification.identified import Identified
from butterfly.identification.trust import Finding, FindingKind
from butterfly.logs.log import InputKind
from butterfly.logs.motors import MotorValue
from butterfly.model.parameters import JointKind
from butterfly.model.prior import Prior
from butterfly.twin.motor_file import measured_values, motor_draft
from butterfly.yaml_files import _parsed as parsed
from tests.identification.simulated import estimate_of

NAMES = ("p1", "p2", "p3", "p4", "coulomb", "bias", "compression")
VALUES = np.array([0.003, 2e-3, 0.04, 0.5, 1e-3, 2e-3, 0.1])
ERRORS = np.array([1e-5, 1e-5, 1e-4, 1e-3, 1e-5, 1e-5, 0.1])


def estimate(**fields):
    plain = estimate_of(VALUES, np.diag(ERRORS**2), names=NAMES)
    return replace(plain, input_kind=InputKind.VOLTAGE, **fields)


def identified(found, kind="voltage", manifest=None):
    origin = {"name": "x", "input": kind, "manifest": manifest}
    return Identified(estimate=found, estimator="", origin=origin, fits={})


def test_a_motor_takes_gain_and_friction_along_if_they_are_not_0_and_no_load():
    known, rig = measured_values(estimate())
    assert [*known] == ["p2", "p4", "coulomb"]
    assert [*rig] == ["p1", "p3", "bias", "compression"]
    assert known["p4"] == {"value": 0.5, "lower": 0.496, "upper": 0.504, "unit": "N m/V"}
    for name, values in known.items():
        assert MotorValue(**values).farther > ERRORS[NAMES.index(name)]
    told = estimate(known=Prior.of({"p4": (0.5, 0.1)}))
    assert "p4" not in {*measured_values(told)[0], *measured_values(told)[1]}


def test_a_draft_has_the_manifest_without_its_place(tmp_path):
    logs = [{"file": "a.csv", "loop": {"kp": 100}}]
    manifest = {"name": "x", "input": "setpoint", "root": str(tmp_path), "logs": logs}
    manifest["loop"] = {"law": "dynamixel-x"}
    content, _ = parsed(motor_draft(identified(estimate(), manifest=manifest)))
    assert str(tmp_path) not in str(content)
    (motor,) = content["motors"]
    assert motor["made"]["manifest"] == {k: v for k, v in manifest.items() if k != "root"}
    assert content["law"] == "dynamixel-x"
    assert motor["source"]["commit"] == ""


_BAD = Finding(FindingKind.POOR_FIT, number=-3.0)


@pytest.mark.parametrize(
    ("found", "kind", "message"),
    [
        (estimate(findings=(_BAD,)), "voltage", "verdict: got do not use; expected good, or use"),
        (estimate(), "none", "got free decays; expected a driven hinge"),
        (estimate(joint=JointKind.SLIDE), "voltage", "got a slide; expected a driven hinge"),
        (
            estimate(known=Prior.of(dict.fromkeys(("p2", "p4", "coulomb"), 1.0))),
            "voltage",
            "nothing",
        ),
    ],
)
def test_what_says_nothing_of_a_motor_is_one_line(found, kind, message):
    with pytest.raises(InputError, match=message):
        motor_draft(identified(found, kind))
