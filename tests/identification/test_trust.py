"""Kinds of findings: their names in JSON, and that each has its place."""

import re

from pydantic import TypeAdapter

from butterfly.identification.trust import Finding, FindingKind

FINDINGS = TypeAdapter(tuple[Finding, ...])


def test_kinds_are_words_joined_by_hyphens_and_none_is_said_twice():
    names = [str(kind) for kind in FindingKind]
    assert len({*names}) == len(names)
    assert all(re.fullmatch(r"[a-z]+(-[a-z]+)*", name) for name in names)
    assert {"sources-conflict", "known-conflict", "rest-differs", "unit-error"} <= {*names}


def test_findings_survive_json():
    said = tuple(Finding(kind, ("p1", "p4"), number=0.5, logs=("a.csv",)) for kind in FindingKind)
    assert FINDINGS.validate_json(FINDINGS.dump_json(said)) == said
