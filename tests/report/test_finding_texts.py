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
NAMELESS = OF_LOGS | {
    *(FindingKind.ROUNDS, FindingKind.SIMULATIONS, FindingKind.FEW_MASSES, FindingKind.OTHER_END),
    *(FindingKind.POOR_FIT, FindingKind.FEW_LOGS, FindingKind.REST_APART, FindingKind.UNCHECKED),
    *(FindingKind.TORQUE_DRIVEN, FindingKind.NO_UNCERTAINTY, FindingKind.ADDS_UP),
    *(FindingKind.OUTDONE, FindingKind.ABSOLUTE, FindingKind.RATIOS, FindingKind.MISFIT),
    FindingKind.NO_MISFIT,
}
PLAIN = [kind for kind in FindingKind if kind is not FindingKind.UNIT_ERROR]
"""Wrong units have sentences of their own, each its test."""


def _verdict_and_more(*findings, ending=Ending.CONVERGED):
    estimate = SimpleNamespace(
        names=("p2", "p4", "tilt"),
        values=np.array([1e-3, -0.5, 0.2]),
        fixed={},
        findings=findings,
        ending=ending,
    )
    return estimate_sentences(estimate)


def test_every_kind_of_finding_has_its_own_sentence_with_its_number_and_parameters():
    sentences = set()
    for kind in PLAIN:
        number, shown = NUMBERS.get(kind, (None, ""))
        names = OF_BODY.get(kind, ("p2", "tilt"))
        finding = Finding(kind=kind, parameters=names, number=number, logs=("first",))
        verdict, text = _verdict_and_more(finding)
        assert verdict.startswith("Good: ")
        assert re.fullmatch(r"\S.*\.", text)
        assert shown in text, kind
        assert ("first" in text) is (kind in OF_LOGS)
        named = () if kind in NAMELESS else ("k_f", "J_p") if kind in OF_BODY else names
        assert all(name in text for name in named), kind
        sentences.add(text)
    assert len(sentences) == len(PLAIN)


@pytest.mark.parametrize(
    ("severity", "opening"),
    [(Level.CARE, "Use with care: "), (Level.WARNING, "Do not use: ")],
)
def test_the_verdict_comes_first_with_its_reasons_which_are_not_said_again(severity, opening):
    known = Finding(kind=FindingKind.PRECISE, parameters=("p4",), number=0.1)
    reason = Finding(kind=FindingKind.POOR_FIT, number=61.3, severity=severity)
    verdict, *others = _verdict_and_more(known, reason, Finding(kind=FindingKind.UNCHECKED))
    assert verdict.startswith(opening)
    assert "61.3 %" in verdict
    assert not any("61.3 %" in each for each in others)
    assert ("p4 known within 10 %." in others) is (severity is Level.CARE)


def test_what_did_not_settle_is_not_to_be_used_and_says_why():
    verdict, *others = _verdict_and_more(ending=Ending.STOPPED)
    assert verdict == "Do not use: The estimation did not settle."
    assert others == []


def test_how_well_parameters_are_known_comes_first_and_in_one_sentence():
    known = Finding(kind=FindingKind.PRECISE, parameters=("p4",), number=0.1)
    hidden = Finding(kind=FindingKind.NOT_FROM_ZERO, parameters=("p2", "tilt"))
    _, *said = _verdict_and_more(Finding(kind=FindingKind.UNCHECKED), known, hidden)
    assert said[0] == "p4 known within 10 %; p2, tilt not distinguishable from zero."
    assert len(said) == 2


@pytest.mark.parametrize(
    ("kind", "number", "severity", "text"),
    [
        (FindingKind.POOR_FIT, -np.inf, Level.WARNING, "the model runs away"),
        (FindingKind.POOR_FIT, 98.76, Level.WARNING, "a median FIT of 98.8 % only"),
        (FindingKind.POOR_FIT, -3e28, Level.WARNING, "a median FIT of less than -1000 % only"),
        (FindingKind.ON_BOUND, None, Level.NOTE, "do not show any"),
        (FindingKind.ON_BOUND, None, Level.CARE, "would cross"),
        (FindingKind.SIMULATIONS, 60.0, Level.NOTE, "The fit converged, after"),
        (FindingKind.SIMULATIONS, 60.0, Level.WARNING, "do not trust the values"),
        (FindingKind.FEW_MASSES, 2.0, Level.NOTE, "Fewer than three added masses: "),
        (FindingKind.FEW_MASSES, 3.0, Level.NOTE, "Without any one added mass"),
        (FindingKind.TORQUE_DRIVEN, 0.004, Level.NOTE, "below 0.002 V s/rad"),  # k = R p4
    ],
)
def test_a_sentence_depends_on_the_number_and_how_grave_it_is(kind, number, severity, text):
    finding = Finding(kind=kind, parameters=("p2",), number=number, severity=severity)
    assert text in " ".join(_verdict_and_more(finding))


@pytest.mark.parametrize(
    ("counts", "text"),
    [
        ((24, 0, 0, 0), "24 logs: all ok."),
        ((1, 0, 0, 0), "1 log: ok."),
        ((10, 31, 0, 0), "41 logs: 10 ok, 31 with a note, none to take care of."),
        ((1, 1, 1, 0), "3 logs: 1 ok, 1 with a note, 1 to take care of."),
        ((0, 0, 0, 1), "1 log: 1 that cannot be used."),
    ],
)
def test_health_is_told_by_severity(counts, text):
    conditions = [each for each, n in zip(Level, counts, strict=True) for _ in range(n)]
    assert conditions_text(conditions) == text
