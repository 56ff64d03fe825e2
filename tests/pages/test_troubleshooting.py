"""docs/troubleshooting.md quotes what the program says, and leaves nothing of a verdict out."""

import ast
import re
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import pytest

from butterfly.identification.agreement import Condition, Contrast
from butterfly.identification.trust import Finding, FindingKind
from butterfly.identification.unit_errors import UnitError
from butterfly.model.parameters import JointKind
from butterfly.report.finding_texts import finding_text
from butterfly.report.parameter_table import contrast_text
from tests.texts import words_of

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/troubleshooting.md").read_text(encoding="utf-8")
QUOTED = re.findall(r"^\| `([^`]+)` \|", PAGE, re.MULTILINE)
GAP = "\N{HORIZONTAL ELLIPSIS}"
CONDITIONS = [each for each in Condition if each is not Condition.ALL]  # which is of terms
VALUES = {"p1": 0.003, "p4": 0.02}


def _parts(quoted):
    return [part for part in (" ".join(each.split()) for each in quoted.split(GAP)) if part]


def _holds(text, quoted):
    pattern = ".*".join(re.escape(part) for part in _parts(quoted))
    return re.search(pattern, text) is not None


def _said(finding):
    return finding_text(finding, VALUES)


# the second line of every verdict
_OF_MODEL = {FindingKind.FOLLOWED, FindingKind.MISFIT, FindingKind.NO_MISFIT}
_SLIPS = {FindingKind.UNIT_ERROR, FindingKind.SUSPECTED, FindingKind.ASKED}
KINDS = [kind for kind in FindingKind if kind not in _SLIPS | _OF_MODEL]
_CONCERNED = {
    FindingKind.CONTRADICTED: ("inertia",),
    FindingKind.RESTS_ON: ("mass_scale", "time_scale"),
    FindingKind.LIKE_SCALE: ("mass_inertia", "arm", "time_scale"),
    FindingKind.UNIT_ASSUMED: ("p4", "V"),
    FindingKind.UNIT_UNREAD: ("p4", "V", "mV", "comment: 'input in mV'", ""),
}
_NUMBERS = {FindingKind.POOR_FIT: (40.0, float("-inf"))}


def _examples(kind):
    """Return findings of a kind, with numbers and names that make a difference."""
    concerned = _CONCERNED.get(kind, ("stribeck_velocity", "p1"))
    alone = [concerned[:1]] if kind is FindingKind.PRIOR_CONFLICT else []  # of what was given
    return [
        Finding(kind, names, logs=("a.mat", "b.mat"), number=number)
        for names in (concerned, *alone)
        for number in _NUMBERS.get(kind, (2.0, 3.0))
    ]


def _example_of_slip(slip):
    parameters = ("mass", "50 g", "3") if slip is UnitError.MASS else (str(slip),)
    return Finding(FindingKind.UNIT_ERROR, parameters, number=0.001, logs=("a.mat",))


def _said_of(condition):
    numbers = dict.fromkeys(("least", "first", "share", "chance"), 0.01)
    ends = {"largest": 0.02, "last": 0.02}
    contrast = Contrast(parameter="p4", condition=condition, **ends, **numbers)
    return contrast_text(contrast, SimpleNamespace(input_kind=None, joint=JointKind.HINGE))


@cache
def _sentences():
    """Return what the program says of findings, by their kind or slip."""
    said = {kind: [_said(each) for each in _examples(kind)] for kind in KINDS}
    said |= {slip: [_said(_example_of_slip(slip))] for slip in UnitError}
    return said | {each: [_said_of(each)] for each in CONDITIONS}


@cache
def _written():
    """Return every text that stands in the package's sources, without what it is filled with."""
    texts = []
    for path in (ROOT / "butterfly").rglob("*.py"):
        nodes = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        texts += [words_of(node, filled=False) for node in nodes]
    return [" ".join(text.split()) for text in texts if text is not None]


@pytest.mark.parametrize("quoted", QUOTED)
def test_every_message_on_the_page_is_one_of_the_program_s(quoted):
    texts = (*(text for said in _sentences().values() for text in said), *_written())
    assert any(_holds(text, quoted) for text in texts)


@pytest.mark.parametrize("what", [*KINDS, *UnitError, *CONDITIONS], ids=str)
def test_whatever_a_verdict_may_say_stands_on_the_page(what):
    assert any(_holds(text, quoted) for text in _sentences()[what] for quoted in QUOTED)
