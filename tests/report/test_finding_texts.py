"""What was found is said, in a sentence for each kind, with its number and its parameters."""

import re
from dataclasses import replace

import numpy as np
import pytest

from butterfly.identification.agreement import Condition, Contrast
from butterfly.identification.trust import Ending, Finding, FindingKind
from butterfly.report.finding_texts import (
    estimate_notes,
    estimate_sentences,
    estimate_verdict,
    finding_text,
    grave_notes,
)
from butterfly.verdict import Level
from tests.report.setting import estimate_with

NUMBERS = {
    FindingKind.LOGS_LOST: (4.0, "of 4 logs"),
    FindingKind.NEIGHBOURS_MOVED: (0.025, "0.025 rad"),
    FindingKind.NEIGHBOURS_CORRECTED: (0.07, "7 %"),
    FindingKind.UNREPEATED: (-0.112, "11 % smaller in second"),
    FindingKind.POOR_FIT: (61.3, "61.3 %"),
    FindingKind.NO_INERTIA: (-2e-4, "-0.0002 kg"),
    FindingKind.LEFT_OUT: (12.0, "was excluded"),
    FindingKind.MISSING_TERM: (0.31, "31 %"),
    FindingKind.OTHER_END: (1.52, "1.52 times"),
    FindingKind.COMBINATION: (4321.0, "number 4300"),
    FindingKind.FEW_MASSES: (2.0, "Fewer than three"),
    FindingKind.TORQUE_DRIVEN: (0.004, "0.004 Ohm"),
    FindingKind.NO_UNCERTAINTY: (3.0, "3 resonance"),
    FindingKind.FOLLOWED: (0.0123, "1.2 %"),
    FindingKind.MISFIT: (41.3, "41.3 times"),
    FindingKind.NO_MISFIT: (1.02, "1.02 times"),
    FindingKind.FEW_LOGS: (2.0, "2 logs"),
    FindingKind.CLOCK: (-0.0031, "0.31 % slower"),
    FindingKind.CLOCK_SET: (0.0042, "0.42 % faster"),
    FindingKind.OMEGA_SET: (0.0042, "0.42 % faster"),
    FindingKind.SCATTER: (0.213, "21 %"),
    FindingKind.LIKE_SCALE: (0.00213, "0.21 %"),
    FindingKind.OFF_CENTRE: (0.00873, "0.5°"),
    FindingKind.LIKE_TERM: (0.0213, "2.1 %"),
    FindingKind.REST_DIFFERS: (0.131, "0.13 rad"),
    FindingKind.KNOWN_CONFLICT: (-0.021, "about 2.1 % smaller"),
    FindingKind.PRIOR_CONFLICT: (3.42, "3.4 standard errors"),
    FindingKind.MOTOR_CONFLICT: (4.21, "4.2 standard errors"),
    FindingKind.SOURCES_CONFLICT: (4.23, "4.2 standard uncertainties"),
    FindingKind.CONTRADICTED: (5.61, "5.6 standard errors"),
    FindingKind.SEARCH_STOPPED: (60.0, "after 60 s"),
    FindingKind.PLANT: (4.21e-5, "0.004 %"),
}
OF_BODY = {FindingKind.CONTRADICTED: ("viscous_friction", "inertia")}
"""Physical parameters instead of the model's."""
OF_UNITS = {
    FindingKind.UNIT_ASSUMED: ("p4", "V"),
    FindingKind.UNIT_UNREAD: ("p4", "V", "mA", "comment: 'in mA'", "current"),
}
OF_SCALES = {
    FindingKind.RESTS_ON: ("mass_scale", "arm"),
    FindingKind.LIKE_SCALE: ("mass_inertia", "arm", "time_scale"),
}
"""What values rest on instead, or what may be wrong instead of a term."""
OF_LOGS = {
    FindingKind.STRAIGHT,  # whose sentence has a word of a manifest
    FindingKind.UNREPEATED,
    FindingKind.LOGS_LOST,
    FindingKind.LEFT_OUT,
    FindingKind.UNPREDICTABLE,
    FindingKind.ZERO_GUESSED,
}
NAMELESS = OF_LOGS | {
    *(FindingKind.FEW_MASSES, FindingKind.OTHER_END, FindingKind.APPROXIMATE),
    *(FindingKind.POOR_FIT, FindingKind.FEW_LOGS, FindingKind.REST_DIFFERS),
    *(FindingKind.TORQUE_DRIVEN, FindingKind.NO_UNCERTAINTY),
    *(FindingKind.ABSOLUTE, FindingKind.RATIOS, FindingKind.FOLLOWED, FindingKind.EARLY),
    *(FindingKind.MISFIT, FindingKind.NO_MISFIT),
    *(FindingKind.CLOCK_SET, FindingKind.OMEGA_SET, FindingKind.STRAIGHT),
    FindingKind.OFF_CENTRE,
}
SLIPS = {FindingKind.UNIT_ERROR, FindingKind.SUSPECTED, FindingKind.ASKED}
PLAIN = [kind for kind in FindingKind if kind not in SLIPS]
"""Wrong units have sentences of their own, each its test."""
VALUES = {"p2": 1e-3, "p4": -0.5, "tilt": 0.2}


