"""The tables in docs/ that list terms and options say what the program has."""

import re
from dataclasses import fields
from pathlib import Path

from butterfly.cli.output import ExitCode
from butterfly.experiment.methods import ESTIMATORS
from butterfly.model.servo import LAWS, ServoLoop
from butterfly.model.terms import TERMS, FrictionTerms, offered
from butterfly.result import HEAD

DOCS = Path(__file__).parents[1] / "docs"


def _rows(name):
    text = (DOCS / name).read_text(encoding="utf-8")
    return [line for line in text.splitlines() if line.startswith("|")]


def test_the_friction_terms_stand_in_the_docs_with_meaning_and_unit():
    rows = _rows("file-formats.md")
    for field in fields(FrictionTerms):
        row = TERMS[field.name]
        assert f"| `{row.name}` | {row.meaning} | {row.unit} |" in rows


def test_the_laws_of_servos_stand_in_the_docs_with_their_sources():
    rows = _rows("file-formats.md")
    others = "\n".join(row for row in rows if "STRUCTURE-OUTPUT" in row)
    for name, law in LAWS.items():
        if law.source:
            numbers = f"{law.limit:g} | {law.clock:.3g}"
            told = f"| `{name}` | `{law.structure}` | {law.output} | {numbers} | {law.source} |"
            assert told in rows
        else:
            assert name == f"{law.structure}-{law.output}"
            assert f"`{law.structure}`" in others
            assert f"`{law.output}`" in others
    keys = {key for row in rows for key in re.findall(r"`(\w+)`", row.split("|")[1])}
    assert {field.name for field in fields(ServoLoop)} - {"law"} <= keys


def test_the_terms_that_each_estimator_offers_stand_in_the_docs():
    rows = _rows("methods.md")
    for method in {*ESTIMATORS, "re-calibration"} - {"auto"}:
        terms = ", ".join(f"`{name}`" for name in offered(method)) or "–"
        assert f"| `{method}` | {terms} |" in rows


def test_every_option_of_every_estimator_stands_in_the_docs():
    text = (DOCS / "methods.md").read_text(encoding="utf-8")
    for kind in ESTIMATORS.values():
        for option in fields(kind):
            assert f"`{option.name}`" in text


def test_the_keys_that_every_document_in_json_has_stand_in_the_docs():
    page = (DOCS / "commands.md").read_text(encoding="utf-8")
    for key in HEAD:
        assert f"`{key}`" in page


def test_the_exit_codes_stand_in_the_docs():
    found = [re.match(r"\| `(\d+)` \|", row) for row in _rows("commands.md")]
    assert [int(each[1]) for each in found if each] == [*ExitCode]
