"""What makes a house hard to live in is counted: it may fall, and is then lowered, never raised.

Only a decision about the whole project raises a ceiling, in a change of its own that says why.

What a fit executes is counted by the profiler, on a short quick start with one worker: files of
identification and model, the functions in them by file and qualified name, all comprehensions of
one function once, and how many functions of the whole package are on the stack at once,
comprehensions and lambdas too.
"""

import ast
import re
from collections import Counter

import pytest

import butterfly as bf
from butterfly.identification.data import read_data_set
from butterfly.identification.estimators import OutputError
from butterfly.logs.manifest import read_manifest
from butterfly.verdict import Level
from tests.house import (
    CHOICE,
    CONTRASTS,
    PACKAGE,
    ROOT,
    TABLE,
    call_sites,
    carriers,
    classes_of_results,
    executed,
    lists_of_terms,
    long_modules,
    modules_of_identification,
    modules_without_tests,
    names_that_say_nothing,
    public_names,
    table,
    trees,
    tuned_numbers,
)

CEILINGS = {
    "names of classes that exist twice": 0,
    "modules in import circles": 0,
    "tuned numbers of identification": 93,
    "classes that carry rows and residuals of a fit": 2,
    "places that choose terms": 2,
    "lists of names of terms outside their table": 0,
    "names that say nothing": 0,
    "files of identification": 26,
    "files of identification above 500 lines": 0,
    "modules without tests of their name": 0,
    "classes of results": 4,
    "public names": 38,
    "files of the package": 150,
    "files that a fit executes": 22,
    "functions that a fit executes": 420,
    "depth of calls in a fit": 18,
    "choices of terms in a sound answer": 1,
    "passes of contrasts in a sound answer": 1,
}
NOT_REACHED = {
    "files of the package": 210,
    "files of identification": 38,
    "files that a fit executes": 29,
    "functions that a fit executes": 557,
}
"""What is asked above and not reached yet: the count that there is, which may only fall."""


def _classes_twice():
    """Names of public classes that several modules define."""
    names = Counter(
        node.name
        for tree in trees().values()
        for node in tree.body
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    )
    return sorted(name for name, count in names.items() if count > 1)


def _imports(tree):
    """Modules of the package that a module imports, inside functions and for types too."""
    known = trees()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (each.name for each in node.names if each.name in known)
        elif isinstance(node, ast.ImportFrom) and node.module in known:
            below = [f"{node.module}.{each.name}" for each in node.names]
            yield from (each if each in known else node.module for each in below)


def _in_circles():
    """Modules that import themselves by way of others."""
    reach = {name: set(_imports(tree)) - {name} for name, tree in trees().items()}
    grown = True
    while grown:
        grown = False
        for name, found in reach.items():
            more = set().union(*(reach[each] for each in found)) - found if found else set()
            if more:
                reach[name] = found | more
                grown = True
    return sorted(name for name, found in reach.items() if name in found)


FOUND = {
    "names of classes that exist twice": _classes_twice,
    "modules in import circles": _in_circles,
    "tuned numbers of identification": tuned_numbers,
    "classes that carry rows and residuals of a fit": carriers,
    "places that choose terms": lambda: call_sites(CHOICE),
    "lists of names of terms outside their table": lists_of_terms,
    "names that say nothing": names_that_say_nothing,
    "files of identification": modules_of_identification,
    "files of identification above 500 lines": long_modules,
    "modules without tests of their name": modules_without_tests,
    "classes of results": classes_of_results,
    "public names": public_names,
    "files of the package": trees,
}
IN_A_FIT = {
    "files that a fit executes": lambda fit: fit.files,
    "functions that a fit executes": lambda fit: fit.functions,
    "depth of calls in a fit": lambda fit: fit.deepest,
}
IN_AN_ANSWER = {
    "choices of terms in a sound answer": CHOICE,
    "passes of contrasts in a sound answer": CONTRASTS,
}


@pytest.fixture(scope="module")
def fit(quick_data):
    """What a fit of a short quick start executes."""
    data = read_data_set(read_manifest(quick_data / "manifest.yaml"))
    return executed(lambda: OutputError(workers=1)(data))


@pytest.fixture(scope="module")
def answer(quick_data):
    """What an identification of it executes, whose answer is sound."""
    found = []
    ran = executed(lambda: found.append(bf.identify(quick_data)))
    assert {each.judged.level for each in found} == {Level.GOOD}
    return ran


def test_every_ceiling_is_tested():
    assert CEILINGS.keys() == {*FOUND, *IN_A_FIT, *IN_AN_ANSWER}


@pytest.mark.parametrize("what", FOUND)
def test_nothing_grows_beyond_its_ceiling(what):
    found, most = FOUND[what](), NOT_REACHED.get(what, CEILINGS[what])
    if len(found) > CEILINGS[what]:
        print(f"missed: {len(found)} {what}, {CEILINGS[what]} asked")
    assert len(found) <= most, found


@pytest.mark.parametrize("what", IN_A_FIT)
def test_a_fit_executes_no_more_than_its_ceiling(fit, what):
    found, most = IN_A_FIT[what](fit), NOT_REACHED.get(what, CEILINGS[what])
    if len(found) > CEILINGS[what]:
        print(f"missed: {len(found)} {what}, {CEILINGS[what]} asked")
    assert len(found) <= most, "\n".join(map(str, found))


@pytest.mark.parametrize("what", IN_AN_ANSWER)
def test_a_sound_answer_does_nothing_twice(answer, what):
    assert answer.called(IN_AN_ANSWER[what]) == CEILINGS[what]


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


def test_the_formulas_on_the_page_on_the_house_are_lines_of_the_code():
    text = (ROOT / "docs/house.md").read_text(encoding="utf-8")
    lines = re.findall(r"^    `([\w/]+\.py)`: `(.+)`$", text, re.MULTILINE)
    assert len(lines) == 5
    for file, line in lines:
        code = (PACKAGE / "identification" / file).read_text(encoding="utf-8")
        assert line in map(str.strip, code.splitlines()), (file, line)


def test_the_page_on_the_house_asks_thirty_questions():
    text = (ROOT / "docs/house.md").read_text(encoding="utf-8")
    answers = re.findall(r"(?m)^\| \d+\. .* \| `([\w./]+)` \|$", text)
    assert len(answers) == len(set(answers)) == 30


READS_SOURCE = {"butterfly.twin.translate"}
"""Translates functions of Python to other languages."""


def test_no_module_runs_or_reads_source():
    """An editor follows each call, and a type checker checks it."""
    for module, tree in trees().items():
        called = {
            node.func.id
            for node in ast.walk(tree)
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
        }
        assert not called & {"exec", "eval", "compile"}, module
        if module not in READS_SOURCE:
            names = {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
            assert not names & {"getsource", "getsourcelines"}, module
            assert not {"ast", "inspect.getsource"} & {*_all_imports(tree)}, module


def test_no_command_hides_a_verb_in_a_partial():
    for module, tree in trees().items():
        if module.startswith("butterfly.cli."):
            assert not {name for name in _all_imports(tree) if "partial" in name}, module


def _all_imports(tree):
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
