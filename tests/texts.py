"""Every text that a user can see, listed from the code: `python -m tests.texts [PATH ...]`.

Messages, help and labels, and public docstrings, one a line with its place, for a person to read.
"""

from __future__ import annotations

import argparse
import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

PACKAGE = Path(__file__).parents[1] / "butterfly"
_FEWEST_WORDS = 3
_OF_TEMPLATES = re.compile(r">([^<>{}]+)<|[\"'`]([^\"'`]+ [^\"'`]+)[\"'`]")


class Text(NamedTuple):
    """A text, and its line and kind: ``message``, ``docstring`` or ``template``."""

    line: int
    kind: str
    words: str


def words_of(node: ast.AST, *, filled: bool = True) -> str | None:
    """Return a string of the code as read; None of other nodes.

    What it is ``filled`` with is its expression in braces, or nothing.
    """
    if isinstance(node, ast.JoinedStr):
        blank = "{{{}}}" if filled else ""
        parts = (words_of(each) or blank.format(ast.unparse(each.value)) for each in node.values)
        return "".join(parts)
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else None


def texts_of_code(source: str) -> Iterator[Text]:
    """Yield the texts of a module."""
    tree = ast.parse(source)
    docstrings = dict(_docstrings(tree))
    for node, public in docstrings.items():
        if public:
            yield Text(node.lineno, "docstring", node.value)
    for node, words in _outermost(tree):
        if node not in docstrings and len(words.split()) >= _FEWEST_WORDS:
            yield Text(node.lineno, "message", words)


def texts_of_template(source: str) -> Iterator[Text]:
    """Yield the texts of a page's template or script."""
    for number, line in enumerate(source.splitlines(), 1):
        found = map("".join, _OF_TEMPLATES.findall(line))
        yield from (Text(number, "template", words) for words in found if words.strip())


READERS = {".py": texts_of_code, ".j2": texts_of_template, ".js": texts_of_template}


def _docstrings(tree: ast.Module) -> Iterator[tuple[ast.Constant, bool]]:
    """Yield each string that stands as a statement, and whether what it describes is public."""
    for node in ast.walk(tree):
        private = (getattr(node, "name", "") or "").startswith("_")
        body = getattr(node, "body", None)
        for statement in body if isinstance(body, list) else []:
            value = statement.value if isinstance(statement, ast.Expr) else None
            if isinstance(value, ast.Constant) and isinstance(value.value, str):
                yield value, not private


def _outermost(tree: ast.AST) -> Iterator[tuple[ast.expr, str]]:
    """Yield strings with their words, of formatted ones the whole alone."""
    for node in ast.iter_child_nodes(tree):
        words = words_of(node)
        if words is None:
            yield from _outermost(node)
        else:
            yield node, words


def main() -> None:
    """Print the texts of the package, or of some of its files or folders."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("paths", nargs="*", type=Path, default=[PACKAGE])
    parser.add_argument("--kind", choices=["message", "docstring", "template"])
    options = parser.parse_args()
    paths = [each for given in options.paths for each in (given, *sorted(given.rglob("*")))]
    for path in (each for each in paths if each.suffix in READERS):
        texts = READERS[path.suffix](path.read_text(encoding="utf-8"))
        for line, kind, words in sorted(texts, key=lambda each: each.line):
            if options.kind in {None, kind}:
                print(f"{path}:{line}: {kind}: {' '.join(words.split())}")


if __name__ == "__main__":
    main()
