"""What stands beside the program says of it what it says of itself, and all that make installs."""

import re
import tomllib
from pathlib import Path

import yaml

from butterfly import __version__

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
