"""What stands beside the program says of it what it says of itself, and all that make installs."""

import importlib
import re
import tomllib
from pathlib import Path

import pytest
import yaml

from butterfly import __version__
from tests import installs

ROOT = Path(__file__).parents[1]
CITATION = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
CONSTRAINTS = (ROOT / "constraints.txt").read_text(encoding="utf-8")
BLOCKS = re.findall(r"(?m)^([\w.-]+)==(\S+)([^\n]*(?:\n    --hash=[^\n]*)+)", CONSTRAINTS)
SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PROJECT = SETTINGS["project"]


def test_the_citation_has_what_its_format_asks_for():
    assert CITATION["cff-version"] == "1.2.0"
    assert all(CITATION[key] for key in ("message", "title", "authors"))
    for reference in CITATION["references"]:
        assert {"type", "title", "authors"} <= set(reference)


def test_the_citation_names_this_version_licence_and_these_authors():
    assert CITATION["version"] == __version__
    assert CITATION["license"] == PROJECT["license"]
    assert CITATION["title"] == PROJECT["name"]
    assert CITATION["authors"] == PROJECT["authors"]


def _name(requirement):
    return re.sub(r"[-_.]+", "-", re.match(r"[\w.-]+", requirement)[0]).lower()


def test_all_that_make_installs_has_a_version_and_hashes_and_no_address():
    groups = [*PROJECT["optional-dependencies"].values(), PROJECT["dependencies"]]
    groups += SETTINGS["dependency-groups"].values()
    declared = {_name(each) for group in groups for each in group} - {PROJECT["name"]}
    assert declared <= {name for name, _, _ in BLOCKS}
    assert all(re.search(r"--hash=sha256:[0-9a-f]{64}", hashes) for _, _, hashes in BLOCKS)
    assert len(BLOCKS) == len(re.findall(r"(?m)^\S", CONSTRAINTS))
    assert not re.search(r"://|file:|--index|--find-links| @ ", CONSTRAINTS)


def test_the_project_has_an_address_which_is_that_of_the_citation():
    cited = {reference["repository-code"] for reference in CITATION["references"]}
    assert {*PROJECT["urls"].values()} <= cited
    assert set(CITATION["keywords"]) <= {*PROJECT["keywords"]}


def test_the_classifiers_name_the_pythons_that_are_tried():
    minor = [each.rpartition(":: ")[2] for each in PROJECT["classifiers"] if ":: 3." in each]
    assert minor == [*installs.VERSIONS]
    assert PROJECT["requires-python"] == f">={minor[0]}"


def test_both_commands_are_functions_of_what_is_in_the_wheel():
    assert PROJECT["scripts"].keys() == {"butterfly", PROJECT["name"]}
    packages = SETTINGS["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]
    for target in PROJECT["scripts"].values():
        module, _, function = target.partition(":")
        assert callable(getattr(importlib.import_module(module), function))
        assert module.partition(".")[0] in packages


def test_the_source_distribution_has_all_that_it_is_tested_and_cited_with():
    included = SETTINGS["tool"]["hatch"]["build"]["targets"]["sdist"]["include"]
    for name in included:
        assert (ROOT / name).exists(), name
    packages = SETTINGS["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]
    beside = {"CITATION.cff", "CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md", ".github", "tests"}
    assert {*packages, *beside} <= {*included}


FORMS = sorted((ROOT / ".github/ISSUE_TEMPLATE").glob("*.yml"))
KINDS = {"markdown", "textarea", "input", "dropdown", "checkboxes"}


@pytest.mark.parametrize("path", FORMS, ids=lambda path: path.stem)
def test_a_form_for_issues_is_one(path):
    form = yaml.safe_load(path.read_text(encoding="utf-8"))
    if path.stem == "config":
        assert form.keys() <= {"blank_issues_enabled", "contact_links"}
        return
    assert all(isinstance(form[key], str) and form[key] for key in ("name", "description"))
    fields = [part for part in form["body"] if part["type"] != "markdown"]
    assert {part["type"] for part in form["body"]} <= KINDS
    assert fields
    names = [part["id"] for part in fields]
    assert len(names) == len(set(names))
    assert all(part["attributes"]["label"] for part in fields)
    assert "versions" in names
    assert "`butterfly report`" in path.read_text(encoding="utf-8")


def test_what_contributors_are_pointed_to_is_there():
    for name in ("CONTRIBUTING.md", "SECURITY.md"):
        text = (ROOT / name).read_text(encoding="utf-8")
        for target in re.findall(r"\]\(([^)#:]+)\)", text):
            assert (ROOT / target).exists(), target
    rules = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    assert len(re.findall(r"(?m)^\d+\. ", rules)) == 10
    for place in re.findall(r"`(butterfly/[\w/.]+)`", rules):
        assert (ROOT / place).exists(), place
    for target in re.findall(r"make ([a-z -]+)`", rules):
        for name in target.split():
            assert re.search(rf"(?m)^{name}:", (ROOT / "Makefile").read_text()), name