def _logs_of(kind):
    return ("first", "second") if kind is FindingKind.UNREPEATED else ("first",)


def test_every_kind_of_finding_has_its_own_sentence_with_its_number_and_parameters():
    sentences = set()
    for kind in PLAIN:
        number, shown = NUMBERS.get(kind, (None, ""))
        names = OF_BODY.get(kind, OF_SCALES.get(kind, OF_UNITS.get(kind, ("p2", "tilt"))))
        text = finding_text(Finding(kind, names, number=number, logs=_logs_of(kind)), VALUES)
        assert re.fullmatch(r"\S.*\.", text)
        assert shown in text, kind
        assert ("first" in text) is (kind in OF_LOGS)
        named = () if kind in NAMELESS else names
        named = ("masses", "arm") if kind is FindingKind.RESTS_ON else named
        named = ("mass_inertia", "arm", "clock") if kind is FindingKind.LIKE_SCALE else named
        named = OF_UNITS[kind][1:] if kind in OF_UNITS else named
        assert all(name in text for name in named), kind
        sentences.add(text)
    assert len(sentences) == len(PLAIN)


@pytest.mark.parametrize(
    "kind",
    [FindingKind.POOR_FIT, FindingKind.NO_INERTIA, FindingKind.NEGATIVE, FindingKind.PULLED],
)
def test_units_signs_and_masses_are_named_only_where_one_was_found(kind):
    names = () if kind is FindingKind.POOR_FIT else ("p2",)
    said = finding_text(Finding(kind, names, number=-3.0), VALUES)
    assert not re.search(r"\b(units?|signs?|mass(es)?|timestamps?)\b", said)
    assert re.search("residuals of each log|`butterfly inspect`", said)  # what to do instead


def test_what_the_program_assumed_is_not_called_given():
    assumed = Finding(FindingKind.PRIOR_CONFLICT, ("delay", "0 to about 0.01"), number=4.0)
    said = finding_text(assumed, VALUES)
    assert "the assumed delay, 0 to about 0.01 s," in said
    assert "given" not in said


