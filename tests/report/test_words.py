"""What was found is said, in a sentence for each kind, with its number and its parameters."""

from __future__ import annotations

import re
from types import SimpleNamespace

import numpy as np
import pytest

from butterfly.identify.judgement.findings import Finding, FindingKind, Severity
from butterfly.report.words import sentences

NUMBERS = {
    FindingKind.PRECISE: (0.1, "10 %"),
    FindingKind.CONDITION: (37.0, "37"),
    FindingKind.COMBINATION: (4321.0, "4321"),
    FindingKind.ROUNDS: (8.0, "8"),
    FindingKind.SIMULATIONS: (23.0, "23"),
    FindingKind.FEW_MASSES: (2.0, "Fewer than three"),
    FindingKind.TORQUE_DRIVEN: (0.004, "0.004 Ohm"),
    FindingKind.NO_UNCERTAINTY: (3.0, "3 resonance"),
    FindingKind.MISFIT: (41.3, "41.3 times"),
    FindingKind.NO_MISFIT: (1.02, "1.02 times"),
    FindingKind.LEFT_OVER: (0.87, "87 %"),
}
NAMELESS = {
    *(FindingKind.CONDITION, FindingKind.ROUNDS, FindingKind.SIMULATIONS, FindingKind.FEW_MASSES),
    *(FindingKind.UNCHECKED, FindingKind.TORQUE_DRIVEN, FindingKind.NO_UNCERTAINTY),
    *(FindingKind.ABSOLUTE, FindingKind.RATIOS, FindingKind.MISFIT, FindingKind.NO_MISFIT),
}


def _said(*findings):
    estimate = SimpleNamespace(
        names=("p2", "p4", "tilt"), values=np.array([1e-3, -0.5, 0.2]), findings=findings
    )
    return sentences(estimate)


@pytest.mark.parametrize("kind", FindingKind)
def test_every_kind_of_finding_has_a_sentence_with_its_number_and_parameters(kind):
    number, shown = NUMBERS.get(kind, (None, ""))
    (said,) = _said(Finding(kind=kind, parameters=("p2", "tilt"), number=number))
    assert re.fullmatch(r"\S.*\.", said)
    assert shown in said
    if kind not in NAMELESS:
        assert "p2" in said
        assert "tilt" in said


def test_no_two_kinds_say_the_same():
    said = [_said(Finding(kind=k, parameters=("p2",), number=5.0))[0] for k in FindingKind]
    assert len(set(said)) == len(said)


def test_how_well_parameters_are_known_comes_first_and_in_one_sentence():
    known = Finding(kind=FindingKind.PRECISE, parameters=("p4",), number=0.1)
    hidden = Finding(kind=FindingKind.NOT_FROM_ZERO, parameters=("p2", "tilt"))
    said = _said(Finding(kind=FindingKind.UNCHECKED), known, hidden)
    assert said[0] == "p4 known within 10 %; p2, tilt not distinguishable from zero."
    assert len(said) == 2


def test_a_fit_that_did_not_converge_is_not_to_be_trusted():
    findings = [
        Finding(kind=FindingKind.SIMULATIONS, number=60.0, severity=severity)
        for severity in (Severity.NOTE, Severity.WARNING)
    ]
    converged, stopped = _said(*findings)
    assert "do not trust" not in converged
    assert "do not trust" in stopped


def test_three_masses_of_which_none_can_be_left_out_are_not_called_few():
    (said,) = _said(Finding(kind=FindingKind.FEW_MASSES, number=3.0))
    assert "Fewer" not in said
    assert "cannot determine" in said


def test_the_back_emf_constant_of_a_drive_is_bounded_by_its_resistance_and_gain():
    """k = R p4, for a motor with p4 = k/R."""
    (said,) = _said(Finding(kind=FindingKind.TORQUE_DRIVEN, number=0.004))
    assert "below 0.002 V s/rad" in said
