"""Plant errors into a copy of the package, one after another, and count those that no test sees.

python -m tests.planted --errors 40 --seed 1            # this checkout
python -m tests.planted --errors 40 --seed 1 --tree DIR  # another one

First the tests run once, to learn which of them reach which line (the report on branches that this
gives is printed, too); then each error is planted and the tests that reach its line run, the most
particular first, until one fails, in as many copies as there are cores. Needs pytest-cov.
"""

import argparse
import ast
import json
import os
import random
import shutil
import sqlite3
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from queue import Queue

SWAPPED = {
    ast.Lt: "<=", ast.LtE: "<", ast.Gt: ">=", ast.GtE: ">", ast.Eq: "!=", ast.NotEq: "==",
    ast.In: "not in", ast.NotIn: "in", ast.Is: "is not", ast.IsNot: "is",
    ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*", ast.And: "or", ast.Or: "and",
}  # fmt: skip
"""An operator, and the text that takes its place."""

NAMES = {"min": "max", "max": "min", "any": "all", "all": "any", "sorted": "list"}
LEFT_OUT = ("butterfly/report/", "butterfly/plant/watch/")
"""Drawing, which pictures decide."""

MOST_TESTS = 60
LONGEST_NAME = 1000  # of a test that is named to another process


@dataclass(frozen=True)
class Planted:
    """A text that takes the place of another at (line, first column, last column) of a file."""

    file: str
    line: int
    columns: tuple[int, int]
    text: str


