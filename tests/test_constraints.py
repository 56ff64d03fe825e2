import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "constraints.txt").read_text(encoding="utf-8")
BLOCKS = re.findall(r"(?m)^([\w.-]+)==(\S+)([^\n]*(?:\n    --hash=[^\n]*)+)", TEXT)


def _name(requirement):
    return re.sub(r"[-_.]+", "-", re.match(r"[\w.-]+", requirement)[0]).lower()


def test_all_that_make_installs_has_a_version_and_hashes():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    extras = project["project"]["optional-dependencies"]
    groups = [*extras.values(), *project["dependency-groups"].values()]
    groups.append(project["project"]["dependencies"])
    declared = {_name(each) for group in groups for each in group} - {project["project"]["name"]}
    assert declared <= {name for name, _, _ in BLOCKS}
    assert all(re.search(r"--hash=sha256:[0-9a-f]{64}", hashes) for _, _, hashes in BLOCKS)
    assert len(BLOCKS) == len(re.findall(r"(?m)^\S", TEXT))


def test_the_constraints_name_no_address():
    assert not re.search(r"://|file:|--index|--find-links| @ ", TEXT)
