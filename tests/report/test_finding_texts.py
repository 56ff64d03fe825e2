"""What was found is said, in a sentence for each kind, with its number and its parameters."""

from __future__ import annotations

import re
from types import SimpleNamespace

import numpy as np
import pytest

from butterfly.identification.diagnostics.findings import Ending, Finding, FindingKind
from butterfly.report.finding_texts import estimate_sentences
from butterfly.report.inspection import conditions_text
from butterfly.verdict import Level

NUMBERS = {
    FindingKind.PRECISE: (0.1, "10 %"),
    FindingKind.POOR_FIT: (61.3, "61.3 %"),
    FindingKind.UNFOLLOWED: (-7.2, "-7.2 %"),
    FindingKind.NO_INERTIA: (-2e-4, "-0.0002 kg"),
    FindingKind.LEFT_OUT: (12.0, "was left out"),
    FindingKind.MISSING_TERM: (0.31, "31 %"),
    FindingKind.OTHER_END: (1.52, "1.52 times"),
    FindingKind.COMBINATION: (4321.0, "number 4300"),
    FindingKind.ROUNDS: (8.0, "8"),
    FindingKind.SIMULATIONS: (23.0, "23"),
    FindingKind.FEW_MASSES: (2.0, "Fewer than three"),
    FindingKind.TORQUE_DRIVEN: (0.004, "0.004 Ohm"),
    FindingKind.NO_UNCERTAINTY: (3.0, "3 resonance"),
    FindingKind.MISFIT: (41.3, "41.3 times"),
    FindingKind.NO_MISFIT: (1.02, "1.02 times"),
    FindingKind.LEFT_OVER: (0.87, "87 %"),
    FindingKind.SCANNED: (0.14, "0.14"),
    FindingKind.FEW_LOGS: (2.0, "2 logs"),
    FindingKind.REST_APART: (0.131, "0.13 rad"),
    FindingKind.UNFORETOLD: (41.2, "41.2 %"),
    FindingKind.ADDS_UP: (0.5, "0.5 s"),
    FindingKind.OUTDONE: (99.52, "99.5 %"),
    FindingKind.KNOWN_APART: (-0.021, "about 2.1 % smaller"),
    FindingKind.PRIOR_APART: (3.42, "3.4 standard errors"),
    FindingKind.TOLD_APART: (4.23, "4.2 standard uncertainties"),
    FindingKind.CONTRADICTED: (5.61, "5.6 standard errors"),
}
OF_BODY = {FindingKind.CONTRADICTED: ("viscous_friction", "inertia")}
"""Physical parameters instead of the model's."""
OF_LOGS = {FindingKind.UNFOLLOWED, FindingKind.LEFT_OUT, FindingKind.UNPREDICTABLE}
OF_LOGS |= {FindingKind.UNFORETOLD, FindingKind.ZERO_GUESSED}
NAMELESS = {
    *(FindingKind.ROUNDS, FindingKind.SIMULATIONS, FindingKind.FEW_MASSES, FindingKind.OTHER_END),
    *(FindingKind.POOR_FIT, FindingKind.UNFOLLOWED, FindingKind.LEFT_OUT),
    *(FindingKind.UNPREDICTABLE, FindingKind.FEW_LOGS, FindingKind.REST_APART),
    *(FindingKind.UNCHECKED, FindingKind.TORQUE_DRIVEN, FindingKind.NO_UNCERTAINTY),
    *(FindingKind.UNFORETOLD, FindingKind.ZERO_GUESSED, FindingKind.ADDS_UP),
    FindingKind.OUTDONE,
    *(FindingKind.ABSOLUTE, FindingKind.RATIOS, FindingKind.MISFIT, FindingKind.NO_MISFIT),
}


PLAIN = [kind for kind in FindingKind if kind is not FindingKind.UNIT_ERROR]
"""Slips have sentences of their own, each its test."""


def _verdict_and_more(*findings, ending=Ending.CONVERGED):
    estimate = SimpleNamespace(
        names=("p2", "p4", "tilt"),
        values=np.array([1e-3, -0.5, 0.2]),
        fixed={},
        findings=findings,
        ending=ending,
    )
    return estimate_sentences(estimate)


def _said(*findings):
    """Say findings that are no reason of a verdict."""
    verdict, *others = _verdict_and_more(*findings)
    assert verdict.startswith("Good: ")
    return others


