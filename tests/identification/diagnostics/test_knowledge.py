"""What is known of motor and hand is held against itself and against the estimate."""

from types import SimpleNamespace

import numpy as np
import pytest

from butterfly.identification.diagnostics.findings import Ending, FindingKind
from butterfly.identification.diagnostics.plausibility import judge_knowledge
from butterfly.identification.estimate import Estimate
from butterfly.identification.implied import implied
from butterfly.logs.log import InputKind
from butterfly.model.parameters import NO_ADDED_MASS
from butterfly.model.prior import Prior
from butterfly.verdict import Level

VALUES = np.array([0.00325, 0.00145, 0.04905, 0.025])


def _judged(**known):
    told = Prior.of(known)
    errors = 0.01 * VALUES
    estimate = Estimate(
        method="",
        names=("p1", "p2", "p3", "p4"),
        values=VALUES,
        covariance=np.diag(errors**2),
        lower=VALUES - 2 * errors,
        upper=VALUES + 2 * errors,
        left_out={},
        condition=1.0,
        on_bound=(),
        ending=Ending.CONVERGED,
        findings=(),
    )
    data = SimpleNamespace(
        told=told,
        known=implied(told, InputKind.VOLTAGE),
        input_kind=InputKind.VOLTAGE,
        logs=[SimpleNamespace(added_mass=NO_ADDED_MASS)],
    )
    return judge_knowledge(estimate, data)


def test_what_agrees_is_not_remarked():
    assert not _judged()
    motor = {"torque_constant": 0.05, "resistance": (2.0, 0.02), "back_emf_constant": 0.05}
    assert not _judged(**motor, hand_mass=0.1, rotor_inertia=1e-4, p4=(0.0255, 0.0003))


def test_damping_below_that_of_the_back_emf_is_remarked():
    (said,) = _judged(back_emf_constant=0.07)
    assert (said.kind, said.severity) == (FindingKind.CONTRADICTED, Level.CARE)
    assert said.parameters == ("viscous_friction",)
    error = np.hypot(0.0000145, 0.07 * 0.00025)
    assert said.number == pytest.approx(3e-4 / error, rel=0.05)
    assert not _judged(back_emf_constant=0.059)  # about one standard error


def test_more_inertia_of_rotor_or_mass_than_there_is_is_remarked():
    (said,) = _judged(hand_mass=0.005, rotor_inertia=1e-4)
    assert said.parameters == ("inertia",)
    (said,) = _judged(rotor_inertia=0.005)
    assert said.parameters == ("hand_inertia",)


def test_two_sources_of_the_gain_that_disagree_are_remarked():
    (said,) = _judged(torque_constant=(0.05, 0.0005), resistance=2.0, p4=(0.027, 0.0003))
    assert (said.kind, said.parameters) == (FindingKind.TOLD_APART, ("p4",))
    assert said.number == pytest.approx(0.002 / np.hypot(0.00025, 0.0003))