def main(arguments=None):
    """Plant, test, and print what was not seen."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--errors", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--tree", type=Path, default=Path.cwd())
    parser.add_argument("--contexts", type=Path, help="where the reached lines are kept (SQLite)")
    asked = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        copies = [_copied(asked.tree, Path(folder, str(k))) for k in range(os.cpu_count() or 1)]
        contexts = asked.contexts or Path(folder, "contexts")
        if not contexts.exists():
            reach = ("-n", "auto", "--cov=butterfly", "--cov-branch", "--cov-context=test")
            _pytest(copies[0], *reach, "-m", "not slow", "--ignore=tests/benchmarks", shown=True)
            shutil.move(copies[0] / ".coverage", contexts)
            failed = copies[0] / ".pytest_cache/v/cache/lastfailed"
            text = failed.read_text() if failed.exists() else "{}"
            contexts.with_suffix(".failing").write_text(text)
        errors = drawn(copies[0], asked.errors, asked.seed)
        unseen = not_seen(errors, copies, contexts)
    print(f"{len(unseen)} of {asked.errors} planted errors were not seen (seed {asked.seed}):")
    for each in unseen:
        print(f"  {each.file}:{each.line}: {each.text}")


def not_seen(errors: list[Planted], copies: list[Path], contexts: Path) -> list[Planted]:
    """Return the errors that no test sees, planted one by one into each of the copies."""
    free = Queue()
    for copy in copies:
        free.put(copy)

    def seen(error):
        copy = free.get()
        try:
            return _seen(copy, error, _reaching(contexts, error))
        finally:
            free.put(copy)

    with ThreadPoolExecutor(len(copies)) as pool:
        found = list(pool.map(seen, errors))
    return [error for error, was_seen in zip(errors, found, strict=True) if not was_seen]


def _copied(tree: Path, folder: Path) -> Path:
    """Return a copy of a checkout, with the shared data beside it."""
    ignored = shutil.ignore_patterns(".venv", ".git", "build", "results", ".*_cache")
    shutil.copytree(tree, folder / "tree", ignore=ignored, symlinks=True)
    if (tree.parent / "shared").exists():
        (folder / "shared").symlink_to((tree.parent / "shared").resolve())
    return folder / "tree"


def drawn(tree: Path, count: int, seed: int) -> list[Planted]:
    """Return errors at random places of the package, the same for the same seed."""
    found = []
    for path in sorted((tree / "butterfly").rglob("*.py")):
        file = path.relative_to(tree).as_posix()
        if not file.startswith(LEFT_OUT):
            found += _possible(file, path.read_text(encoding="utf-8"))
    return random.Random(seed).sample(found, count)  # noqa: S311 - no secret


def _possible(file: str, text: str) -> list[Planted]:
    lines = text.splitlines()
    found = []
    for node in ast.walk(ast.parse(text)):
        place = _place(node, lines)
        if place is not None:
            line, begin, end, new = place
            found.append(Planted(file, line, (begin, end), new))
    return found


def _place(node: ast.AST, lines: list[str]) -> tuple[int, int, int, str] | None:
    """Return the line (from 1), columns (in characters) and new text of an error at a node."""
    if isinstance(node, ast.Compare) and len(node.ops) == 1:
        return _between(node.left, node.comparators[0], node.ops[0], lines)
    if isinstance(node, ast.BinOp) and type(node.op) in SWAPPED:
        return _between(node.left, node.right, node.op, lines)
    if isinstance(node, ast.BoolOp):
        return _between(node.values[0], node.values[1], node.op, lines)
    number = isinstance(node, ast.Constant) and type(node.value) in {int, float}
    if number and node.lineno == node.end_lineno:
        new = repr(1.5 * node.value if node.value else 1)
        return node.lineno, node.col_offset, node.end_col_offset, new
    if isinstance(node, ast.Name) and node.id in NAMES and isinstance(node.ctx, ast.Load):
        return node.lineno, node.col_offset, node.end_col_offset, NAMES[node.id]
    return None


def _between(left, right, operator, lines):
    """Return the place of an operator that stands alone between its operands on one line."""
    if type(operator) not in SWAPPED or left.end_lineno != right.lineno:
        return None
    gap = lines[left.end_lineno - 1].encode()[left.end_col_offset : right.col_offset].decode()
    if not gap.startswith(" ") or not gap.endswith(" ") or "(" in gap or ")" in gap:
        return None
    return left.end_lineno, left.end_col_offset + 1, right.col_offset - 1, SWAPPED[type(operator)]


def _reaching(contexts: Path, planted: Planted) -> list[str]:
    """Return the tests that reach a line, those that reach fewest lines first.

    Those that fail without an error see none.
    """
    with sqlite3.connect(contexts) as kept:
        reached = kept.execute(
            "select distinct context from arc join file on file.id = file_id "
            "join context on context.id = context_id where file.path like ? and tono = ?",
            (f"%/{planted.file}", planted.line),
        ).fetchall()
        sizes = dict(
            kept.execute(
                "select context, count(*) from arc join context on context.id = context_id "
                "group by context"
            )
        )
    tests = {context.partition("|")[0]: sizes[context] for (context,) in reached if context}
    failing = json.loads(contexts.with_suffix(".failing").read_text())
    tests = {test: size for test, size in tests.items() if test not in failing}
    short = [test for test in tests if len(test) < LONGEST_NAME]
    return sorted(short, key=lambda test: tests[test])[:MOST_TESTS]


def _seen(tree: Path, planted: Planted, tests: list[str]) -> bool:
    """Tell whether a test fails with the error; compiled lines, not traced, meet their folder."""
    path = tree / planted.file
    whole = path.read_text(encoding="utf-8")
    lines = whole.splitlines(keepends=True)
    line = lines[planted.line - 1].encode()
    begin, end = planted.columns
    lines[planted.line - 1] = (line[:begin] + planted.text.encode() + line[end:]).decode()
    mirrored = "/".join(Path(planted.file).parts[1:2])
    asked = tests or (["-m", "not slow", f"tests/{mirrored}"] if "compiled" in whole else [])
    try:
        path.write_text("".join(lines), encoding="utf-8")
        return bool(asked) and _pytest(tree, "-x", *asked) != 0
    finally:
        path.write_text(whole, encoding="utf-8")


def _pytest(tree: Path, *arguments: str, shown: bool = False) -> int:
    kept = () if shown else ("-p", "no:cacheprovider")
    command = [sys.executable, "-m", "pytest", "-q", *kept, *arguments]
    return subprocess.run(  # noqa: S603 - our own tests
        command,
        cwd=tree,
        env=os.environ | {"PYTHONPATH": str(tree), "OMP_NUM_THREADS": "1"},
        stdout=None if shown else subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        timeout=1800,
        check=False,
    ).returncode


if __name__ == "__main__":
    main()
