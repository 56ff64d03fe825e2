"""What the package is made of, counted: its tuned numbers, and what a fit executes.

``python -m tests.house`` writes docs/tuned-numbers.md anew.
"""

import ast
import io
import re
import sys
import threading
import tokenize
from collections import Counter
from collections.abc import Callable, Container
from functools import cache
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple

from butterfly.model.terms import PARAMETERS, TERMS

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "butterfly"

SAYS_NOTHING = frozenset(
    ["each", "found", "own", "said", "told", "left", "kept", "apart", "beside"]
)
"""Names that no variable, argument, function or class has: a noun says what is held."""

CHOICE = frozenset({"stagewise"})
"""Functions that choose terms."""
CONTRASTS = frozenset({"agreement_of", "contrasts"})
"""Functions that pass over the data for contrasts."""
OF_A_FIT = ("identification", "model")
"""Rooms of the package whose files and functions a fit is asked about."""

_OF_EQUATION = {"butterfly.model.terms", "butterfly.model.greybox"}
_COMPREHENSIONS = ("<listcomp>", "<setcomp>", "<dictcomp>", "<genexpr>")
TABLE = ROOT / "docs/tuned-numbers.md"
_HEAD = """# Tuned numbers of identification

Every number that a module of `butterfly/identification`, or `butterfly/verdict.py`, assigns at its
top, and what it means. A rule that needs one more needs a reason; where no source is named, the
number was chosen by trying. `python -m tests.house` writes this page; a test keeps it up to date.
"""


class Number(NamedTuple):
    """A number, or a few, that a module assigns at its top."""

    file: str
    name: str
    value: str
    meaning: str


class Executed(NamedTuple):
    """What of the package a piece of work executed."""

    calls: Counter[tuple[str, str]]  # of each function, by file and qualified name
    deepest: tuple[str, ...]  # the most functions that were on the stack at once, from the first

    @property
    def files(self) -> list[str]:
        """Files of `OF_A_FIT`."""
        return sorted({file for file, _ in self.functions})

    @property
    def functions(self) -> list[tuple[str, str]]:
        """Functions of `OF_A_FIT`, all comprehensions of one function counted once."""
        return sorted({each for each in self.calls if each[0].split("/")[0] in OF_A_FIT})

    def called(self, names: Container[str]) -> int:
        """Return how often functions of some names were called."""
        return sum(n for (_, name), n in self.calls.items() if name.split(".")[-1] in names)


def executed(work: Callable[[], object]) -> Executed:
    """Profile a piece of work, once it has run, so that nothing is imported or compiled any more.

    Frames of all threads count, the stack is that of this one. What runs compiled counts where it
    is called from Python.
    """
    work()
    package, main = f"{PACKAGE}/", threading.get_ident()
    calls: Counter[tuple[str, str]] = Counter()
    stack: list[str] = []
    deepest: tuple[str, ...] = ()

    def on(frame: FrameType, event: str, _: Any) -> None:
        nonlocal deepest
        code = frame.f_code
        if event not in {"call", "return"} or not code.co_filename.startswith(package):
            return
        parts = (
            "<comprehension>" if each in _COMPREHENSIONS else each
            for each in code.co_qualname.split(".")
        )
        name = ".".join(parts)
        if event == "call":
            calls[code.co_filename.removeprefix(package), name] += 1
        if threading.get_ident() != main:
            return
        if event == "return":
            del stack[-1:]
            return
        stack.append(name)
        if len(stack) > len(deepest):
            deepest = tuple(stack)

    threading.setprofile(on)
    sys.setprofile(on)
    try:
        work()
    finally:
        sys.setprofile(None)
        threading.setprofile(None)
    return Executed(calls, deepest)


@cache
def trees() -> dict[str, ast.Module]:
    """Return the syntax trees of the package's modules by dotted name."""
    found = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        found[name] = ast.parse(path.read_text(encoding="utf-8"))
    return found


def carriers() -> list[str]:
    """Return the classes of identification whose fields are rows and residuals, or a target."""
    return [
        f"{module}.{node.name}"
        for module, tree in trees().items()
        if module.startswith("butterfly.identification")
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef)
        and "rows" in (fields := _fields_of(node))
        and not fields.isdisjoint({"residuals", "target"})
    ]


def call_sites(names: Container[str]) -> list[str]:
    """Return where functions of some names are called, by module and line."""
    return [
        f"{module}:{node.lineno}"
        for module, tree in trees().items()
        for node in ast.walk(tree)
        if isinstance(node, ast.Call)
        and getattr(node.func, "id", getattr(node.func, "attr", None)) in names
    ]


def modules_without_tests() -> list[str]:
    """Return the modules of which no file of tests of their room has the name."""
    missing = []
    for path in sorted(PACKAGE.rglob("*.py")):
        module = path.relative_to(PACKAGE)
        room, files = ROOT / "tests", f"test_{path.stem}.py"
        if len(module.parts) > 1:
            room, files = room / module.parts[0], f"**/{files}"
        if path.stem != "__init__" and not any(room.glob(files)):
            missing.append(str(module))
    return missing


def modules_of_identification() -> list[str]:
    """Return the files of identification, by their path in the package."""
    modules = sorted((PACKAGE / "identification").rglob("*.py"))
    return [str(path.relative_to(PACKAGE)) for path in modules if path.stem != "__init__"]


def long_modules(most: int = 500) -> list[str]:
    """Return the files of identification with more lines than ``most``."""
    paths = ((PACKAGE / module, module) for module in modules_of_identification())
    return [
        module
        for path, module in paths
        if len(path.read_text(encoding="utf-8").splitlines()) > most
    ]


