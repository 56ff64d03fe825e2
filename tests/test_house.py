"""What makes a house hard to live in is counted: it may fall, and is then lowered, never raised.

Only a decision about the whole project raises a ceiling, in a change of its own that says why.
"""

import ast
import re
from collections import Counter
from functools import cache
from pathlib import Path

import pytest

from tests.house import TABLE, table, tuned_numbers

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "butterfly"

CEILINGS = {
    "names of classes that exist twice": 0,
    "modules in import circles": 0,
    "tuned numbers of identification": 61,
}


@cache
def _trees(folder=PACKAGE):
    """Syntax trees of a folder's modules, by dotted name."""
    trees = {}
    for path in sorted(folder.rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        trees[name] = ast.parse(path.read_text(encoding="utf-8"))
    return trees


def _classes_twice():
    """Names of public classes that several modules define."""
    names = Counter(
        node.name
        for tree in _trees().values()
        for node in tree.body
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    )
    return sorted(name for name, count in names.items() if count > 1)


def _imports(tree):
    """Modules of the package that a module imports, inside functions and for types too."""
    known = _trees()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (each.name for each in node.names if each.name in known)
        elif isinstance(node, ast.ImportFrom) and node.module in known:
            below = [f"{node.module}.{each.name}" for each in node.names]
            yield from (each if each in known else node.module for each in below)


def _in_circles():
    """Modules that import themselves by way of others."""
    reach = {name: set(_imports(tree)) - {name} for name, tree in _trees().items()}
    grown = True
    while grown:
        grown = False
        for name, found in reach.items():
            more = set().union(*(reach[each] for each in found)) - found if found else set()
            if more:
                reach[name] = found | more
                grown = True
    return sorted(name for name, found in reach.items() if name in found)


COUNTS = {
    "names of classes that exist twice": lambda: len(_classes_twice()),
    "modules in import circles": lambda: len(_in_circles()),
    "tuned numbers of identification": lambda: len(tuned_numbers()),
}


@pytest.mark.parametrize("what", CEILINGS)
def test_nothing_grows_beyond_its_ceiling(what):
    count = COUNTS[what]()
    assert count <= CEILINGS[what], (what, count, _classes_twice(), _in_circles())


def test_the_tuned_numbers_of_identification_are_listed_with_their_meaning():
    numbers = tuned_numbers()
    assert [each for each in numbers if not each.meaning] == []
    assert TABLE.read_text(encoding="utf-8") == table(numbers), "run python -m tests.house"


def test_whatever_the_page_on_the_house_names_exists():
    text = (ROOT / "docs/house.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`([\w./-]+(?:\.\w+|/))`", text))
    there = [path for base in (PACKAGE, ROOT / "tests") for path in base.rglob("*")]
    names = {path.name for path in there}
    missing = [
        name
        for name in sorted(named)
        if name.rstrip("/") not in names
        and not any((base / name).exists() for base in (PACKAGE, ROOT))
    ]
    assert missing == []


def test_the_page_on_the_house_asks_thirty_questions():
    text = (ROOT / "docs/house.md").read_text(encoding="utf-8")
    answers = re.findall(r"(?m)^\| \d+\. .* \| `([\w./]+)` \|$", text)
    assert len(answers) == len(set(answers)) == 30