@pytest.mark.parametrize(
    ("reach", "level", "text"),
    [
        (0.05, Level.GOOD, "p1 ±5 %, p4 ±5 %; p2 ±5 %, coulomb ±5 %."),
        ((0.0999, 0.9, 0.0999, 2.0), Level.GOOD, "p1 ±10 %, p4 ±10 %; p2 ±90 %; "
         "coulomb not significant."),
        ((0.25, 1.5, 0.04, 1.5), Level.CARE, "p1 ±25 %, p4 ±4 %; p2 and coulomb not "
         "significant."),
        ((0.05, 0.05, 0.1002, 0.05), Level.CARE, "p1 ±5 %, p4 ±11 %; "),
        ((np.nan, 0.05, 0.05, 0.05), Level.CARE, "p1 without an interval."),
    ],
)  # fmt: skip
def test_values_are_good_if_the_limits_of_the_scale_are_within_a_tenth(reach, level, text):
    verdict = estimate_verdict(estimate_with(reach=reach))
    assert verdict.level is level
    assert text in verdict.reasons[0]


def test_an_asymmetric_interval_reaches_as_far_as_its_farther_limit():
    estimate = estimate_with()
    estimate = replace(estimate, upper=estimate.values * 1.2)
    assert estimate.relative_half_widths["p1"] == pytest.approx(0.2)
    assert estimate.level is Level.CARE


def test_of_ratios_that_of_the_gain_counts_and_of_what_is_known_the_rest():
    names = ("p2", "p3", "p4", "delay")
    ratios = replace(estimate_with(reach=(0.5, 0.5, 0.01, 0.5)), names=names)
    verdict = estimate_verdict(ratios)
    assert verdict.level is Level.GOOD
    assert "p4/p1 ±1 %; p2/p1 ±50 %, p3/p1 ±50 %, delay ±50 %" in (verdict.reasons[0])
    known = replace(estimate_with(reach=0.5), names=("p2", "p3", "delay", "coulomb"))
    assert known.level is Level.GOOD


FOLLOWED = Finding(FindingKind.FOLLOWED, number=0.0123)
MISFIT = Finding(FindingKind.MISFIT, number=3.456)
LACKS = Finding(FindingKind.MISSING_TERM, ("drag or load", "p2"), number=0.614)
SCATTER = (
    Finding(FindingKind.SCATTER, ("p2", "coulomb"), number=0.213),
    Finding(FindingKind.SCATTER, ("p4",), number=0.0123),
)
_NUMBERS = {"least": 0.0, "largest": 1e-3, "first": 2e-3, "last": 2.2e-3}
WITH_MASS = Contrast(parameter="p1", condition=Condition.MASS, share=0.4, chance=1e-3, **_NUMBERS)
WITH_LOG = replace(WITH_MASS, parameter="p2", condition=Condition.LOG)
_TIMES = "Model: error 1.2 % of the motion, 3.5 times the sensor noise"
_OF_NOISE = "Model: error 1.2 % of the motion, 1.1 times the sensor noise"
_LACKS = "drag or load (61 % of the residual)"
_GROWS = (
    "p1 grows with the added mass, from 0.002 to 0.0022 kg m². Possible causes: the added mass's "
    "own inertia, its arm, the clock, a moving base."
)
_VARIES = (
    "p2 varies between logs, from 0.002 to 0.0022 N m s/rad. Possible causes: temperature, "
    "lubrication, wear."
)
_SCATTER = "Scatter between logs: p2, coulomb by 21 %; p4 by 1.2 %."


@pytest.mark.parametrize(
    ("findings", "agreement", "line", "sentences"),
    [
        ([FOLLOWED], (), "Model: error 1.2 % of the motion.", []),
        ([FOLLOWED, Finding(FindingKind.NO_MISFIT, number=3.456)], (), f"{_TIMES}.", []),
        ([FOLLOWED, MISFIT], (), f"{_TIMES}; none of the optional terms explains it.", []),
        ([FOLLOWED, replace(MISFIT, number=1.1)], (), f"{_OF_NOISE}.", []),
        ([FOLLOWED, MISFIT, LACKS], (), f"{_TIMES}; missing term: {_LACKS}.", []),
        ([FOLLOWED, MISFIT, *SCATTER], (), f"{_TIMES}.", [_SCATTER]),
        ([FOLLOWED, MISFIT], (WITH_LOG,), f"{_TIMES}.", [_VARIES]),
        ([FOLLOWED, MISFIT], (WITH_MASS,), f"{_TIMES}.", [_GROWS]),
    ],
)
def test_the_second_line_is_the_model_s_and_what_differs_between_logs_comes_next(
    findings, agreement, line, sentences
):
    estimate = estimate_with(*findings, agreement=agreement)
    verdict = estimate_verdict(estimate)
    assert verdict.level is Level.GOOD
    assert verdict.reasons[1] == line
    assert estimate_notes(estimate) == sentences