def classes_of_results() -> list[str]:
    """Return the classes that have `rows` and `to_dict`, and all that are based on one of these."""
    nodes = {
        node.name: (module, node)
        for module, tree in trees().items()
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef)
    }
    results = {
        name
        for name, (_, node) in nodes.items()
        if {"rows", "to_dict"} <= {getattr(part, "name", None) for part in node.body}
    }
    while more := {
        name
        for name, (_, node) in nodes.items()
        if name not in results and {getattr(base, "id", None) for base in node.bases} & results
    }:
        results |= more
    return sorted(f"{nodes[name][0]}.{name}" for name in results)


def public_names() -> list[str]:
    """Return the names that the package offers, but for its version."""
    stub = ast.parse((PACKAGE / "__init__.pyi").read_text(encoding="utf-8"))
    imports = (node for node in stub.body if isinstance(node, ast.ImportFrom))
    return [alias.asname or alias.name for node in imports for alias in node.names]


def names_that_say_nothing() -> list[str]:
    """Return where the package binds a name of `SAYS_NOTHING`, by module and line."""
    places = []
    for module, tree in trees().items():
        for node in ast.walk(tree):
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
                name = node.id
            else:
                name = getattr(node, "arg", None) if isinstance(node, ast.arg) else None
                name = node.name if isinstance(node, ast.FunctionDef | ast.ClassDef) else name
            if name in SAYS_NOTHING:
                places.append(f"{module}:{node.lineno}: {name}")
    return places


def lists_of_terms() -> list[str]:
    """Return where the package lists names of terms outside the table, by module and line.

    A list is a collection written out that has two names of terms or more, one of them beyond the
    six that are always fitted, or that a module assigns at its top: of those six the formulas of
    the equation of motion are made. The equation itself, compiled, and its derivatives are written
    by hand, and tested against the table.
    """
    return [
        f"{module}:{node.lineno}"
        for module, tree in trees().items()
        if module not in _OF_EQUATION and not module.startswith("butterfly.model.kernel")
        for node in ast.walk(tree)
        if len(names := _terms_in(node)) > 1
        and (names - {*PARAMETERS} or node in [getattr(each, "value", None) for each in tree.body])
    ]


def _terms_in(node: ast.AST) -> set[str]:
    """Return the names of terms in a collection that is written out."""
    if isinstance(node, ast.Dict):
        parts = [each for each in node.keys if each]
    else:
        parts = node.elts if isinstance(node, ast.List | ast.Tuple | ast.Set) else []
    texts = {each.value for each in parts if isinstance(each, ast.Constant)}
    return {each for each in texts if each in TERMS}


def _fields_of(node: ast.ClassDef) -> set[str]:
    targets = [each.target for each in node.body if isinstance(each, ast.AnnAssign)]
    return {each.id for each in targets if isinstance(each, ast.Name)}


@cache
def tuned_numbers() -> list[Number]:
    """Return the numbers that modules of identification and the verdict's assign, by file."""
    found: list[Number] = []
    for path in (*sorted((PACKAGE / "identification").rglob("*.py")), PACKAGE / "verdict.py"):
        found += _of_module(path)
    return found


def table(numbers: list[Number]) -> str:
    """Return the page that lists numbers by file."""
    parts = [_HEAD]
    for file in dict.fromkeys(each.file for each in numbers):
        rows = [each for each in numbers if each.file == file]
        lines = (f"| `{each.name}` | {each.value} | {each.meaning} |" for each in rows)
        parts.append(
            "\n".join([f"## {file}\n", "| name | value | meaning |", "|---|---|---|", *lines])
            + "\n"
        )
    return "\n".join(parts)


def _of_module(path: Path) -> list[Number]:
    text = path.read_text(encoding="utf-8")
    body, (behind, alone) = ast.parse(text).body, _comments(text)
    found = []
    for node, after in zip(body, [*body[1:], None], strict=True):
        if not isinstance(node, ast.Assign | ast.AnnAssign) or not _is_number(node.value):
            continue
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        meaning = behind.get(node.end_lineno or 0, "")
        if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
            meaning = " ".join(str(after.value.value).split())
        meaning = meaning or _above(alone, node.lineno)
        names = re.sub(r"[()]", "", ", ".join(ast.unparse(each) for each in targets))
        assert node.value is not None
        value = ast.unparse(node.value)
        file = str(path.relative_to(ROOT / "butterfly"))
        found.append(Number(file, names, value, meaning.replace("|", "\\|")))
    return found


def _is_number(value: ast.expr | None) -> bool:
    """Whether an expression is made of numbers alone, and of arithmetic on them."""
    if value is None:
        return False
    allowed = (ast.Constant, ast.UnaryOp, ast.BinOp, ast.Tuple, ast.operator, ast.unaryop, ast.Load)
    nodes = list(ast.walk(value))
    constants = [each.value for each in nodes if isinstance(each, ast.Constant)]
    return (
        bool(constants)
        and all(isinstance(each, allowed) for each in nodes)
        and all(isinstance(each, int | float) and not isinstance(each, bool) for each in constants)
    )


def _comments(text: str) -> tuple[dict[int, str], dict[int, str]]:
    """Return the comments of a module by line: those behind code, and those alone on theirs."""
    behind: dict[int, str] = {}
    alone: dict[int, str] = {}
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            found = behind if token.start[1] else alone
            found[token.start[0]] = token.string.lstrip("# ")
    return behind, alone


def _above(comments: dict[int, str], line: int) -> str:
    lines: list[str] = []
    while (line := line - 1) in comments:
        lines.insert(0, comments[line])
    return " ".join(lines)


if __name__ == "__main__":
    TABLE.write_text(table(tuned_numbers()), encoding="utf-8")