@pytest.mark.parametrize("kind", PLAIN)
def test_every_kind_of_finding_has_a_sentence_with_its_number_and_parameters(kind):
    number, shown = NUMBERS.get(kind, (None, ""))
    names = OF_BODY.get(kind, ("p2", "tilt"))
    (said,) = _said(Finding(kind, names, number=number, logs=("first",)))
    assert re.fullmatch(r"\S.*\.", said)
    assert shown in said
    assert ("first" in said) is (kind in OF_LOGS)
    if kind in OF_BODY:
        assert "k_f" in said
        assert "J_p" in said
    elif kind not in NAMELESS:
        assert "p2" in said
        assert "tilt" in said


def test_no_two_kinds_say_the_same():
    said = [_said(Finding(k, OF_BODY.get(k, ("p2",)), number=5.0))[0] for k in PLAIN]
    assert len(set(said)) == len(said)


@pytest.mark.parametrize(
    ("severity", "opening"),
    [(Level.CARE, "Use with care: "), (Level.WARNING, "Do not use: ")],
)
def test_the_verdict_comes_first_with_its_reasons_which_are_not_said_again(severity, opening):
    known = Finding(FindingKind.PRECISE, ("p4",), number=0.1)
    reason = Finding(FindingKind.POOR_FIT, number=61.3, severity=severity)
    verdict, *others = _verdict_and_more(known, reason, Finding(FindingKind.UNCHECKED))
    assert verdict.startswith(opening)
    assert "61.3 %" in verdict
    assert not any("61.3 %" in each for each in others)
    assert ("p4 known within 10 %." in others) is (severity is Level.CARE)


def test_what_did_not_settle_is_not_to_be_used_and_says_why():
    verdict, *others = _verdict_and_more(ending=Ending.STOPPED)
    assert verdict == "Do not use: The estimation did not settle."
    assert others == []


def test_a_model_that_runs_away_is_said_to():
    (said,) = _said(Finding(FindingKind.POOR_FIT, number=-np.inf))
    assert "runs away" in said


def test_a_bound_that_the_data_would_cross_is_said_otherwise_than_one_that_they_respect():
    held = [
        Finding(FindingKind.ON_BOUND, ("p2",), severity=severity)
        for severity in (Level.NOTE, Level.CARE)
    ]
    (respected,) = _said(held[0])
    verdict, *_ = _verdict_and_more(held[1])
    assert "do not show any" in respected
    assert "would cross" in verdict


def test_how_well_parameters_are_known_comes_first_and_in_one_sentence():
    known = Finding(FindingKind.PRECISE, ("p4",), number=0.1)
    hidden = Finding(FindingKind.NOT_FROM_ZERO, ("p2", "tilt"))
    said = _said(Finding(FindingKind.UNCHECKED), known, hidden)
    assert said[0] == "p4 known within 10 %; p2, tilt not distinguishable from zero."
    assert len(said) == 2


@pytest.mark.parametrize(
    ("counts", "said"),
    [
        ((24, 0, 0, 0), "24 logs: all ok."),
        ((1, 0, 0, 0), "1 log: ok."),
        ((10, 31, 0, 0), "41 logs: 10 ok, 31 with a note, none to take care of."),
        ((1, 1, 1, 0), "3 logs: 1 ok, 1 with a note, 1 to take care of."),
        ((0, 0, 0, 1), "1 log: 1 that cannot be used."),
    ],
)
def test_health_is_told_by_severity(counts, said):
    conditions = [each for each, n in zip(Level, counts, strict=True) for _ in range(n)]
    assert conditions_text(conditions) == said


def test_a_fit_that_did_not_converge_is_not_to_be_trusted():
    findings = [
        Finding(FindingKind.SIMULATIONS, number=60.0, severity=severity)
        for severity in (Level.NOTE, Level.WARNING)
    ]
    stopped, converged = _verdict_and_more(*findings)
    assert "do not trust" not in converged
    assert "do not trust" in stopped


def test_three_masses_of_which_none_can_be_left_out_are_not_called_few():
    (said,) = _said(Finding(FindingKind.FEW_MASSES, number=3.0))
    assert "Fewer" not in said
    assert "cannot determine" in said


def test_the_back_emf_constant_of_a_drive_is_bounded_by_its_resistance_and_gain():
    """k = R p4, for a motor with p4 = k/R."""
    (said,) = _said(Finding(FindingKind.TORQUE_DRIVEN, number=0.004))
    assert "below 0.002 V s/rad" in said


@pytest.mark.parametrize(("fit", "said"), [(98.76, "98.8 %"), (-3e28, "less than -1000 %")])
def test_a_fit_is_said_as_far_as_there_is_anything_to_know(fit, said):
    poor = Finding(FindingKind.POOR_FIT, number=fit, severity=Level.WARNING)
    assert f"a median FIT of {said} only" in _verdict_and_more(poor)[0]