def test_terms_that_the_free_runs_lack_are_not_said_to_be_of_no_help():
    idle = Finding(FindingKind.NOT_HELPING, ("drag", "stribeck"))
    said = estimate_sentences(estimate_with(FOLLOWED, MISFIT, idle))
    assert any("Tested and left out" in each for each in said)
    said = estimate_sentences(estimate_with(FOLLOWED, MISFIT, idle, LACKS))
    assert not any("Tested and left out" in each for each in said)


def test_what_forbids_is_the_first_line_and_nothing_is_called_known():
    reason = Finding(FindingKind.POOR_FIT, number=31.3)
    note = Finding(FindingKind.ABSOLUTE)
    verdict, *others = estimate_sentences(estimate_with(reason, note))
    assert verdict.startswith("Do not use: ")
    assert "31.3 %" in verdict
    assert "±" not in verdict
    assert others == [finding_text(note, {})]


def test_what_did_not_settle_is_not_to_be_used_and_says_why():
    verdict, *others = estimate_sentences(estimate_with(ending=Ending.STOPPED))
    assert verdict == "Do not use: The fit did not converge."
    assert others == []


@pytest.mark.parametrize(
    ("kind", "number", "text"),
    [
        (FindingKind.POOR_FIT, -np.inf, "simulation with these values diverges"),
        (FindingKind.POOR_FIT, -3e28, "median FIT less than -1000 %"),
        (FindingKind.FEW_MASSES, 2.0, "Fewer than three added masses: "),
        (FindingKind.FEW_MASSES, 3.0, "Without any one added mass"),
        (FindingKind.TORQUE_DRIVEN, 0.004, "below 0.002 V s/rad"),  # k = R p4
    ],
)
def test_a_sentence_depends_on_the_number(kind, number, text):
    assert text in finding_text(Finding(kind, ("p2",), number=number), VALUES)


@pytest.mark.parametrize(
    ("finding", "begins"),
    [
        (Finding(FindingKind.ASKED, ("grams",), number=60.0), "Is an added mass of 60 kg right?"),
        (Finding(FindingKind.CONTRADICTED, ("inertia",), number=9.0), "The given motor and body"),
        (Finding(FindingKind.PRIOR_CONFLICT, ("p1",), number=9.0), "The logs contradict the given"),
    ],
)
def test_what_makes_values_doubtful_is_in_the_first_line_of_the_verdict_and_said_once(
    finding, begins
):
    estimate = estimate_with(finding)
    verdict = estimate_verdict(estimate)
    assert estimate.level is Level.CARE
    assert verdict.lines[0].startswith(f"Use with care: {begins}")
    assert verdict.lines[0].endswith("coulomb ±5 %.")
    assert grave_notes(estimate) == []
    ruined = replace(estimate, findings=(Finding(FindingKind.NEGATIVE, ("p2",)), finding))
    assert grave_notes(ruined) == [finding_text(finding, VALUES)]  # which another verdict leaves


def test_a_fast_look_names_no_causes_of_what_differs_between_logs():
    estimate = estimate_with(FOLLOWED, Finding(FindingKind.APPROXIMATE), agreement=(WITH_LOG,))
    assert not any("cause" in sentence for sentence in estimate_sentences(estimate))
    assert any("cause" in text for text in estimate_notes(estimate_with(agreement=(WITH_LOG,))))
